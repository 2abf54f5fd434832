"""SatSim's frames, altered with NumPy and OpenCV alone as ordinary nights alter them.

Convolved, striped, binned or dimmed, then given the noise that a sensor would have added. Nothing
of the product's renderer is in it.
"""

import json
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from rsoconsole.instruments import read_frame
from rsoconsole.records import Frame

FRAMES = Path(__file__).resolve().parents[3] / "shared" / "data" / "simulated"
EXPOSURE_S = 10.0
_HALF_PX = (900, 700)
_SEED = 41
_SEQUENCES = ("geo_single", "geo_pair_dim")
_GRAIN_PX = 64
_REACH_PX = 5.0
_STEPS = 2000

Image: TypeAlias = npt.NDArray[np.float32]
Rng: TypeAlias = np.random.Generator
Ends: TypeAlias = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """A part of a frame with its satellites."""

    name: str
    pixels: Image
    noise: float
    """ADU, one pixel's."""
    scale_arcsec_px: float
    fwhm_px: float
    streaks: tuple[Ends, ...]
    """The one in the middle first."""
    snr: float
    """Of the one in the middle, integrated."""


Alter: TypeAlias = Callable[[Look, float, Rng], tuple[Image, float]]
"""The altered image, and how many of its pixels along one of the original's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One kind of alteration."""

    title: str
    low: float
    high: float
    alter: Alter


def _noise_of(pixels: Image) -> float:
    """One pixel's noise, from differences of neighbours that no star's slope makes larger."""
    steps = np.abs(np.diff(pixels, axis=1)).ravel()
    return float(np.median(steps) / 0.6745 / math.sqrt(2.0))


def _convolved(look: Look, kernel: npt.NDArray[Any], rng: Rng) -> Image:
    kernel = (kernel / kernel.sum()).astype(np.float32)
    out = cv2.filter2D(look.pixels, -1, kernel, borderType=cv2.BORDER_REFLECT)
    left = look.noise * math.sqrt(float((kernel**2).sum()))
    fresh = math.sqrt(max(look.noise**2 - left**2, 0.0))
    return np.asarray(out + rng.normal(0.0, fresh, out.shape), dtype=np.float32)


def _along(x: npt.NDArray[Any], y: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Kernel of an image that goes along a path, px."""
    x, y = x - x.mean(), y - y.mean()
    reach = math.ceil(float(max(np.abs(x).max(), np.abs(y).max()))) + 3
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    np.add.at(kernel, (np.rint(y).astype(int) + reach, np.rint(x).astype(int) + reach), 1.0)
    return np.asarray(cv2.GaussianBlur(kernel, (0, 0), 0.4))


def plain(look: Look, _severity: float, _rng: Rng) -> tuple[Image, float]:
    return look.pixels, 1.0


def blurred(look: Look, sigma_px: float, rng: Rng) -> tuple[Image, float]:
    if sigma_px < 0.3:
        return look.pixels, 1.0
    across = cv2.getGaussianKernel(2 * math.ceil(4 * sigma_px) + 1, sigma_px)
    return _convolved(look, across @ across.T, rng), 1.0


def ringed(look: Look, radius_px: float, rng: Rng) -> tuple[Image, float]:
    """A disc with a central obstruction of a third to a half."""
    reach = math.ceil(radius_px) + 1
    y, x = np.mgrid[-reach : reach : 1j * (8 * reach + 1), -reach : reach : 1j * (8 * reach + 1)]
    far = np.hypot(x, y)
    disc = ((far < radius_px) & (far > rng.uniform(0.33, 0.5) * radius_px)).astype(np.float32)
    small = cv2.resize(disc, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return _convolved(look, cv2.GaussianBlur(small, (0, 0), 0.6), rng), 1.0


Path_px: TypeAlias = tuple[npt.NDArray[Any], npt.NDArray[Any]]


def _level_of(image: Image) -> Image:
    """The sky without stars and streaks, smooth."""
    level = cv2.medianBlur(np.clip(image, 0, 65535).astype(np.uint16), 5).astype(np.float32)
    return np.asarray(cv2.blur(level, (_GRAIN_PX, _GRAIN_PX)))


def _about(look: Look, ends: Ends) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The pixels of a streak, and how far along it they are (0 to 1)."""
    height, width = look.pixels.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    u, v = (x - x_a) * dx + (y - y_a) * dy, (y - y_a) * dx - (x - x_a) * dy
    is_on = (np.abs(v) < _REACH_PX) & (u > -_REACH_PX) & (u < length + _REACH_PX)
    return is_on, u[is_on] / length


def _line_of_light(
    shape: tuple[int, ...], ends: Ends, path: Path_px, fwhm_px: float, peak: float
) -> Image:
    """What moves evenly from end to end while the image moves along a path; ``peak``: of its ridge,
    were the image at rest."""
    t = np.linspace(0.0, 1.0, path[0].size)
    x = ends[0] + (ends[2] - ends[0]) * t + path[0] - path[0].mean()
    y = ends[1] + (ends[3] - ends[1]) * t + path[1] - path[1].mean()
    image = np.zeros(shape, dtype=np.float32)
    length, sigma = math.hypot(ends[2] - ends[0], ends[3] - ends[1]), fwhm_px / 2.3548
    each = peak * math.sqrt(2.0 * math.pi) * sigma * length / t.size
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - right - (x - column)) * np.abs(1 - down - (y - row))
            inside = (row + down >= 0) & (row + down < shape[0])
            inside &= (column + right >= 0) & (column + right < shape[1])
            np.add.at(image, (row[inside] + down, column[inside] + right), (each * share)[inside])
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), dtype=np.float32)


