"""What the line fit makes of streaks on the real sky: refusals, errors, honest sigmas, time.

    OPENBLAS_NUM_THREADS=1 python -m tests.bench.bench_fit [--frames 6] [--seed 5]

Draws whole frames of the simulated telescope, many streaks in each (far enough from one another
that none disturbs another), and gives the fit boxes with a network's errors, so that neither the
network nor the curve of confidence enters. Prints a table; asserts nothing.
"""

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.simulator import (
    Scene,
    frame_rng,
    render,
    scenario_named,
    straight_streak,
    transmission_at,
)
from rsoconsole.sky import tan_wcs
from rsoconsole.vision import StreakFit, find_stars, fit_streak, local_background
from rsoconsole.vision.streaks.streak_fit import NoStreak

SNR_BINS = ((1.5, 2.0), (2.0, 3.0), (3.0, 5.0), (5.0, 20.0))
LENGTH_BINS = ((30.0, 60.0), (60.0, 90.0), (90.0, 150.0), (150.0, 300.0))
_NIGHTS = ("intelsat-14", "intelsat-21")
_CELLS = (5, 5)
_CENTRE_ERROR_PX, _LENGTH_ERROR, _ANGLE_ERROR_DEG = 5.0, 0.15, 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One streak, or one box on plain sky where ``length_px`` is 0, and what the fit said."""

    peak_snr: float
    length_px: float
    is_fading: bool
    fit: StreakFit | NoStreak
    along_px: float
    across_px: float
    fit_ms: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Truth:
    x_px: float
    y_px: float
    angle: float
    length_px: float
    peak_snr: float
    is_fading: bool


def drawn(number: int, seed: int) -> tuple[PixelArray, float, list[_Truth]]:
    """A frame somewhere on the belt, its saturation and the streaks in it."""
    rng = frame_rng(seed, number, 191)
    scenario = scenario_named(_NIGHTS[int(rng.integers(len(_NIGHTS)))])
    scene = Scene(scenario, seed + number)
    sensor = scene.sensor
    wcs = tan_wcs(
        float(rng.uniform(280.0, 340.0)),
        float(rng.uniform(-10.0, 10.0)),
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=float(rng.uniform(0.0, 360.0)),
        is_flipped=False,
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    t_utc_ns = scenario.t_start_utc_ns + int(rng.uniform(0.0, 1200.0)) * 1_000_000_000
    content = scene.field_content(wcs, t_utc_ns, 10.0)
    noise_e = math.sqrt(content.sky_electrons_px + sensor.read_noise_e**2 + 4.0)
    sigma_px = math.sqrt((content.fwhm_px / 2.3548) ** 2 + 1.0 / 12.0)
    truths, streaks = [], []
    for cell in range(_CELLS[0] * _CELLS[1]):
        row, column = divmod(cell, _CELLS[0])
        low, high = SNR_BINS[int(rng.integers(len(SNR_BINS)))]
        shortest, longest = LENGTH_BINS[(0, 0, 1, 2, 2, 2, 3)[int(rng.integers(7))]]
        truth = _Truth(
            x_px=(column + float(rng.uniform(0.35, 0.65))) * sensor.width_px / _CELLS[0],
            y_px=(row + float(rng.uniform(0.35, 0.65))) * sensor.height_px / _CELLS[1],
            angle=float(rng.uniform(0.0, 2.0 * math.pi)),
            length_px=float(rng.uniform(shortest, longest)),
            peak_snr=float(np.exp(rng.uniform(math.log(low), math.log(high)))),
            is_fading=bool(rng.random() < 0.2),
        )
        half = 0.5 * truth.length_px * np.array([math.cos(truth.angle), math.sin(truth.angle)])
        electrons = truth.peak_snr * noise_e * sigma_px * math.sqrt(2.0 * math.pi)
        ends = (
            (truth.x_px - half[0], truth.y_px - half[1]),
            (
                truth.x_px + half[0],
                truth.y_px + half[1],
            ),
        )
        light = np.array([1.0, 0.45]) if truth.is_fading else None
        x, y = np.linspace(*ends, 9).T
        clear = transmission_at(sensor, content.cloud_transmission, x, y)
        streaks.append(straight_streak(*ends, electrons * truth.length_px, light))
        truths.append(replace(truth, peak_snr=truth.peak_snr * float(clear.mean())))
    content = replace(content, streaks=tuple(streaks))
    pixels = render(sensor, content, frame_rng(seed, number, 192))
    return pixels, sensor.saturation_adu, truths


def proposed(truth: _Truth, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Ends of a proposal with a network's errors, (2,) each."""
    angle = truth.angle + math.radians(float(rng.normal(0.0, _ANGLE_ERROR_DEG)))
    length = truth.length_px * (1.0 + float(np.clip(rng.normal(0.0, _LENGTH_ERROR), -0.4, 0.4)))
    centre = np.array([truth.x_px, truth.y_px]) + rng.normal(0.0, _CENTRE_ERROR_PX, 2)
    half = 0.5 * length * np.array([math.cos(angle), math.sin(angle)])
    return centre - half, centre + half


