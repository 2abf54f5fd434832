"""Frames drawn with one object each, of every class a streak may have, over a wide range of skies.

The laws are those of the objects, not of the program: a satellite is lit from the shutter's opening
to its closing, a strobe fires every second or so, a meteor's light grows and dies, a ray is sharper
than the optics draw anything.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.records import Detection, Frame
from rsoconsole.simulator.camera.psf import add_points

SIZE = 500
SKY, NOISE = 800.0, 15.0
OBJECTS = ("even", "tumbling", "into shadow", "strobe", "meteor", "ray", "stars")


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """One object in one frame, and what is true of it."""

    frame: Frame
    streak: Detection
    """As a fit that makes no error would measure it."""
    pulses: float = 0.0
    """How many of them its light has, from end to end."""
    depth: float = 0.0
    """Of the pulse before the optics blur it."""
    figures: dict[str, float] = field(default_factory=dict)


def drawn(
    what: str,
    seed: int,
    *,
    ridge_snr: tuple[float, float] = (2.5, 60.0),
    fwhm: tuple[float, float] = (1.8, 5.0),
    scale_arcsec_px: float | None = None,
    exposure_s: float | None = None,
) -> Drawn:
    """A frame with stars and one object, all that is not given drawn by lot."""
    rng = np.random.default_rng([seed, OBJECTS.index(what)])
    fwhm_px = rng.uniform(*fwhm)
    sigma_px = fwhm_px / 2.3548
    length = math.exp(rng.uniform(math.log(max(14.0 * fwhm_px, 40.0)), math.log(320.0)))
    if what == "ray":
        length = rng.uniform(20.0, 60.0)
    bright = math.exp(rng.uniform(*np.log(ridge_snr)))
    angle = rng.uniform(0.0, math.pi)
    reach = 0.5 * length + 8.0
    low_x, low_y = (reach * abs(f(angle)) + 12.0 for f in (math.cos, math.sin))
    x = rng.uniform(low_x, SIZE - low_x)
    y = rng.uniform(low_y, SIZE - low_y)
    light = np.zeros((SIZE, SIZE), dtype=np.float32)
    _stars(light, rng, sigma_px)
    place = (np.arange(int(6 * length)) + 0.5) / int(6 * length)
    shape, pulses, depth = _shape(what, place, length, fwhm_px, rng)
    per_px = bright * NOISE * math.sqrt(2.0 * math.pi) * sigma_px
    flux = shape * per_px * length / place.size
    u = (place - 0.5) * length
    width_px = fwhm_px
    if what == "ray":
        sharp_px = rng.uniform(0.25, 0.45)
        width_px = 2.3548 * math.hypot(sharp_px, 0.35)
        add_points(
            light,
            x + u * math.cos(angle),
            y + u * math.sin(angle),
            flux,
            sigma_px=sharp_px,
            faintest_e=0.01,
        )
    else:
        add_points(
            light,
            x + u * math.cos(angle),
            y + u * math.sin(angle),
            flux,
            sigma_px=sigma_px,
            faintest_e=0.01,
        )
    pixels = np.clip(np.rint(SKY + light + rng.normal(0.0, NOISE, light.shape)), 0, 65535)
    ends = [f(angle) * 0.5 * length for f in (math.cos, math.sin)]
    snr = bright * math.sqrt(length * math.sqrt(math.pi) * sigma_px)
    streak = Detection(
        frame_id=1,
        confidence=0.9,
        x_px=x,
        y_px=y,
        x_a_px=x - ends[0],
        y_a_px=y - ends[1],
        x_b_px=x + ends[0],
        y_b_px=y + ends[1],
        box_px=(x - reach, y - reach, x + reach, y + reach),
        length_px=length,
        width_px=width_px,
        snr=snr,
        sigma_along_px=0.3,
        sigma_across_px=0.1,
        sigma_angle_deg=0.05,
        is_clipped=False,
        method="line",
        unevenness=2.0 if what == "ray" else 0.0,
    )
    frame = Frame(
        frame_id=1,
        name=what,
        pixels=pixels.astype(np.uint16),
        exposure_s=exposure_s,
        scale_arcsec_px=scale_arcsec_px,
    )
    return Drawn(
        frame=frame,
        streak=streak,
        pulses=pulses,
        depth=depth,
        figures={"fwhm": fwhm_px, "length": length, "snr": bright},
    )


def _stars(light: np.ndarray, rng: np.random.Generator, sigma_px: float) -> None:
    count = int(rng.integers(25, 120))
    x, y = rng.uniform(0, SIZE, (2, count))
    flux = NOISE * 30.0 * rng.pareto(1.2, count) + NOISE * 20.0
    add_points(light, x, y, np.minimum(flux, 4e5), sigma_px=sigma_px, faintest_e=0.01)


def _shape(  # noqa: PLR0911 -- one case an object
    what: str, place: np.ndarray, length: float, fwhm_px: float, rng: np.random.Generator
) -> tuple[np.ndarray, float, float]:
    """Light along it with a mean of about 1, how many pulses it has, and how deep they are."""
    if what == "even":
        return 1.0 + rng.uniform(-0.25, 0.25) * (2.0 * place - 1.0), 0.0, 0.0
    if what == "tumbling":
        pulses = rng.uniform(4.5, min(length / (2.5 * fwhm_px), 30.0))
        depth = rng.uniform(0.35, 0.9)
        return 1.0 + depth * np.cos(2.0 * np.pi * (pulses * place + rng.uniform())), pulses, depth
    if what == "into shadow":
        dark, soft = rng.uniform(0.5, 0.9), rng.uniform(0.02, 0.3)
        return np.clip((dark + soft - place) / soft, 0.0, 1.0), 0.0, 0.0
    if what == "strobe":
        pulses = rng.uniform(5.5, min(length / (2.2 * fwhm_px), 24.0))
        lasts = rng.uniform(0.02, 0.12)
        phase = (pulses * place + rng.uniform()) % 1.0
        flashes = (phase < lasts) / lasts
        steady = rng.uniform(0.0, 0.25)
        return steady + (1.0 - steady) * flashes, pulses, 1.0
    if what == "meteor":
        most, rise, fall = rng.uniform(0.35, 0.75), rng.uniform(0.7, 2.0), rng.uniform(0.7, 2.0)
        light = np.where(
            place < most,
            (place / most) ** rise,
            ((1.0 - place) / (1.0 - most)) ** fall,
        )
        flare = 1.0 + rng.uniform(0.0, 1.0) * np.exp(-0.5 * ((place - most) / 0.05) ** 2)
        return light * flare / 0.5, 0.0, 0.0
    if what == "ray":
        lumps = rng.gamma(0.8, 1.0, 12)
        return np.repeat(lumps, math.ceil(place.size / 12))[: place.size], 0.0, 0.0
    count = int(rng.integers(3, 7))
    at = np.concatenate([[0.0, 1.0], rng.uniform(0.1, 0.9, count - 2)])
    flux = rng.uniform(0.4, 1.6, count)
    lit = np.zeros(place.size)
    for where, each in zip(at, flux, strict=True):
        lit[min(int(where * place.size), place.size - 1)] += each * place.size / count
    return lit, 0.0, 0.0
