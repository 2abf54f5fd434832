"""Whole frames of the paper's telescope with their truth, and the frames of other people.

Seeds begin with 70417, which no training, calibration or test of the network begins with.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.instruments import read_frame
from rsoconsole.records import Frame
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    WINGS,
    FieldContent,
    SensorModel,
    Streak,
    frame_rng,
    render,
    straight_streak,
    vignetting,
)
from tests.bench.peers.scoring import Line, TrueStreak

SEED = 70417
BENCH, TUNING, LONG = 2, 1, 3
SNR_BINS = ((1.5, 2.0), (2.0, 3.0), (3.0, 5.0), (5.0, 10.0), (10.0, 30.0))
LENGTHS_PX = {BENCH: (30.0, 150.0), TUNING: (30.0, 150.0), LONG: (90.0, 150.0)}
RIM_PX, APART_PX = 110.0, 500.0
SHARED = Path(__file__).parents[4] / "shared" / "data"
Kind = Literal["satellites", "empty", "cosmic rays", "aircraft"]
KINDS: tuple[Kind, ...] = (
    "satellites",
    "empty",
    "cosmic rays",
    "satellites",
    "aircraft",
    "empty",
)
"""Of successive frames; those with cosmic rays or an aircraft hold satellites too."""
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BenchFrame:
    """One frame and what is in it."""

    name: str
    kind: str
    frame: Frame
    truth: tuple[TrueStreak, ...]


def drawn_frames(count: int, purpose: int = BENCH, first: int = 0) -> Iterator[BenchFrame]:
    """Frames by the simulator's renderer; one satellite of every range of SNR in each."""
    sensor = SensorModel(seed=SEED + purpose)
    for number in range(first, first + count):
        rng = frame_rng(SEED, purpose, number)
        kind = KINDS[number % len(KINDS)]
        content, truth = _content(sensor, kind, LENGTHS_PX[purpose], rng)
        pixels = render(sensor, content, rng)
        name = f"drawn-{purpose}-{number:03d}"
        frame = Frame(
            frame_id=number + 1,
            name=name,
            pixels=pixels,
            exposure_s=content.exposure_s,
            scale_arcsec_px=sensor.scale_arcsec_px,
            saturation_adu=sensor.saturation_adu,
        )
        yield BenchFrame(name=name, kind=kind, frame=frame, truth=truth)


def ridge_share(fwhm_px: float) -> float:
    """Brightest pixel of a long streak over the electrons per pixel of its length."""
    sigma_px = fwhm_px / FWHM_PER_SIGMA
    widths_px = [np.sqrt((sigma_px * widening) ** 2 + 1 / 12) for _, widening in WINGS]
    shares = [share for share, _ in WINGS]
    return float(sum(s / (np.sqrt(2 * np.pi) * w) for s, w in zip(shares, widths_px, strict=True)))


def _content(
    sensor: SensorModel, kind: Kind, lengths_px: tuple[float, float], rng: np.random.Generator
) -> tuple[FieldContent, tuple[TrueStreak, ...]]:
    fwhm_px, sky_e = float(rng.uniform(1.8, 3.2)), float(np.exp(rng.uniform(*np.log([80, 400]))))
    noise_e = float(np.sqrt(sky_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12))
    streaks: list[Streak] = []
    truth: list[TrueStreak] = []
    if kind != "empty":
        for low, high in SNR_BINS:
            snr = float(np.exp(rng.uniform(np.log(low), np.log(high))))
            line = _placed(sensor, lengths_px, [t.line for t in truth], rng)
            light = vignetting(sensor, *(np.array([v]) for v in line.middle_px))[0]
            background_e = np.sqrt(
                sky_e * light + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12
            )
            electrons = snr * background_e / light / ridge_share(fwhm_px) * line.length_px
            ends = (line.x_a_px, line.y_a_px), (line.x_b_px, line.y_b_px)
            streaks.append(straight_streak(*ends, float(electrons)))
            truth.append(TrueStreak(line=line, snr=snr))
    if kind == "aircraft":
        streaks += _aircraft(sensor, noise_e / ridge_share(fwhm_px), rng)
    x, y, electrons = _stars(sensor, noise_e, fwhm_px, rng)
    content = FieldContent(
        fwhm_px=fwhm_px,
        sky_electrons_px=sky_e,
        sky_gradient=(float(rng.normal(0, 0.1)), float(rng.normal(0, 0.1))),
        star_x_px=x,
        star_y_px=y,
        star_electrons=electrons,
        streaks=tuple(streaks),
        cosmic_rays=float(rng.uniform(150, 400)) if kind == "cosmic rays" else 12.0,
    )
    return content, tuple(truth)