def _moved(look: Look, path: Path_px, rng: Rng) -> Image:
    """The mount moves: stars are drawn along its path, a satellite along the sum of both ways."""
    level = _level_of(look.pixels)
    stars, lines = look.pixels.copy(), np.zeros_like(look.pixels)
    for ends in look.streaks:
        is_on, _ = _about(look, ends)
        light = float((look.pixels[is_on] - level[is_on]).sum())
        length = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
        peak = light / length / (math.sqrt(2.0 * math.pi) * look.fwhm_px / 2.3548)
        lines += _line_of_light(stars.shape, ends, path, look.fwhm_px, peak)
        stars[is_on] = level[is_on] + rng.normal(0.0, look.noise, int(is_on.sum()))
    drawn_out = replace(look, pixels=stars)
    return np.asarray(_convolved(drawn_out, _along(*path), rng) + lines, dtype=np.float32)


def _straight(length_px: float, rng: Rng) -> Path_px:
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    at = np.linspace(-0.5, 0.5, _STEPS) * length_px
    return at * math.cos(angle), at * math.sin(angle)


def _walk(rms_px: float, rng: Rng) -> Path_px:
    """Wind: a random walk that is drawn back within half a second."""
    kept, path = math.exp(-EXPOSURE_S / _STEPS / 0.5), [rng.normal(0.0, 1.0, 2)]
    for _ in range(_STEPS - 1):
        path.append(kept * path[-1] + math.sqrt(1 - kept**2) * rng.normal(0.0, 1.0, 2))
    x, y = rms_px * np.array(path).T
    return x, y


def drifted(look: Look, length_px: float, rng: Rng) -> tuple[Image, float]:
    return _moved(look, _straight(length_px, rng), rng), 1.0


def windy(look: Look, rms_px: float, rng: Rng) -> tuple[Image, float]:
    return _moved(look, _walk(rms_px, rng), rng), 1.0


_PATHS: dict[str, Callable[[float, Rng], Path_px]] = {"drift": _straight, "wind": _walk}


def _carried(ends: Ends, path: Path_px) -> Ends:
    """Ends of the straight line that a satellite's way is on average, the image's counted."""
    t = np.linspace(-1.0, 1.0, path[0].size)
    (dx, _), (dy, _) = (np.polyfit(t, each - each.mean(), 1) for each in path)
    return ends[0] - dx, ends[1] - dy, ends[2] + dx, ends[3] + dy


