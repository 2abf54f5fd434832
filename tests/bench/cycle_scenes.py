"""Full-size frames of five skies for ``bench_cycle``, written once and read by every tree."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsoconsole.config import Config
from rsoconsole.simulator import Scenario, Scene, scenario_named
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.simulator.camera.truth import SatelliteTruth
from rsoconsole.sky import icrs_of_hour_angle
from rsoconsole.vision.arrays import Float32Array
from rsoconsole.words import NS_PER_S

CADENCE_S = 30
DRIFT_ARCSEC = 30.0
TRAILS = ((0.0, 700.0, 4655.0, 2900.0), (0.0, 3100.0, 4655.0, 1500.0))
"""Ends of two trails from rim to rim, px: x, y, x, y."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """A sky to expose: scenario, hour angle, declination, and what is added to its frames."""

    scenario: Scenario
    hour_angle_deg: float
    first_s: float = 0.0
    drift_arcsec: float = 0.0
    added: Callable[[Float32Array, SatelliteTruth], None] | None = None


def skies() -> dict[str, Sky]:
    """One streak first, then what costs more."""
    one = scenario_named("intelsat-14")
    cloud = scenario_named("intelsat-21")
    return {
        "one streak": Sky(scenario=one, hour_angle_deg=-41.0),
        "twelve members": Sky(scenario=one, hour_angle_deg=-41.0, added=_with_members),
        "trails right through": Sky(scenario=one, hour_angle_deg=-41.0, added=_with_trails),
        "drift": Sky(scenario=one, hour_angle_deg=-41.0, drift_arcsec=DRIFT_ARCSEC),
        "cloud": Sky(scenario=cloud, hour_angle_deg=-26.4, first_s=390.0),
    }


def write_frames(folder: Path, sky: Sky, count: int) -> None:
    """Write ``count`` frames, ``1.npy`` and so on, and ``frames.json`` with times and pointings."""
    (folder / "frames.json").write_text(json.dumps(list(_exposed(folder, sky, count))))


def _exposed(folder: Path, sky: Sky, count: int) -> Iterator[dict[str, float]]:
    scene, scenario = Scene(sky.scenario, 1), sky.scenario
    path = None
    if sky.drift_arcsec:
        path = sky.drift_arcsec * np.array([np.linspace(-0.5, 0.5, 33), np.zeros(33)])
    for number in range(1, count + 1):
        t_ns = scenario.t_start_utc_ns + round((sky.first_s + number * CADENCE_S) * NS_PER_S)
        ra, dec = icrs_of_hour_angle(
            scenario.site, sky.hour_angle_deg, scenario.start_declination_deg, t_ns
        )
        exposure_s = Config().exposure.exposure_s
        pixels, truth = scene.expose(ra, dec, 1.0, False, t_ns, exposure_s, path)
        if sky.added is not None:
            light = pixels.astype(np.float32)
            sky.added(light, truth.satellites[0])
            pixels = np.clip(np.rint(light), 0, 65520).astype(np.uint16)
        np.save(folder / f"{number}.npy", pixels)
        yield {"number": number, "t_ns": t_ns, "ra_deg": ra, "dec_deg": dec}


def _with_members(light: Float32Array, first: SatelliteTruth) -> None:
    """Add eleven streaks like the first satellite's, each at a declination of its own."""
    for number in range(1, 12):
        right, down = 150.0 * (number % 4), 60.0 * number
        _draw(
            light,
            (first.x_start_px + right, first.y_start_px + down),
            (first.x_end_px + right, first.y_end_px + down),
            900.0,
        )


def _with_trails(light: Float32Array, _: SatelliteTruth) -> None:
    for x_a, y_a, x_b, y_b in TRAILS:
        _draw(light, (x_a, y_a), (x_b, y_b), 1600.0)


def _draw(
    light: Float32Array, a: tuple[float, float], b: tuple[float, float], adu_a_px: float
) -> None:
    count = 4 * round(math.dist(a, b))
    t = (np.arange(count) + 0.5) / count
    each = np.full(count, adu_a_px / 4.0)
    add_points(light, a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, each, sigma_px=1.1)