def _placed(
    sensor: SensorModel,
    lengths_px: tuple[float, float],
    others: list[Line],
    rng: np.random.Generator,
) -> Line:
    """Wholly in the frame, well away from the others."""
    while True:
        length = float(np.exp(rng.uniform(*np.log(lengths_px))))
        angle = float(rng.uniform(0, np.pi))
        x = float(rng.uniform(RIM_PX, sensor.width_px - 1 - RIM_PX))
        y = float(rng.uniform(RIM_PX, sensor.height_px - 1 - RIM_PX))
        middles = (other.middle_px for other in others)
        if all(np.hypot(x - u, y - v) > APART_PX for u, v in middles):
            dx, dy = length / 2 * float(np.cos(angle)), length / 2 * float(np.sin(angle))
            return Line(x_a_px=x - dx, y_a_px=y - dy, x_b_px=x + dx, y_b_px=y + dy)


def _stars(
    sensor: SensorModel, noise_e: float, fwhm_px: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A power law in flux, 13,000 to 64,000 a frame."""
    count = int(np.exp(rng.uniform(*np.log([13e3, 64e3]))))
    faintest = 0.8 * noise_e * 2 * np.pi * (fwhm_px / FWHM_PER_SIGMA) ** 2
    electrons = faintest * (1.0 - rng.random(count)) ** (-1.0 / rng.uniform(0.7, 1.1))
    x = rng.uniform(-8, sensor.width_px + 8, count)
    y = rng.uniform(-8, sensor.height_px + 8, count)
    return x, y, np.minimum(electrons, 3e6)


def _aircraft(
    sensor: SensorModel, e_per_px_of_snr: float, rng: np.random.Generator
) -> list[Streak]:
    """Two or three wide trails side by side across the frame, most of them blinking."""
    angle, reach_px = float(rng.uniform(0, np.pi)), float(sensor.width_px)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    centre = rng.uniform(0.3, 0.7, 2) * [sensor.width_px, sensor.height_px]
    trails: list[Streak] = []
    for lamp in range(int(rng.integers(2, 4))):
        blinking: FloatArray | None = None
        if rng.random() < 0.7:
            blinking = np.full(801, rng.uniform(0.0, 0.5))
            blinking[:: int(rng.integers(8, 60))] = rng.uniform(3, 12)
        for offset_px in np.arange(-6.0, 6.1, 2.0):
            middle = centre + across * (lamp * rng.uniform(30, 60) + offset_px)
            start, end = middle - along * reach_px, middle + along * reach_px
            light = float(rng.uniform(2, 8)) * e_per_px_of_snr * 2 * reach_px
            ends = (float(start[0]), float(start[1])), (float(end[0]), float(end[1]))
            trails.append(straight_streak(*ends, light, blinking))
    return trails


def independent_frames() -> Iterator[BenchFrame]:
    """The frames of ``../shared/data``; nothing where they are not installed."""
    number = 0
    for truth_path in sorted(SHARED.glob("simulated/*/truth.json")):
        for entry in json.loads(truth_path.read_text())["frames"]:
            number += 1
            frame = read_frame(truth_path.parent / entry["file"], number)
            truth = tuple(_satsim_streak(each) for each in entry.get("objects", []))
            yield BenchFrame(name=entry["file"], kind="simulated", frame=frame, truth=truth)
    # Ends by eye; the signal was not measured: it counts among all, in no range.
    by_eye = Line(x_a_px=22.0, y_a_px=338.0, x_b_px=340.0, y_b_px=308.0)
    for path in sorted(p for p in SHARED.glob("real/**/*") if p.is_file()):
        number += 1
        is_trail = path.name == "astride_long.fits"
        truth = (TrueStreak(line=by_eye, snr=float("inf")),) if is_trail else ()
        frame = read_frame(path, number, max_nonfinite_fraction=0.5)
        yield BenchFrame(name=path.name, kind="real", frame=frame, truth=truth)


def _satsim_streak(entry: dict[str, float]) -> TrueStreak:
    line = Line(
        x_a_px=entry["x_start"],
        y_a_px=entry["y_start"],
        x_b_px=entry["x_end"],
        y_b_px=entry["y_end"],
    )
    return TrueStreak(line=line, snr=entry["snr_peak_pixel"])