def vibrating(look: Look, length_px: float, rng: Rng) -> tuple[Image, float]:
    """Along a line, faster than the satellite moves its own width: it is drawn out as the stars."""
    return _convolved(look, _along(*_straight(length_px, rng)), rng), 1.0


def striped(look: Look, sigma: float, rng: Rng) -> tuple[Image, float]:
    rows = rng.normal(0.0, sigma * look.noise, (look.pixels.shape[0], 1))
    columns = rng.normal(0.0, 0.5 * sigma * look.noise, (1, look.pixels.shape[1]))
    return (look.pixels + rows + columns).astype(np.float32), 1.0


def modulated(look: Look, periods: float, rng: Rng) -> tuple[Image, float]:
    """The satellites' light, cut out above the sky, comes and goes as a cosine."""
    out, level = look.pixels.copy(), _level_of(look.pixels)
    depth, phase = float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.0, 2.0 * math.pi))
    for ends in look.streaks:
        is_on, along = _about(look, ends)
        times = 1.0 + depth * np.cos(2.0 * math.pi * periods * along + phase)
        light = out[is_on] - level[is_on]
        # Where its light is dimmed so is the noise that is in the image: it comes back.
        fresh = look.noise * np.sqrt(np.maximum(1.0 - times**2, 0.0))
        out[is_on] = level[is_on] + times * light + fresh * rng.normal(0.0, 1.0, light.size)
    return out, 1.0


