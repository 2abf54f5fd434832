"""Fields and their truth, and the streaks that a detector is expected to find.

Truth is in cells of the map (0 = left edge of the first cell), as ``vision.maps`` defines them.
``models.field_scene`` draws fields.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.records import MapMode
from rsoconsole.vision import ByteArray, bin_side_px

FIELD_CELLS = 192
Kind = Literal["ordinary", "empty", "trailed stars", "aircraft", "rays", "meteor"]
KINDS: tuple[Kind, ...] = ("ordinary", "empty", "trailed stars", "aircraft", "rays", "meteor")
FloatArray = npt.NDArray[np.float64]

SHORTEST_CELLS = {2: 9.0, 4: 5.0, 8: 3.5, 16: 3.5}
"""Least visible length in cells of an expected streak, by pixels per cell.

A shorter streak counts neither as found nor as false. At 2 pixels per cell cosmic rays are as long
and as bright.
"""
SHORTEST_PAPER_CELLS = 6.0
SHORT_CELLS = 6.0
"""Length in cells below which a streak must be bright to differ from two close stars."""
LONGEST_CELLS = 75.0
"""Length in cells of the longest streaks; some in hard fields reach from corner to corner."""
DIAGONAL_CELLS = FIELD_CELLS * 2.0**0.5
FAINTEST_SNR = 12.0
"""Least integrated SNR of a drawn streak, and of a long streak that is expected to be found."""
_FAINTEST_BIN_SNR = 0.8
"""Signal to noise below which light is in no cell of the map, however long the streak."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueStreak:
    """The part of one satellite's trail inside the field, from end a to end b, in cells."""

    x_a: float
    y_a: float
    x_b: float
    y_b: float
    peak_snr: float
    """Ridge over the noise of one pixel, mean along the trail, with clouds and light curve."""
    integrated_snr: float
    """Integrated (matched) SNR of the part inside the field."""
    is_asked: bool
    """True where the detector is expected to find it.

    False for a trail that is too faint or has too short a part in the field: it counts neither as
    found nor as false.
    """

    @property
    def length(self) -> float:
        """Length from end to end in cells."""
        return float(np.hypot(self.x_b - self.x_a, self.y_b - self.y_a))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """One training or test field: map ``values`` (height, width), its kind, and true streaks.

    ``block``: pixels per cell of the map.
    """

    values: ByteArray
    kind: Kind
    mode: MapMode
    block: int
    streaks: tuple[TrueStreak, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Properties that the fields of one batch share; None: drawn for each field.

    Pairs are ranges: of peak SNR, of length in cells, of the number of streaks.
    """

    kind: Kind | None = None
    mode: MapMode | None = None
    peak_snr: tuple[float, float] | None = None
    streak_cells: tuple[float, float] | None = None
    streaks: tuple[int, int] | None = None
    is_hard: bool = True
    """False: frames of an ordinary night, without clouds, many cosmic rays or dense star fields."""


def clip_to_box(
    segment: tuple[float, float, float, float], width: float, height: float
) -> tuple[float, float, float, float] | None:
    """The part of a segment (x_a, y_a, x_b, y_b) inside [0, width] x [0, height]; None outside.

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
    """Number of ends of a clipped segment that lie on the edge of the field: 0, 1 or 2."""
    x_a, y_a, x_b, y_b = segment
    rim = 0.01
    return sum(min(x, y, width - x, height - y) < rim for x, y in ((x_a, y_a), (x_b, y_b)))


def is_asked_for(
    peak_snr: float, integrated_snr: float, visible_cells: float, mode: MapMode, block: int
) -> bool:
    """True where a detector that sees only the map can be expected to find this streak.

    ``block``: pixels per cell of the map.
    """
    if mode == "paper":
        return visible_cells >= SHORTEST_PAPER_CELLS and peak_snr >= 3.0
    if visible_cells < SHORTEST_CELLS[block]:
        return False
    # Binning 2 x 2 raises a line's signal to noise by 1.75 at such seeing.
    bin_snr = peak_snr * (1.75 if bin_side_px(block) == 2 else 1.0)
    if visible_cells < SHORT_CELLS:
        return bin_snr >= 5.0
    if integrated_snr >= FAINTEST_SNR and bin_snr >= _FAINTEST_BIN_SNR:
        return True
    return bin_snr >= 2.0 and bin_snr * float(np.sqrt(visible_cells)) >= 9.0
