"""Master darks, flats and biases as files: read by the frames' own reader, chosen for a frame."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import CalibrationConfig
from rsoconsole.errors import FrameError
from rsoconsole.instruments.frames import camera_mode, exposure_s, read_frame, sensor_temperature_c
from rsoconsole.records import Frame, PixelArray
from rsoconsole.vision.frame import has_mosaic

SAME_EXPOSURE, SAME_EXPOSURE_S = 0.02, 0.002
"""Two exposures are the same within this share, or these seconds."""
SAME_TEMPERATURE_C = 2.0
"""Degrees in which a sensor's dark current grows by a quarter."""
SETTINGS = ("GAIN", "OFFSET", "READOUTM", "ROWORDER")
"""Keywords whose values a master and a frame have in common where both tell them."""
MOST_NONFINITE = 0.2
"""Of a master's pixels: fewer that are NaN or infinite count as the median about them."""
_SAMPLE = 5
_PLAIN = "1x1"
"""Binning of what says none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Traits:
    """What decides whether a master belongs to a frame."""

    width_px: int
    height_px: int
    exposure_s: float | None
    temperature_c: float | None
    has_mosaic: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)
    """Of ``SETTINGS`` those that its header tells."""
    binning: str | None = None
    """As 2x2, where the header tells it."""
    corner_px: tuple[int, int] | None = None
    """Column and row of the sensor's joined pixels where a part of it begins."""

    @property
    def size_words(self) -> str:
        """Width by height."""
        return f"{self.width_px} x {self.height_px} px"

    def has_size_of(self, other: "Traits") -> bool:
        """Whether both are of as many columns and rows."""
        return (self.width_px, self.height_px) == (other.width_px, other.height_px)

    def has_pixels_of(self, other: "Traits") -> bool:
        """Whether it is of the same size, or of the whole sensor of which the other is a part."""
        if self.has_size_of(other):
            return True
        if other.corner_px is None or self.corner_px not in (None, (0, 0)):
            return False
        x0, y0 = other.corner_px
        return (
            (self.binning or _PLAIN) == (other.binning or _PLAIN)
            and x0 + other.width_px <= self.width_px
            and y0 + other.height_px <= self.height_px
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Master:
    """A master frame, without its pixels."""

    setting: str
    """"darks", "flat" or "bias"."""
    path: Path
    traits: Traits
    level_adu: float
    """Median."""

    @property
    def words(self) -> str:
        """Its name with all that counts, e.g. ``dark.fits (10 s, -10 °C, 640 x 480 px)``."""
        traits = list(_exposure_and_temperature(self.traits)) if self.setting == "darks" else []
        return f"{self.path.name} ({', '.join([*traits, self.traits.size_words])})"


def _exposure_and_temperature(traits: Traits) -> Iterable[str]:
    """Those of the two that are known, in words."""
    if traits.exposure_s is not None:
        yield f"{traits.exposure_s:g} s"
    if traits.temperature_c is not None:
        yield f"{traits.temperature_c:.0f} °C"


def traits_of(frame: Frame) -> Traits:
    """Of a frame, or of a master that was read as one."""
    mode = camera_mode(frame.header)
    has_corner = mode.x0_px is not None and mode.y0_px is not None
    return Traits(
        binning=mode.binning,
        corner_px=(mode.x0_px or 0, mode.y0_px or 0) if has_corner else None,
        width_px=frame.width_px,
        height_px=frame.height_px,
        exposure_s=frame.exposure_s or exposure_s(frame.header),
        temperature_c=sensor_temperature_c(frame.header),
        has_mosaic=has_mosaic(frame.header),
        settings={
            key: _plain(frame.header[key])
            for key in SETTINGS
            if frame.header.get(key) not in (None, "")
        },
    )


def _plain(value: Any) -> str:
    """One spelling for ``139``, ``139.0`` and ``"139"``."""
    try:
        return f"{float(value):g}"
    except (TypeError, ValueError):
        return str(value).strip().upper()


def read_pixels(path: Path) -> PixelArray:
    """Pixels of a master, (height, width) ADU, all finite. Raises FrameError."""
    return _read(path).pixels


def _read(path: Path) -> Frame:
    return read_frame(path, 0, max_nonfinite_fraction=MOST_NONFINITE)


def read_master(setting: str, path: Path) -> Master:
    """What a master is. Raises FrameError where it cannot be used as what ``setting`` says."""
    frame = _read(path)
    level_adu = float(np.median(frame.pixels[::_SAMPLE, ::_SAMPLE]))
    if setting == "flat" and level_adu <= 0.0:
        raise FrameError(f"{path} has no light in it (median {level_adu:g} ADU): give a flat")
    return Master(setting=setting, path=path, traits=traits_of(frame), level_adu=level_adu)


def read_masters(settings: CalibrationConfig) -> tuple[tuple[Master, ...], tuple[str, ...]]:
    """The configured masters that can be used, and what is wrong with each of the others."""
    masters: list[Master] = []
    faults: list[str] = []
    for setting, path in settings.files:
        try:
            masters.append(read_master(setting, path))
        except FrameError as error:
            faults.append(f"calibration.{setting}: {error}")
    return tuple(masters), tuple(faults)


def is_same_exposure(one_s: float | None, other_s: float | None) -> bool:
    """Whether a dark of one is a dark of the other; False where either is not known."""
    if one_s is None or other_s is None:
        return False
    return abs(one_s - other_s) <= max(SAME_EXPOSURE * max(one_s, other_s), SAME_EXPOSURE_S)


def is_same_temperature(one_c: float | None, other_c: float | None) -> bool:
    """The same of temperatures; True where either is not known."""
    return one_c is None or other_c is None or abs(one_c - other_c) <= SAME_TEMPERATURE_C


def nearest_dark(masters: Iterable[Master], wanted: Traits) -> Master | None:
    """The dark of the frame's size whose exposure, then temperature, is nearest to the frame's."""

    def apart(dark: Master) -> tuple[float, float]:
        return (
            _exposures_apart(dark.traits.exposure_s, wanted.exposure_s),
            _degrees_apart(dark.traits.temperature_c, wanted.temperature_c),
        )

    fitting = [
        each for each in masters if each.setting == "darks" and each.traits.has_pixels_of(wanted)
    ]
    return min(fitting, key=apart, default=None)


def _exposures_apart(one_s: float | None, other_s: float | None) -> float:
    if one_s is None or other_s is None:
        return math.inf
    return 0.0 if is_same_exposure(one_s, other_s) else abs(math.log(one_s / other_s))


def _degrees_apart(one_c: float | None, other_c: float | None) -> float:
    return math.inf if one_c is None or other_c is None else abs(one_c - other_c)