def binned(look: Look, severity: float, _rng: Rng) -> tuple[Image, float]:
    n = 2 if severity < 3.0 else 4
    height, width = (side // n * n for side in look.pixels.shape)
    parts = look.pixels[:height, :width].reshape(height // n, n, width // n, n)
    return parts.mean(axis=(1, 3), dtype=np.float32), 1.0 / n


def coarse(look: Look, sigma_a_step: float, _rng: Rng) -> tuple[Image, float]:
    """8 bits, so many steps in one sigma of the noise."""
    level = float(np.median(look.pixels))
    scaled = (look.pixels - level) / look.noise * sigma_a_step + 20.0
    return np.clip(np.rint(scaled), 0, 255).astype(np.float32), 1.0


def of_bayer(look: Look, strength: float, rng: Rng) -> tuple[Image, float]:
    """A colour camera's mosaic: its filters let more or less through, sky and all."""
    level = float(np.median(look.pixels))
    out = look.pixels.copy()
    for row in (0, 1):
        for column in (0, 1):
            out[row::2, column::2] *= 1.0 + strength * float(rng.uniform(-0.5, 0.5))
    return np.clip(out, 0.2 * level, 65535.0), 1.0


def glowing(look: Look, sigmas: float, rng: Rng) -> tuple[Image, float]:
    height, width = look.pixels.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    corner = (float(rng.choice([0, width])), float(rng.choice([0, height])))
    far = np.hypot(x - corner[0], y - corner[1])
    light = sigmas * look.noise * np.exp(-far / (0.2 * width))
    return (look.pixels + light).astype(np.float32), 1.0


def graded(look: Look, share: float, rng: Rng) -> tuple[Image, float]:
    height, width = look.pixels.shape
    angle, level = float(rng.uniform(0, 2 * math.pi)), float(np.median(look.pixels))
    y, x = np.mgrid[-0.5 : 0.5 : 1j * height, -0.5 : 0.5 : 1j * width].astype(np.float32)
    slope = share * level * (x * math.cos(angle) + y * math.sin(angle))
    return (look.pixels + slope).astype(np.float32), 1.0


def moonlit(look: Look, times: float, rng: Rng) -> tuple[Image, float]:
    """More sky: its own noise comes with it."""
    fresh = look.noise * math.sqrt(times - 1.0)
    level = float(np.median(look.pixels))
    noise = rng.normal(0.0, fresh, look.pixels.shape)
    return (look.pixels + level * (times - 1.0) + noise).astype(np.float32), 1.0


def speckled(look: Look, of_1000: float, rng: Rng) -> tuple[Image, float]:
    """Hot pixels, and columns that are hot all along or in part."""
    out = look.pixels.copy()
    height, width = out.shape
    is_hot = rng.random(out.shape) < of_1000 / 1000.0
    out[is_hot] += rng.exponential(60.0 * look.noise, int(is_hot.sum()))
    for column in rng.integers(0, width, 5):
        first = int(rng.integers(0, height // 2)) * int(rng.integers(0, 2))
        out[first:, column] += rng.uniform(2.0, 20.0) * look.noise
    return out, 1.0


def crossed(look: Look, severity: float, rng: Rng) -> tuple[Image, float]:
    """Trails from edge to edge, as wide as a star."""
    out = look.pixels.copy()
    height, width = out.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    for _ in range(max(1, round(severity))):
        angle = float(rng.uniform(0.0, math.pi))
        x0, y0 = float(rng.uniform(0, width)), float(rng.uniform(0, height))
        off = (x - x0) * math.sin(angle) - (y - y0) * math.cos(angle)
        ridge = math.exp(float(rng.uniform(math.log(3.0), math.log(30.0)))) * look.noise
        out += (ridge * np.exp(-0.5 * (off / 0.95) ** 2)).astype(np.float32)
    return out, 1.0


def oversampled(look: Look, _severity: float, rng: Rng) -> tuple[Image, float]:
    """Twice the pixels a side: the noise of four is that of one."""
    out = cv2.resize(look.pixels, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    return (out + rng.normal(0.0, 1.6 * look.noise, out.shape)).astype(np.float32), 2.0


def gappy(look: Look, share: float, rng: Rng) -> tuple[Image, float]:
    """Clouds that move: the image, sky apart, is dimmed in patches."""
    level = float(np.median(look.pixels))
    patches = rng.uniform(1.0 - share, 1.0, (4, 5)).astype(np.float32)
    through = cv2.resize(patches, look.pixels.shape[::-1], interpolation=cv2.INTER_CUBIC)
    noise = rng.normal(0.0, look.noise, look.pixels.shape)
    fresh = np.sqrt(np.clip(1.0 - through**2, 0.0, 1.0)) * noise
    return (level + (look.pixels - level) * through + fresh).astype(np.float32), 1.0


FAMILIES: dict[str, Family] = {
    "plain": Family(title="as it is", low=0.0, high=0.0, alter=plain),
    "blur": Family(title="blur, px sigma", low=0.0, high=4.0, alter=blurred),
    "ring": Family(title="out of focus, ring of px", low=4.0, high=10.0, alter=ringed),
    "drift": Family(title="stars drift, px", low=5.0, high=30.0, alter=drifted),
    "wind": Family(title="wind, px rms", low=1.0, high=4.0, alter=windy),
    "vibration": Family(title="vibrates along a line, px", low=5.0, high=20.0, alter=vibrating),
    "stripes": Family(title="row and column noise, sigma", low=0.5, high=2.0, alter=striped),
    "modulation": Family(title="modulated, periods", low=2.0, high=8.0, alter=modulated),
    "binned": Family(title="binned 2 or 4", low=2.0, high=4.0, alter=binned),
    "8-bit": Family(title="8 bits, steps a sigma", low=0.5, high=2.0, alter=coarse),
    "bayer": Family(title="Bayer grid, contrast", low=0.1, high=0.6, alter=of_bayer),
    "glow": Family(title="glow in a corner, sigma", low=5.0, high=100.0, alter=glowing),
    "gradient": Family(title="sky gradient", low=0.2, high=1.2, alter=graded),
    "moonlight": Family(title="sky brighter by", low=2.0, high=8.0, alter=moonlit),
    "hot": Family(title="hot pixels, of 1000; columns", low=0.1, high=3.0, alter=speckled),
    "crossings": Family(title="trails right through", low=1.0, high=3.0, alter=crossed),
    "oversampled": Family(title="twice the pixels", low=0.0, high=0.0, alter=oversampled),
    "clouds": Family(title="cloud takes at most", low=0.2, high=0.8, alter=gappy),
}


@cache
def looks() -> tuple[Look, ...]:
    """Every satellite of the two sequences, and the part of its frame about it."""
    found = []
    for sequence in _SEQUENCES:
        folder = FRAMES / sequence
        told = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        for number, one in enumerate(told["frames"]):
            whole = read_frame(folder / one["file"], number).pixels.astype(np.float32)
            for index in range(len(one["objects"])):
                found.append(_look(whole, one, index, told["scale_arcsec"]))
    return tuple(found)


def _look(whole: Image, one: dict[str, Any], index: int, scale_arcsec_px: float) -> Look:
    asked = one["objects"][index]
    height, width = whole.shape
    x0 = int(np.clip(asked["x"] - _HALF_PX[0], 0, width - 2 * _HALF_PX[0]))
    y0 = int(np.clip(asked["y"] - _HALF_PX[1], 0, height - 2 * _HALF_PX[1]))
    part = whole[y0 : y0 + 2 * _HALF_PX[1], x0 : x0 + 2 * _HALF_PX[0]].copy()
    others = [each for at, each in enumerate(one["objects"]) if at != index]
    streaks = tuple(
        (each["x_start"] - x0, each["y_start"] - y0, each["x_end"] - x0, each["y_end"] - y0)
        for each in (asked, *others)
    )
    return Look(
        name=f"{one['file']}#{index}",
        pixels=part,
        noise=_noise_of(part),
        scale_arcsec_px=scale_arcsec_px,
        fwhm_px=one["fwhm_px"],
        streaks=streaks,
        snr=asked["snr_matched_total"],
    )


def _rng(name: str, number: int) -> Rng:
    return np.random.default_rng([_SEED, zlib.crc32(name.encode()), number])


def drawn(name: str, number: int) -> tuple[Frame, tuple[Ends, ...], float]:
    """One altered part, where its satellites are, and how severe it is."""
    family = FAMILIES[name]
    rng, look = _rng(name, number), looks()[number % len(looks())]
    severity = float(rng.uniform(family.low, family.high))
    image, times = family.alter(look, severity, rng)
    bits = 255 if name == "8-bit" else 65535
    # Room below: what noise there is must not be cut off at zero.
    stored = np.clip(np.rint(image), 0, bits).astype(np.uint16)
    frame = Frame(
        frame_id=number,
        name=f"{name} {number}",
        pixels=stored,
        exposure_s=EXPOSURE_S,
        scale_arcsec_px=look.scale_arcsec_px / times,
        saturation_adu=float(bits),
    )
    seen = look.streaks
    if name in _PATHS:
        again = _rng(name, number)
        path = _PATHS[name](float(again.uniform(family.low, family.high)), again)
        seen = tuple(_carried(each, path) for each in seen)
    middle = 0.5 * (times - 1.0)
    streaks = tuple(
        (x_a * times + middle, y_a * times + middle, x_b * times + middle, y_b * times + middle)
        for x_a, y_a, x_b, y_b in seen
    )
    return frame, streaks, severity


_SPREADS = {"blur", "ring", "drift", "wind", "vibration", "modulation"}
"""Families whose alteration of a line of light, and of nothing else, is its signal's."""


def snr_of(name: str, number: int) -> float:
    """Integrated SNR that the alteration leaves of the satellite in the middle.

    Of a line of light alone, before and after: the root of its sum of squares over the noise.
    """
    family, look, rng = FAMILIES[name], looks()[number % len(looks())], _rng(name, number)
    severity = float(rng.uniform(family.low, family.high))
    if name == "moonlight":
        return look.snr / math.sqrt(severity)
    if name == "8-bit":
        return look.snr / math.sqrt(1.0 + 1.0 / (12.0 * severity**2))
    if name == "clouds":
        return look.snr * (1.0 - severity)
    if name not in _SPREADS:
        return look.snr
    at_rest = np.zeros(_STEPS), np.zeros(_STEPS)
    ends = look.streaks[0]
    light = _line_of_light(look.pixels.shape, ends, at_rest, look.fwhm_px, 1000.0)
    alone = replace(look, pixels=light, noise=0.0, streaks=(ends,))
    altered, _ = family.alter(alone, severity, rng)
    return look.snr * float(np.linalg.norm(altered) / np.linalg.norm(light))
