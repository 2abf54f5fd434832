"""The frame as everything that looks for something sees it: dark, flat, then the mosaic.

``process``, ``detect``, ``solve``, the engine and every replay prepare their frames here. Without
configured masters a frame is what the camera gave, and nothing is spent.
"""

import contextlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from rsoconsole.config import CalibrationConfig, Config
from rsoconsole.errors import FrameError
from rsoconsole.pipeline.frame.frame_cautions import Caution
from rsoconsole.pipeline.frame.master_frames import (
    Master,
    Traits,
    is_same_exposure,
    is_same_temperature,
    nearest_dark,
    read_masters,
    read_pixels,
    traits_of,
)
from rsoconsole.records import Frame, PixelArray
from rsoconsole.vision.frame import DarkAndFlat, Workers, evened, threads_for
from rsoconsole.words import TAKE_DARK

_MOST_PREPARED = 2
"""A pair of masters takes 6 bytes a pixel: no more of them are held ready."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choice:
    """Which masters a frame gets."""

    dark: Path | None
    bias: Path | None
    """None where the dark is used as it is."""
    dark_scale: float
    """Of what the dark has above the bias."""
    flat: Path | None
    has_mosaic: bool
    window: tuple[int, int, int, int] | None = None
    """Of a frame that may be a part of what the masters show: x0, y0, width, height."""


class Calibration:
    """The configured masters, read when the first frame comes. For one thread."""

    def __init__(self, config: Config) -> None:
        self._settings: CalibrationConfig = config.calibration
        self._threads = config.detector.threads
        self._prepared: OrderedDict[_Choice, DarkAndFlat] = OrderedDict()

    def is_for(self, config: Config) -> bool:
        """Whether another configuration has the same masters."""
        return config.calibration == self._settings

    @cached_property
    def _masters(self) -> tuple[tuple[Master, ...], tuple[str, ...]]:
        return read_masters(self._settings)

    @cached_property
    def _workers(self) -> Workers:
        return Workers(threads_for(self._threads))

    def make_ready(self, config: Config) -> None:
        """Read and prepare now what the configured exposures will want."""
        if not self._settings.files:
            return
        masters = self._masters[0]
        usual = Traits(
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
        """The frame calibrated and with its mosaic evened out, and what is to be said of that.

        A frame that no master fits is used as it is, and a caution says so.
        """
        if not self._settings.files:
            return evened(frame), ()
        calibrated, cautions = self._calibrated(frame)
        return evened(calibrated), cautions

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
            calibrated = ready.applied(frame, self._workers)
        except (FrameError, ValueError) as error:
            words = f"the masters cannot be used: {error}; frames go without them"
            return frame, (*cautions, Caution(kind="calibration", words=words))
        used = [each for each in masters if each.path in (choice.dark, choice.bias, choice.flat)]
        cautions += _mismatches(used, wanted, choice)
        cautions.append(_in_force(used, choice, ready.defects(frame.saturation_adu)))
        return calibrated, tuple(cautions)

    def _choice(self, wanted: Traits) -> _Choice | None:
        """None where there is neither a dark nor a bias of the frame's size."""
        masters = self._masters[0]
        fitting = [each for each in masters if each.traits.has_pixels_of(wanted)]
        dark = nearest_dark(fitting, wanted)
        bias = next((each for each in fitting if each.setting == "bias"), None)
        flat = next((each for each in fitting if each.setting == "flat"), None)
        if dark is None and bias is None:
            return None
        scale = 1.0
        if dark is not None and bias is not None:
            scale = _dark_scale(dark.traits.exposure_s, wanted.exposure_s)
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
        """Raises FrameError or ValueError where a file is no more what it was."""
        ready = self._prepared.pop(choice, None)
        if ready is None:
            while len(self._prepared) >= _MOST_PREPARED:
                self._prepared.popitem(last=False)
            flat = None if choice.flat is None else _pixels_of(choice.flat, choice)
            ready = DarkAndFlat(_dark_pixels(choice), flat, has_mosaic=choice.has_mosaic)
        self._prepared[choice] = ready
        return ready


def _dark_scale(dark_s: float | None, frame_s: float | None) -> float:
    if dark_s is None or frame_s is None or is_same_exposure(dark_s, frame_s):
        return 1.0
    return frame_s / dark_s


def _window_of(wanted: Traits, chosen: list[Master]) -> tuple[int, int, int, int] | None:
    """Of a frame of which a master shows more; None: all are of its size."""
    if wanted.corner_px is None or all(each.traits.has_size_of(wanted) for each in chosen):
        return None
    return (*wanted.corner_px, wanted.width_px, wanted.height_px)


def _pixels_of(path: Path, choice: _Choice) -> PixelArray:
    """A master's pixels, of these the frame's part where it shows more."""
    pixels = read_pixels(path)
    if choice.window is None:
        return pixels
    x0, y0, width, height = choice.window
    return pixels if pixels.shape == (height, width) else pixels[y0 : y0 + height, x0 : x0 + width]


def _dark_pixels(choice: _Choice) -> PixelArray:
    """What the camera gives without light, ADU."""
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
    masters: tuple[Master, ...], wanted: Traits, choice: _Choice | None
) -> Iterator[Caution]:
    """Kinds of which no master has the frame's size, and a flat that would stand alone."""
    for setting in ("darks", "bias", "flat"):
        there = [each for each in masters if each.setting == setting]
        if not there or any(each.traits.has_pixels_of(wanted) for each in there):
            continue
        names = ", ".join(each.words for each in there)
        words = (
            f"calibration.{setting}: {names} does not fit a frame of {wanted.size_words} (binning"
            " or region of interest): it goes without; give a master of that size"
        )
        yield Caution(kind=f"calibration.{setting} size", words=words)
    flat = [each for each in masters if each.setting == "flat"]
    if choice is None and any(each.traits.has_pixels_of(wanted) for each in flat):
        words = (
            "calibration.flat is not used: without a dark or bias of its size it would divide the"
            " camera's offset too"
        )
        yield Caution(kind="calibration.flat alone", words=words)


def _mismatches(used: list[Master], wanted: Traits, choice: _Choice) -> Iterator[Caution]:
    """In what the chosen masters differ from the frame."""
    for each in used:
        own, name = each.traits, each.path.name
        if each.setting == "darks" and choice.dark_scale == 1.0:
            yield from _exposure_mismatch(name, own, wanted)
        if each.setting == "darks" and not is_same_temperature(
            own.temperature_c, wanted.temperature_c
        ):
            words = (
                f"{name} was taken at {own.temperature_c:.0f} °C, the frame at"
                f" {wanted.temperature_c:.0f} °C: hot pixels are left or overdone; give a dark of"
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


def _exposure_mismatch(name: str, own: Traits, wanted: Traits) -> Iterator[Caution]:
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
    """Which masters a frame was calibrated with."""
    names = ", ".join(f"{each.setting.removesuffix('s')} {each.words}" for each in used)
    if choice.dark_scale != 1.0:
        names += f"; dark current times {choice.dark_scale:.3g}"
    if defects:
        names += f"; {defects} pixels filled from their neighbours"
    return Caution(kind=f"calibration {names}", words=f"calibrated with {names}", level="info")
