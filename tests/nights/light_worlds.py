"""Made-up nights with brightness: one satellite whose light is known at every instant.

The light is a formula, averaged over exposures and steps by sampling it finely, blurred along the
streak as an image is, and given noise and transparency; nothing of it uses the code under test.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import Config
from rsoconsole.night import frames_of, light_curve_of, tracks_of
from rsoconsole.night.light_curve import LightCurve
from rsoconsole.records import (
    Detections,
    FrameTaken,
    LightStep,
    Measurement,
    Photometry,
    Record,
    StreakLight,
    TrackState,
)
from rsoconsole.session import SessionWriter
from tests.makers import NS, T0_UTC_NS, geo_measurement

Light = Callable[[Any], Any]
"""Relative light at seconds since the first frame's middle, an array."""
ZERO_POINT_MAG = 22.0
FINE_S = 0.02


@dataclass(frozen=True, kw_only=True)
class LightWorld:
    """What the satellite's light and the sky do, and how they are sampled."""

    light: Light
    seed: int = 0
    frames: int = 40
    exposure_s: float = 10.0
    cadence_s: float = 20.0
    jitter_s: float = 0.3
    """Scatter of the begin of exposures about a regular cadence."""
    snr: float = 50.0
    """SNR of a whole streak of unit light."""
    steps: int = 40
    """Number of steps of a streak; 0 for none."""
    mag: float = 11.0
    gaps: tuple[tuple[int, int], ...] = ()
    """Frames (first, last) hidden by cloud."""
    transparency_sigma_mag: float = 0.01
    zero_point_sigma_mag: float = 0.01
    red_mag: float = 0.0
    """Slow wander of the zero point's error from frame to frame."""
    is_b_first: bool = False
    flags: tuple[int, ...] = ()
    """Saturated frames."""


def light_records(world: LightWorld) -> list[Record]:
    """Records of the night, frame by frame."""
    random = np.random.default_rng(world.seed)
    records: list[Record] = []
    wander = 0.0
    full_rate = 10.0 ** (-0.4 * (world.mag - ZERO_POINT_MAG))
    for number in range(1, world.frames + 1):
        t_s = (number - 1) * world.cadence_s + random.uniform(-1, 1) * world.jitter_s
        wander = 0.9 * wander + random.normal(0.0, world.red_mag)
        error_mag = wander + random.normal(0.0, world.zero_point_sigma_mag)
        cloud = 10.0 ** (-0.4 * abs(random.normal(0.0, world.transparency_sigma_mag)))
        if any(first <= number <= last for first, last in world.gaps):
            continue
        measured = geo_measurement(
            number,
            cadence_s=world.cadence_s,
            exposure_s=world.exposure_s,
            measurement_id=f"{number}-0",
        )
        t_ns = geo_measurement(1).t_mid_utc_ns + round(t_s * NS)
        measured = replace(measured, t_mid_utc_ns=t_ns)
        if world.is_b_first and measured.ends_icrs_deg is not None:
            measured = replace(measured, ends_icrs_deg=measured.ends_icrs_deg[::-1])
        light = _streak_light(world, t_s, random, (full_rate * cloud, error_mag))
        records += [
            FrameTaken(
                frame_id=number,
                name=f"{number}.fits",
                t_start_utc_ns=t_ns - round(world.exposure_s / 2.0 * NS),
                exposure_s=world.exposure_s,
                width_px=4656,
                height_px=3520,
                pointing_ra_icrs_deg=None,
                pointing_dec_icrs_deg=None,
            ),
            Detections(frame_id=number, width_px=4656, height_px=3520, detections=()),
            measured,
            _state(number, measured),
            Photometry(
                frame_id=number,
                streaks=(replace(light, is_saturated=number in world.flags),),
                zero_point_mag=ZERO_POINT_MAG + 2.5 * np.log10(cloud) + error_mag,
                zero_point_sigma_mag=world.zero_point_sigma_mag,
                zero_point_stars=30,
                limiting_mag=14.0,
            ),
        ]
    return records


def curve_of(records: Iterable[Record], track_id: int = 1) -> LightCurve:
    """The light curve of a track of these records."""
    frames = frames_of(records)
    found = light_curve_of(frames, tracks_of(frames)[track_id])
    assert found is not None
    return found


def record_light(folder: Path, world: LightWorld) -> Path:
    """A closed session of the night; returns its folder."""
    writer = SessionWriter.create(folder, Config(), {"title": "bright", "is_simulated": True})
    for record in light_records(world):
        writer.append(record, T0_UTC_NS + getattr(record, "frame_id", 0) * 20 * NS)
    writer.close()
    assert not writer.faults
    return folder


