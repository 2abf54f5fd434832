"""Calibration of a frame before detection: dark, flat, then the mosaic.

``process``, ``detect``, ``solve``, the engine and every replay prepare their frames here. Without
configured masters a frame stays as the camera gave it, at no cost.
"""

import contextlib
import math
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.base import FrameError
from rsoconsole.config import CalibrationConfig, Config
from rsoconsole.instruments import camera_mode, exposure_s, read_frame, sensor_temperature_c
from rsoconsole.pipeline.frame.frame_cautions import Caution
from rsoconsole.records import Frame, PixelArray
from rsoconsole.vision import DarkAndFlat, Workers, has_mosaic, threads_for, without_mosaic
from rsoconsole.words import TAKE_DARK

SAME_EXPOSURE, SAME_EXPOSURE_S = 0.02, 0.002
"""Fraction, and seconds, by which two exposures may differ and count as the same."""
SAME_TEMPERATURE_C = 2.0
"""Largest difference of like temperatures: a sensor's dark current grows by a quarter in it."""
SETTINGS = ("GAIN", "OFFSET", "READOUTM", "ROWORDER")
"""Header keywords whose values must agree between master and frame where both have them."""
MAX_NONFINITE = 0.2
"""Largest share of NaN or infinite pixels in a master, which count as the median about them."""
_SAMPLE = 5
_PLAIN = "1x1"


@dataclass(frozen=True, slots=True, kw_only=True)
class MasterTraits:
    """Traits that decide whether a master fits a frame; None for what the header did not state."""

    width_px: int
    height_px: int
    exposure_s: float | None
    temperature_c: float | None
    has_mosaic: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)
    binning: str | None = None
    corner_px: tuple[int, int] | None = None
    """Column and row, in binned pixels of the whole sensor, at which the image begins."""

    @property
    def size_words(self) -> str:
        """Width by height, as text for messages."""
        return f"{self.width_px} x {self.height_px} px"

    def has_size_of(self, other: "MasterTraits") -> bool:
        """True where both have the same number of columns and rows."""
        return (self.width_px, self.height_px) == (other.width_px, other.height_px)

    def covers_pixels_of(self, other: "MasterTraits") -> bool:
        """True where this master has a pixel for each pixel of ``other``.

        Both have the same size, or the master is the whole sensor and ``other`` a part of it.
        """
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
    """Master frame, without its pixels."""

    setting: str
    """Setting that names it: "darks", "flat" or "bias"."""
    path: Path
    traits: MasterTraits
    level_adu: float

    @property
    def words(self) -> str:
        """Name with exposure, temperature and size: ``dark.fits (10 s, -10 °C, 640 x 480 px)``."""
        traits = list(_exposure_and_temperature(self.traits)) if self.setting == "darks" else []
        return f"{self.path.name} ({', '.join([*traits, self.traits.size_words])})"


def _exposure_and_temperature(traits: MasterTraits) -> Iterable[str]:
    """Yield exposure and temperature in words, where they are known."""
    if traits.exposure_s is not None:
        yield f"{traits.exposure_s:g} s"
    if traits.temperature_c is not None:
        yield f"{traits.temperature_c:.0f} °C"


