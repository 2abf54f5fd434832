"""Other objects in a field: low satellites from edge to edge, aircraft, and nearby satellites."""

import math
from collections.abc import Sequence

import numpy as np
from sgp4.api import SatrecArray

from rsoconsole.orbits import Satellite
from rsoconsole.records import FloatArray, Site
from rsoconsole.simulator.camera.rendering import FieldContent, Streak, frame_rng, straight_streak
from rsoconsole.simulator.camera.sensor import SensorModel
from rsoconsole.simulator.camera.truth import TrafficTruth
from rsoconsole.simulator.world.world import TrafficWorld
from rsoconsole.sky import direction_to_unit, jd_utc, site_gcrs, teme_to_gcrs_rotation

_STREAM = 30
BEYOND_PX = 60.0
"""Distance outside the frame at which a trail across it begins and ends."""
_LAMP_STEPS = 4000
_STROBES_S = (0.8, 1.2)
_STROBE_SHINES_S = 0.06
_AIRCRAFT_FWHM_PX = (5.0, 14.0)
_LOW_SATELLITE_PEAK = (4.0, 60.0)
_AIRCRAFT_PEAK = (8.0, 80.0)


def draw_traffic(
    world: TrafficWorld, seed: int, t_start_utc_ns: int, sensor: SensorModel, content: FieldContent
) -> tuple[tuple[Streak, ...], tuple[TrafficTruth, ...]]:
    """Draw aircraft and low satellites that cross this exposure; return streaks and truth.

    Their numbers are Poisson-distributed with the world's rates as means.
    """
    rng = frame_rng(seed, t_start_utc_ns, _STREAM)
    streaks: list[Streak] = []
    truths: list[TrafficTruth] = []
    noise_e = math.sqrt(content.sky_electrons_px + sensor.read_noise_e**2)
    for _ in range(int(rng.poisson(world.low_satellite_rate))):
        start, end, length_px = _chord(rng, sensor)
        # Across a line of a given peak lies about 1.06 times its width of light.
        peak = _log_uniform(rng, *_LOW_SATELLITE_PEAK)
        electrons = peak * noise_e * 1.06 * content.fwhm_px * length_px
        streaks.append(straight_streak(start, end, electrons))
        truths.append(TrafficTruth(kind="low satellite", start_px=start, end_px=end))
    for _ in range(int(rng.poisson(world.aircraft_rate))):
        start, end, length_px = _chord(rng, sensor)
        fwhm_px = _log_uniform(rng, *_AIRCRAFT_FWHM_PX)
        peak = _log_uniform(rng, *_AIRCRAFT_PEAK)
        electrons = peak * noise_e * 1.06 * fwhm_px * length_px
        crossing_s = content.exposure_s * rng.uniform(0.3, 1.0)
        for shine in (np.full(2, 0.4), _strobe(rng, crossing_s)):
            streaks.append(straight_streak(start, end, electrons, shine, fwhm_px))
        truths.append(TrafficTruth(kind="aircraft", start_px=start, end_px=end))
    return tuple(streaks), tuple(truths)


def _chord(
    rng: np.random.Generator, sensor: SensorModel
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """A line of random direction through a random place, from beyond one edge to beyond another."""
    x, y = rng.uniform(0, sensor.width_px), rng.uniform(0, sensor.height_px)
    angle = rng.uniform(0.0, 2.0 * math.pi)
    dx, dy = math.cos(angle), math.sin(angle)

    def reach(sign: float) -> float:
        ways = []
        for at, step, size in ((x, sign * dx, sensor.width_px), (y, sign * dy, sensor.height_px)):
            edge = size + BEYOND_PX if step > 0 else -BEYOND_PX
            ways.append((edge - at) / step if abs(step) > 1e-9 else math.inf)
        return min(ways)

    back, forth = reach(-1.0), reach(1.0)
    start = (float(x - back * dx), float(y - back * dy))
    end = (float(x + forth * dx), float(y + forth * dy))
    return start, end, back + forth


def _strobe(rng: np.random.Generator, crossing_s: float) -> FloatArray:
    """An anti-collision light: short flashes, some five times as bright as the rest in the mean."""
    period_s = rng.uniform(*_STROBES_S)
    time_s = np.linspace(0.0, crossing_s, _LAMP_STEPS) + rng.uniform(0.0, period_s)
    is_lit = time_s % period_s < _STROBE_SHINES_S
    return np.where(is_lit, 0.6 * period_s / _STROBE_SHINES_S, 0.0)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


_MARGIN_DEG = 0.05
"""Margin for light time, aberration and shifts by the atmosphere."""
_MARGIN_S = 2.0
"""Margin for the shutter's timing and for rates that grow during the exposure."""
_RATE_GROWTH = 2.0


class NearbySatelliteSearch:
    """Search for the satellites near a direction; a whole catalogue takes a few milliseconds."""

    def __init__(self, satellites: Sequence[Satellite]) -> None:
        self._records = SatrecArray([each.record for each in satellites]) if satellites else None

    def indices(
        self,
        site: Site,
        t_mid_utc_ns: int,
        exposure_s: float,
        centre_icrs_deg: tuple[float, float],
        radius_deg: float,
    ) -> list[int]:
        """Return the indices of satellites that may come within a radius of a direction.

        The radius is widened by each satellite's motion during the exposure, so that none is
        missed. Satellites for which SGP4 fails are left out.
        """
        if self._records is None:
            return []
        t = np.array([t_mid_utc_ns], dtype=np.int64)
        jd_1, jd_2 = jd_utc(t)
        failed, r_teme, v_teme = self._records.sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        rotation = teme_to_gcrs_rotation(t)[0]
        site_km, site_km_s = site_gcrs(site, t)
        line = r_teme[:, 0] @ rotation.T - site_km[0]
        motion = v_teme[:, 0] @ rotation.T - site_km_s[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            range_km = np.linalg.norm(line, axis=-1)
            cosine = line @ direction_to_unit(*centre_icrs_deg) / range_km
            apart_deg = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
            rate_deg_s = np.degrees(np.linalg.norm(motion, axis=-1) / range_km)
            reach_deg = _RATE_GROWTH * rate_deg_s * (exposure_s / 2.0 + _MARGIN_S)
            is_near = apart_deg <= radius_deg + reach_deg + _MARGIN_DEG
        return [int(i) for i in np.flatnonzero(is_near & (failed[:, 0] == 0))]