def _streak_light(
    world: LightWorld, t_s: float, random: np.random.Generator, sky: tuple[float, float]
) -> StreakLight:
    rate_scale, error_mag = sky
    exposure_s, count = world.exposure_s, world.steps or 20
    width_s = exposure_s / count
    fine = np.arange(-exposure_s / 2.0 + FINE_S / 2.0, exposure_s / 2.0, FINE_S)
    light = world.light(t_s + fine)
    # The image of a star is about as wide as a step: its sigma is 0.42 of that.
    kernel = np.exp(-0.5 * (np.arange(-60, 61) * FINE_S / (0.42 * width_s)) ** 2)
    weight = np.convolve(np.ones_like(light), kernel, "same")
    blurred = np.convolve(light, kernel, "same") / weight
    middles = -exposure_s / 2.0 + width_s * (np.arange(count) + 0.5)
    of_step = np.clip(((fine + exposure_s / 2.0) / width_s).astype(int), 0, count - 1)
    means = np.bincount(of_step, blurred, count) / np.bincount(of_step, minlength=count)
    noise = random.normal(0.0, 1.0, count + 2)
    noise = 0.25 * noise[:-2] + 0.97 * noise[1:-1] + 0.25 * noise[2:]
    noise /= np.sqrt(0.25**2 * 2 + 0.97**2)
    step_sigma = rate_scale * np.sqrt(count) / world.snr
    rates = rate_scale * means + step_sigma * noise
    whole_sigma = rate_scale / world.snr
    # The noise of the whole streak is that of its steps together.
    whole = rate_scale * float(light.mean()) + float((rates - rate_scale * means).mean())
    zero_point = ZERO_POINT_MAG + 2.5 * np.log10(
        rate_scale / 10.0 ** (-0.4 * (world.mag - ZERO_POINT_MAG))
    )
    mag = zero_point + error_mag - 2.5 * np.log10(whole) if whole > 0.0 else None
    if world.is_b_first:
        rates = rates[::-1]
    return StreakLight(
        measurement_id=f"{_frame_of(world, t_s)}-0",
        flux_adu=whole * exposure_s,
        flux_sigma_adu=whole_sigma * exposure_s,
        rate_adu_s=whole,
        rate_sigma_adu_s=whole_sigma,
        band="V",
        mag=None if mag is None else float(mag),
        mag_sigma=None
        if mag is None
        else float(np.hypot(1.0857 * whole_sigma / whole, world.zero_point_sigma_mag)),
        mag_sigma_colour=0.05,
        steps=tuple(
            LightStep(
                t_s=float(middles[k]),
                rate_adu_s=float(rates[k]),
                rate_sigma_adu_s=float(step_sigma),
            )
            for k in range(count)
        )
        if world.steps
        else (),
    )


def _frame_of(world: LightWorld, t_s: float) -> int:
    return round(t_s / world.cadence_s) + 1


def _state(number: int, measured: Measurement) -> TrackState:
    variance = (1.0 / 3600.0) ** 2
    return TrackState(
        track_id=1,
        kind="initial" if number == 1 else "updated",
        frame_id=number,
        t_utc_ns=measured.t_mid_utc_ns,
        x=(measured.ra_icrs_deg, 15.041 / 3600.0, measured.dec_icrs_deg, 0.0),
        P=(
            (variance, 0.0, 0.0, 0.0),
            (0.0, 1e-11, 0.0, 0.0),
            (0.0, 0.0, variance, 0.0),
            (0.0, 0.0, 0.0, 1e-11),
        ),
        measurement_id=measured.measurement_id,
    )


def sinusoid(period_s: float, peak_to_peak_mag: float = 0.5, phase: float = 0.0) -> Light:
    """Light whose magnitude is a sinusoid."""
    return lambda t_s: (
        10.0 ** (-0.2 * peak_to_peak_mag * np.sin(2.0 * np.pi * np.asarray(t_s) / period_s + phase))
    )


def trend(slope_mag: float, bend_mag: float, span_s: float) -> Light:
    """Light that changes by a slope and a bend over a span, magnitudes, as phase angle makes it."""

    def light(t_s: Any) -> Any:
        u = np.asarray(t_s) / span_s
        return 10.0 ** (-0.4 * (slope_mag * u + 4.0 * bend_mag * u * (1.0 - u)))

    return light


def steady(_t_s: Any) -> Any:
    """Light that does not change."""
    return np.ones_like(np.asarray(_t_s, float))
