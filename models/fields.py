"""Fields and their truth, and which streaks a detector can fairly be asked for.

Truth is in cells of the map (0 = left edge of the first cell), as ``vision.maps`` defines them.
``models.field_scene`` draws fields.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.records import MapMode
from rsoconsole.vision import ByteArray, binning_of

FIELD_CELLS = 192
Kind = Literal["ordinary", "empty", "trailed stars", "aircraft", "rays", "meteor"]
KINDS: tuple[Kind, ...] = ("ordinary", "empty", "trailed stars", "aircraft", "rays", "meteor")
FloatArray = npt.NDArray[np.float64]

SHORTEST_CELLS = {2: 9.0, 4: 5.0, 8: 3.5, 16: 3.5}
"""Least visible length by block: a shorter part is neither asked for nor held against the
network. At a block of 2 cosmic rays are as long and as bright."""
SHORTEST_PAPER_CELLS = 6.0
SHORT_CELLS = 6.0
"""Length below which a streak has to be bright to differ from two close stars."""
LONGEST_CELLS = 75.0
"""Longest of most streaks; of the hard ones some reach from corner to corner."""
DIAGONAL_CELLS = FIELD_CELLS * 2.0**0.5
FAINTEST_SNR = 12.0
"""Least integrated SNR of a streak drawn, and asked for where it is long."""
_FAINTEST_BIN_SNR = 0.8
"""Signal to noise below which light is in no cell of the map, however long the streak."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueStreak:
    """One satellite's trail as far as it lies in the field."""

    x_a: float
    y_a: float
    x_b: float
    y_b: float
    peak_snr: float
    """Its ridge over the noise of one pixel, mean along it, clouds and light curve included."""
    integrated_snr: float
    """Matched SNR of the part in the field."""
    is_asked: bool
    """False: too faint or too little of it in the field; finding it is no fault either."""

    @property
    def length(self) -> float:
        """Length from end to end, cells."""
        return float(np.hypot(self.x_b - self.x_a, self.y_b - self.y_a))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """One training or test field."""

    values: ByteArray
    kind: Kind
    mode: MapMode
    block: int
    streaks: tuple[TrueStreak, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Properties that the fields of one batch share, or None for a draw per field."""

    kind: Kind | None = None
    mode: MapMode | None = None
    peak_snr: tuple[float, float] | None = None
    streak_cells: tuple[float, float] | None = None
    streaks: tuple[int, int] | None = None
    is_hard: bool = True
    """False: the frames of an ordinary night; no clouds, few cosmic rays, no dense field."""


def clip_to_box(
    segment: tuple[float, float, float, float], width: float, height: float
) -> tuple[float, float, float, float] | None:
    """The part of (x_a, y_a, x_b, y_b) inside [0, width] x [0, height], or None.

    Source: Liang and Barsky 1984.
    """
    x_a, y_a, x_b, y_b = segment
    enters, leaves = 0.0, 1.0
    for start, step, limit in ((x_a, x_b - x_a, width), (y_a, y_b - y_a, height)):
        if abs(step) < 1e-9:
            if not 0.0 <= start <= limit:
                return None
            continue
        first, second = sorted(((0.0 - start) / step, (limit - start) / step))
        enters, leaves = max(enters, first), min(leaves, second)
    if leaves <= enters:
        return None
    dx, dy = x_b - x_a, y_b - y_a
    return x_a + enters * dx, y_a + enters * dy, x_a + leaves * dx, y_a + leaves * dy


def cut_ends(segment: tuple[float, float, float, float], width: float, height: float) -> int:
    """Number of ends of a clipped segment on the rim: 0, 1 or 2."""
    x_a, y_a, x_b, y_b = segment
    rim = 0.01
    return sum(min(x, y, width - x, height - y) < rim for x, y in ((x_a, y_a), (x_b, y_b)))


def is_asked_for(
    peak_snr: float, integrated_snr: float, visible_cells: float, mode: MapMode, block: int
) -> bool:
    """True where a detector that sees only the map can fairly be asked for this streak."""
    if mode == "paper":
        return visible_cells >= SHORTEST_PAPER_CELLS and peak_snr >= 3.0
    if visible_cells < SHORTEST_CELLS[block]:
        return False
    # Binning 2 x 2 raises a line's signal to noise by 1.75 at such seeing.
    bin_snr = peak_snr * (1.75 if binning_of(block) == 2 else 1.0)
    if visible_cells < SHORT_CELLS:
        return bin_snr >= 5.0
    if integrated_snr >= FAINTEST_SNR and bin_snr >= _FAINTEST_BIN_SNR:
        return True
    return bin_snr >= 2.0 and bin_snr * float(np.sqrt(visible_cells)) >= 9.0