def traits_of(frame: Frame) -> MasterTraits:
    """Return the traits of a frame, or of a master that was read as one."""
    mode = camera_mode(frame.header)
    has_corner = mode.x0_px is not None and mode.y0_px is not None
    return MasterTraits(
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
    """Return one spelling for ``139``, ``139.0`` and ``"139"``."""
    try:
        return f"{float(value):g}"
    except (TypeError, ValueError):
        return str(value).strip().upper()


def read_master_pixels(path: Path) -> PixelArray:
    """Return the pixels of a master, (height, width) ADU, all finite. Raises FrameError."""
    return _read(path).pixels


def _read(path: Path) -> Frame:
    return read_frame(path, 0, max_nonfinite_fraction=MAX_NONFINITE)


def read_master(setting: str, path: Path) -> Master:
    """Read a master frame. Raises FrameError where it cannot be used as ``setting``."""
    frame = _read(path)
    level_adu = float(np.median(frame.pixels[::_SAMPLE, ::_SAMPLE]))
    if setting == "flat" and level_adu <= 0.0:
        raise FrameError(f"{path} has no light in it (median {level_adu:g} ADU): give a flat")
    return Master(setting=setting, path=path, traits=traits_of(frame), level_adu=level_adu)


def read_masters(settings: CalibrationConfig) -> tuple[tuple[Master, ...], tuple[str, ...]]:
    """Read the configured masters; return (usable masters, a message for each of the others)."""
    masters: list[Master] = []
    faults: list[str] = []
    for setting, path in settings.master_files:
        try:
            masters.append(read_master(setting, path))
        except FrameError as error:
            faults.append(f"calibration.{setting}: {error}")
    return tuple(masters), tuple(faults)


def is_same_exposure(one_s: float | None, other_s: float | None) -> bool:
    """True where a dark of one exposure fits a frame of the other; False where either is None."""
    if one_s is None or other_s is None:
        return False
    return abs(one_s - other_s) <= max(SAME_EXPOSURE * max(one_s, other_s), SAME_EXPOSURE_S)


def nearest_dark(masters: Iterable[Master], wanted: MasterTraits) -> Master | None:
    """Return the dark whose exposure, then temperature, is nearest to the frame's.

    ``wanted``: the frame's traits. None where no dark has all the frame's pixels.
    """

    def apart(dark: Master) -> tuple[float, float]:
        dark_s, frame_s = dark.traits.exposure_s, wanted.exposure_s
        dark_c, frame_c = dark.traits.temperature_c, wanted.temperature_c
        by_s = 0.0 if is_same_exposure(dark_s, frame_s) else math.inf
        if by_s and dark_s is not None and frame_s is not None:
            by_s = abs(math.log(dark_s / frame_s))
        return by_s, math.inf if dark_c is None or frame_c is None else abs(dark_c - frame_c)

    fitting = [
        each for each in masters if each.setting == "darks" and each.traits.covers_pixels_of(wanted)
    ]
    return min(fitting, key=apart, default=None)


_MAX_PREPARED = 2
"""Most pairs of masters that are held ready: each takes 6 bytes a pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choice:
    """Masters chosen for a frame."""

    dark: Path | None
    bias: Path | None
    """Bias; None where the dark is used unscaled."""
    dark_scale: float
    """Factor on the dark's excess over the bias."""
    flat: Path | None
    has_mosaic: bool
    window: tuple[int, int, int, int] | None = None
    """Part of the masters that the frame shows: x0, y0, width, height; None: all of it."""


class Calibration:
    """Calibrates frames with the configured masters, read for the first frame. For one thread."""

    def __init__(self, config: Config) -> None:
        self._settings: CalibrationConfig = config.calibration
        self._threads = config.detector.threads
        self._prepared: OrderedDict[_Choice, DarkAndFlat] = OrderedDict()

    def has_masters_of(self, config: Config) -> bool:
        """True where ``config`` names the same masters."""
        return config.calibration == self._settings

    @cached_property
    def _masters(self) -> tuple[tuple[Master, ...], tuple[str, ...]]:
        return read_masters(self._settings)

    @cached_property
    def _workers(self) -> Workers:
        return Workers(threads_for(self._threads))

    def make_ready(self, config: Config) -> None:
        """Read the masters, and prepare those for frames of the configured exposure and size."""
        if not self._settings.master_files:
            return
        masters = self._masters[0]
        usual = MasterTraits(
            width_px=config.optics.width_px,
            height_px=config.optics.height_px,
            exposure_s=config.exposure.exposure_s,
            temperature_c=None,
            has_mosaic=any(each.traits.has_mosaic for each in masters),
        )
        choice = self._choice(usual)
        if choice is not None:
            # What fails here is told with the first frame, which fails alike.
            with contextlib.suppress(FrameError, ValueError):
                self._ready(choice)

    def prepare(self, frame: Frame) -> tuple[Frame, tuple[Caution, ...]]:
        """Return the frame calibrated, its colour mosaic evened out, and cautions about masters.

        A frame that fits no master is used as it is, and a caution says so.
        """
        if not self._settings.master_files:
            return without_mosaic(frame), ()
        calibrated, cautions = self._calibrated(frame)
        return without_mosaic(calibrated), cautions

    def _calibrated(self, frame: Frame) -> tuple[Frame, tuple[Caution, ...]]:
        masters, faults = self._masters
        cautions = [Caution(kind=words, words=f"{words}; frames go without it") for words in faults]
        wanted = traits_of(frame)
        choice = self._choice(wanted)
        cautions += _not_used(masters, wanted, choice)
        if choice is None:
            return frame, tuple(cautions)
        try:
            ready = self._ready(choice)
            calibrated = ready.calibrated_frame(frame, self._workers)
        except (FrameError, ValueError) as error:
            words = f"the masters cannot be used: {error}; frames go without them"
            return frame, (*cautions, Caution(kind="calibration", words=words))
        used = [each for each in masters if each.path in (choice.dark, choice.bias, choice.flat)]
        cautions += _mismatches(used, wanted, choice)
        cautions.append(_in_force(used, choice, ready.defect_count(frame.saturation_adu)))
        return calibrated, tuple(cautions)

    def _choice(self, wanted: MasterTraits) -> _Choice | None:
        """Choose the masters for a frame; None where neither a dark nor a bias has its size."""
        masters = self._masters[0]
        fitting = [each for each in masters if each.traits.covers_pixels_of(wanted)]
        dark = nearest_dark(fitting, wanted)
        bias = next((each for each in fitting if each.setting == "bias"), None)
        flat = next((each for each in fitting if each.setting == "flat"), None)
        if dark is None and bias is None:
            return None
        scale = 1.0
        dark_s = None if dark is None else dark.traits.exposure_s
        frame_s = wanted.exposure_s
        if bias is not None and dark_s is not None and frame_s is not None:
            scale = 1.0 if is_same_exposure(dark_s, frame_s) else frame_s / dark_s
        is_scaled = dark is None or scale != 1.0
        return _Choice(
            dark=None if dark is None else dark.path,
            bias=bias.path if bias is not None and is_scaled else None,
            dark_scale=scale,
            flat=None if flat is None else flat.path,
            has_mosaic=wanted.has_mosaic,
            window=_window_of(wanted, [each for each in (dark, bias, flat) if each is not None]),
        )

    def _ready(self, choice: _Choice) -> DarkAndFlat:
        """Prepared masters of a choice. Raises FrameError or ValueError where a file changed."""
        ready = self._prepared.pop(choice, None)
        if ready is None:
            while len(self._prepared) >= _MAX_PREPARED:
                self._prepared.popitem(last=False)
            flat = None if choice.flat is None else _pixels_of(choice.flat, choice)
            ready = DarkAndFlat(_dark_pixels(choice), flat, has_mosaic=choice.has_mosaic)
        self._prepared[choice] = ready
        return ready


def _window_of(wanted: MasterTraits, chosen: list[Master]) -> tuple[int, int, int, int] | None:
    """Return the frame's part of the masters' pixels; None where all have the frame's size."""
    if wanted.corner_px is None or all(each.traits.has_size_of(wanted) for each in chosen):
        return None
    return (*wanted.corner_px, wanted.width_px, wanted.height_px)


def _pixels_of(path: Path, choice: _Choice) -> PixelArray:
    """Return a master's pixels, cut to the frame's part where it shows more."""
    pixels = read_master_pixels(path)
    if choice.window is None:
        return pixels
    x0, y0, width, height = choice.window
    return pixels if pixels.shape == (height, width) else pixels[y0 : y0 + height, x0 : x0 + width]


def _dark_pixels(choice: _Choice) -> PixelArray:
    """Return the pixels without light, ADU."""
    if choice.bias is None:
        assert choice.dark is not None
        return _pixels_of(choice.dark, choice)
    bias = _pixels_of(choice.bias, choice)
    if choice.dark is None:
        return bias
    pixels = _pixels_of(choice.dark, choice).astype(np.float32)
    if pixels.shape != bias.shape:
        raise ValueError("dark and bias are of different sizes")
    pixels -= bias
    pixels *= np.float32(choice.dark_scale)
    pixels += bias
    return pixels


def _not_used(
    masters: tuple[Master, ...], wanted: MasterTraits, choice: _Choice | None
) -> Iterator[Caution]:
    """Yield cautions for masters that all have another size, and a flat without dark or bias."""
    for setting in ("darks", "bias", "flat"):
        there = [each for each in masters if each.setting == setting]
        if not there or any(each.traits.covers_pixels_of(wanted) for each in there):
            continue
        names = ", ".join(each.words for each in there)
        words = (
            f"calibration.{setting}: {names} does not fit a frame of {wanted.size_words} (binning"
            " or region of interest): it goes without; give a master of that size"
        )
        yield Caution(kind=f"calibration.{setting} size", words=words)
    flat = [each for each in masters if each.setting == "flat"]
    if choice is None and any(each.traits.covers_pixels_of(wanted) for each in flat):
        words = (
            "calibration.flat is not used: without a dark or bias of its size it would divide the"
            " camera's offset too"
        )
        yield Caution(kind="calibration.flat alone", words=words)


def _mismatches(used: list[Master], wanted: MasterTraits, choice: _Choice) -> Iterator[Caution]:
    """Yield cautions for each trait in which the chosen masters differ from the frame."""
    for each in used:
        own, name = each.traits, each.path.name
        if each.setting == "darks" and choice.dark_scale == 1.0:
            yield from _exposure_mismatch(name, own, wanted)
        own_c = own.temperature_c if each.setting == "darks" else None
        frame_c = wanted.temperature_c
        apart_c = 0.0 if own_c is None or frame_c is None else abs(own_c - frame_c)
        if apart_c > SAME_TEMPERATURE_C:
            words = (
                f"{name} was taken at {own_c:.0f} °C, the frame at"
                f" {frame_c:.0f} °C: hot pixels are left or overdone; give a dark of"
                " that temperature"
            )
            yield Caution(kind="calibration temperature", words=words)
        for key, value in own.settings.items():
            frames = wanted.settings.get(key, value)
            # A flat's level is of no account: only how its pixels lie matters.
            if frames != value and (each.setting != "flat" or key == "ROWORDER"):
                words = f"{name} was taken with {key} {value}, the frame with {frames}"
                yield Caution(
                    kind=f"calibration {key}", words=f"{words}: give a master of the same"
                )


def _exposure_mismatch(name: str, own: MasterTraits, wanted: MasterTraits) -> Iterator[Caution]:
    if is_same_exposure(own.exposure_s, wanted.exposure_s):
        return
    dark_s, frame_s = (
        "an exposure that is not known" if s is None else f"{s:g} s"
        for s in (own.exposure_s, wanted.exposure_s)
    )
    words = (
        f"{name} is of {dark_s}, the frame of {frame_s}: it is taken away as it is;"
        f" {TAKE_DARK}, or set calibration.bias"
    )
    yield Caution(kind="calibration exposure", words=words)


def _in_force(used: list[Master], choice: _Choice, defects: int) -> Caution:
    """Return the caution that names the masters used for a frame."""
    names = ", ".join(f"{each.setting.removesuffix('s')} {each.words}" for each in used)
    if choice.dark_scale != 1.0:
        names += f"; dark current times {choice.dark_scale:.3g}"
    if defects:
        names += f"; {defects} pixels filled from their neighbours"
    return Caution(kind=f"calibration {names}", words=f"calibrated with {names}", level="info")