def cases_of(
    pixels: PixelArray, saturation_adu: float, truths: Sequence[_Truth], rng: np.random.Generator
) -> Iterator[Case]:
    """Every streak of a frame as the fit measures it."""
    sky = local_background(pixels)
    stars = find_stars(pixels, sky, saturation_adu=saturation_adu)
    for truth in truths:
        a, b = proposed(truth, rng)
        low, high = np.minimum(a, b) - 4.0, np.maximum(a, b) + 4.0
        began = time.thread_time()
        fit = fit_streak(
            pixels,
            sky,
            (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
            stars=stars,
            ends=(float(a[0]), float(a[1]), float(b[0]), float(b[1])),
        )
        took = (time.thread_time() - began) * 1e3
        measured = fit.fit if isinstance(fit, NoStreak) else fit
        off = (0.0, 0.0) if measured is None else (measured.x_px, measured.y_px)
        dx, dy = off[0] - truth.x_px, off[1] - truth.y_px
        cos, sin = math.cos(truth.angle), math.sin(truth.angle)
        yield Case(
            peak_snr=truth.peak_snr,
            length_px=truth.length_px,
            is_fading=truth.is_fading,
            fit=fit,
            along_px=dx * cos + dy * sin,
            across_px=dy * cos - dx * sin,
            fit_ms=took,
        )


def line_of(cases: Sequence[Case]) -> str:
    """Found of asked; median, 95th percentile and largest error of the midpoint; z; time."""
    found = [c for c in cases if isinstance(c.fit, StreakFit)]
    if not found:
        return f"{0:4d}/{len(cases):4d}"
    error = np.array([math.hypot(c.along_px, c.across_px) for c in found])
    fits = [c.fit for c in found if isinstance(c.fit, StreakFit)]
    along = np.array([c.along_px / f.sigma_along_px for c, f in zip(found, fits, strict=True)])
    across = np.array([c.across_px / f.sigma_across_px for c, f in zip(found, fits, strict=True)])
    times = np.array([c.fit_ms for c in cases])
    return (
        f"{len(found):4d}/{len(cases):4d}  {np.median(error):6.2f}{np.quantile(error, 0.95):7.2f}"
        f"{error.max():7.2f}   {_spread(along)}   {_spread(across)}   "
        f"{np.median(times):6.1f}{np.quantile(times, 0.95):7.1f}"
    )


def _spread(z: FloatArray) -> str:
    """Root mean square, its value without the outermost fiftieth, and the largest."""
    calm = np.sort(np.abs(z))[: max(1, math.ceil(0.98 * z.size))]
    return f"{np.sqrt(np.mean(z**2)):5.2f}{np.sqrt(np.mean(calm**2)):6.2f}{np.abs(z).max():6.1f}"


def report(cases: Sequence[Case]) -> None:
    """Print the table."""
    print(f"{'':26s}{'found':>9s}  {'error px, 50 95 100 %':>21s}", end="")
    print(f"   {'z along':^17s}   {'z across':^17s}   {'ms, 50 95 %':>13s}")
    for shortest, longest in LENGTH_BINS:
        for low, high in SNR_BINS:
            chosen = [
                c for c in cases if low <= c.peak_snr < high and shortest <= c.length_px < longest
            ]
            for is_fading in (False, True):
                part = [c for c in chosen if c.is_fading == is_fading]
                named = f"{shortest:3.0f}-{longest:3.0f} px SNR {low:3.1f}-{high:4.1f}"
                if part:
                    print(f"{named + (' fading' if is_fading else ''):28s}{line_of(part)}")
    for low, high in SNR_BINS:
        part = [c for c in cases if low <= c.peak_snr < high]
        print(f"{f'all SNR {low:3.1f}-{high:4.1f}':28s}{line_of(part)}")
    reasons = Counter(
        (f"SNR {low:.1f}-{high:.1f}", "".join(x for x in c.fit.reason if not x.isdigit()))
        for low, high in SNR_BINS
        for c in cases
        if low <= c.peak_snr < high and isinstance(c.fit, NoStreak)
    )
    for (which, reason), count in sorted(reasons.items()):
        print(f"{which:14s}{count:4d}  {reason}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.bench_fit", description=__doc__)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    cases: list[Case] = []
    for number in range(args.frames):
        pixels, saturation_adu, truths = drawn(number, args.seed)
        rng = frame_rng(args.seed, number, 193)
        cases += cases_of(pixels, saturation_adu, truths, rng)
    report(cases)


if __name__ == "__main__":
    main()
