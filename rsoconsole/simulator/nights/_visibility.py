"""Times at which satellites can be seen from a site: up, lit, in darkness, in one field."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.base import ConfigError
from rsoconsole.config import LimitsConfig, OpticsConfig
from rsoconsole.orbits import Satellite
from rsoconsole.records import FloatArray, Site
from rsoconsole.simulator.camera.psf import WINGS
from rsoconsole.simulator.camera.sensor import SensorModel
from rsoconsole.simulator.nights.night_plan import (
    STREAK_PX,
    USUAL_EXPOSURE_S,
    ground_rate_cadence_s,
)
from rsoconsole.sky import (
    IntArray,
    SkyPlaces,
    altaz_of_hour_angle,
    hour_angle_jnow_deg,
    icrs_to_altaz,
    icrs_to_jnow,
    lit_fraction,
    separation_deg,
    sun_gcrs_km,
    unit_to_direction,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

BoolArray = npt.NDArray[np.bool_]

SEARCHED_DAYS = 30
"""Days searched: a navigation satellite that is up only by day is up by night 4 weeks later."""
CONTENT_DAYS = 5
"""Days searched for a longer window after the first window was found."""
LOOKS_PER_REVOLUTION = 288
SHORTEST_STEP_S, LONGEST_STEP_S = 10.0, 300.0
ALTITUDE_MARGIN_DEG = 1.0
TOGETHER_FIELDS = 0.6
"""Largest distance between targets, as a fraction of the field's short side."""
HIGHEST_DECLINATION_DEG = 80.0
"""Largest |declination| of a target; nearer to a pole right ascension changes too fast."""
MIN_SNR = 30.0
SIDEREAL_ARCSEC_S = 15.0411
SKY_ELECTRONS_S = 13.2
SIGMA_PX = 1.0
EXTINCTION_MAG_AIRMASS = 0.15
_SUN_STEP_NS = 600 * NS_PER_S
_SLOW_S = 6 * 3600.0
_FEW_DAYS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetVisibility:
    """Positions, brightness and rates of M targets at N instants, as seen from a site.

    Shape (M, N): altitude, hour angle, declination, lit and SNR. Shape (N,): all others.
    """

    t_utc_ns: IntArray
    sun_altitude_deg: FloatArray
    altitude_deg: FloatArray
    hour_angle_deg: FloatArray
    dec_deg: FloatArray
    lit: FloatArray
    snr: FloatArray
    """Approximate integrated SNR under a clear sky, in an exposure that suits the target's rate."""
    apart_deg: FloatArray
    """Distance (N,) between the first target and the target furthest from it."""
    rate_arcsec_s: FloatArray
    """Rate (N,) of the fastest target relative to the stars."""
    ground_rate_arcsec_s: FloatArray
    """Rate (N,) of the fastest target relative to the ground, in hour angle and declination."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibilityWindow:
    """Start and duration of a time in which targets can be seen."""

    t_start_utc_ns: int
    visible_s: float


def compute_target_visibility(
    satellites: Sequence[Satellite], site: Site, t_utc_ns: IntArray
) -> TargetVisibility:
    """Positions, SNR and rates of targets from a site at instants (N,); NaN where SGP4 fails."""
    seen = [each.astrometric_place(site, t_utc_ns) for each in satellites]
    altitudes, hour_angles = [], []
    for each in seen:
        ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(each.ra_icrs_deg, each.dec_icrs_deg, t_utc_ns)
        hour_angle_deg = hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns)
        altitudes.append(altaz_of_hour_angle(site, hour_angle_deg, dec_jnow_deg)[0])
        hour_angles.append(hour_angle_deg)
    first = seen[0]
    apart = [
        separation_deg(first.ra_icrs_deg, first.dec_icrs_deg, each.ra_icrs_deg, each.dec_icrs_deg)
        for each in seen
    ]
    dec_deg = np.array([each.dec_icrs_deg for each in seen])
    cos_dec = np.cos(np.radians(dec_deg))
    north = np.array([each.dec_rate_deg_s for each in seen]) * 3600.0
    east = np.array([each.ra_rate_deg_s for each in seen]) * 3600.0
    return TargetVisibility(
        t_utc_ns=t_utc_ns,
        sun_altitude_deg=_sun_altitude_deg(site, t_utc_ns),
        altitude_deg=np.array(altitudes),
        hour_angle_deg=np.array(hour_angles),
        dec_deg=dec_deg,
        lit=np.array([lit_fraction(each.position_gcrs_km, t_utc_ns) for each in seen]),
        snr=np.array(
            [
                _rough_snr(one, places, altitude_deg)
                for one, places, altitude_deg in zip(satellites, seen, altitudes, strict=True)
            ]
        ),
        apart_deg=np.max(np.array(apart), axis=0),
        rate_arcsec_s=np.max(np.hypot(east * cos_dec, north), axis=0),
        ground_rate_arcsec_s=np.max(np.hypot((east - SIDEREAL_ARCSEC_S) * cos_dec, north), axis=0),
    )


def _rough_snr(satellite: Satellite, places: SkyPlaces, altitude_deg: FloatArray) -> FloatArray:
    """Approximate SNR of a straight streak with a round core, over sky and read-out."""
    sensor = SensorModel()
    cos_dec = np.cos(np.radians(places.dec_icrs_deg))
    rate = 3600.0 * np.hypot(places.ra_rate_deg_s * cos_dec, places.dec_rate_deg_s)
    px_s = np.maximum(rate / sensor.scale_arcsec_px, 1e-6)
    exposure_s = np.minimum(USUAL_EXPOSURE_S, STREAK_PX / px_s)
    airmass = 1.0 / np.sin(np.radians(np.maximum(altitude_deg, 5.0)))
    magnitude = satellite.magnitude(places) + EXTINCTION_MAG_AIRMASS * (airmass - 1.0)
    electrons = WINGS[0][0] * sensor.electrons(magnitude, 1.0) * exposure_s
    noise_e = np.sqrt(SKY_ELECTRONS_S * exposure_s + sensor.read_noise_e**2 + 2.0)
    area_px = 2.0 * np.sqrt(np.pi) * SIGMA_PX * (px_s * exposure_s + 2.0 * SIGMA_PX)
    return np.asarray(electrons / (noise_e * np.sqrt(area_px)))


def _sun_altitude_deg(site: Site, t_utc_ns: IntArray) -> FloatArray:
    ra_deg, dec_deg = unit_to_direction(sun_gcrs_km(t_utc_ns))
    return icrs_to_altaz(site, ra_deg, dec_deg, t_utc_ns)[0]


def _dark(site: Site, t_utc_ns: IntArray, twilight_deg: float) -> IntArray:
    """Dark ones of many instants in order; the Sun's altitude is interpolated."""
    knots = np.arange(t_utc_ns[0], t_utc_ns[-1] + 2 * _SUN_STEP_NS, _SUN_STEP_NS, dtype=np.int64)
    altitude_deg = np.interp(t_utc_ns, knots, _sun_altitude_deg(site, knots))
    return t_utc_ns[altitude_deg <= twilight_deg]


def first_window(
    satellites: Sequence[Satellite],
    site: Site,
    *,
    from_utc_ns: int,
    frames: int,
    limits: LimitsConfig,
    optics: OpticsConfig,
) -> VisibilityWindow:
    """The first window long enough for ``frames`` exposures, or the longest one found.

    At most ``SEARCHED_DAYS`` from ``from_utc_ns`` are searched. Raises ConfigError with the
    condition that is never met, and what to try.
    """
    period_s = min(2.0 * np.pi * 60.0 / each.record.no_kozai for each in satellites)
    step_s = float(np.clip(period_s / LOOKS_PER_REVOLUTION, SHORTEST_STEP_S, LONGEST_STEP_S))
    step_ns = round(step_s * NS_PER_S)
    per_day = NS_PER_DAY // step_ns
    found: tuple[VisibilityWindow, bool] | None = None
    waited = 0
    bounds = (satellites, limits, optics)
    looks: list[tuple[TargetVisibility, BoolArray]] = []
    for day in range(SEARCHED_DAYS):
        steps = np.arange(day * per_day, (day + 1) * per_day, dtype=np.int64)
        dark_ns = _dark(site, from_utc_ns + steps * step_ns, limits.twilight_deg)
        if len(dark_ns) == 0:
            continue
        seen = compute_target_visibility(satellites, site, dark_ns)
        looks.append(
            (seen, np.all(list(visibility_conditions(seen, limits, optics).values()), axis=0))
        )
        found = _best_run(looks, step_ns, frames, min(optics.field_deg))
        if found is None and len(looks) == 1 and period_s > _SLOW_S:
            # What stays behind the Earth, as on the belt's far side, is told at once.
            whole = _overview(satellites, site, from_utc_ns, _FEW_DAYS)
            if not np.any(visibility_conditions(whole, limits, optics)["up"]):
                raise ConfigError(_why_never(whole, *bounds))
        waited = 0 if found is None else waited + 1
        if found is not None and (found[1] or waited >= CONTENT_DAYS):
            break
    if found is not None:
        return found[0]
    whole = _overview(satellites, site, from_utc_ns, SEARCHED_DAYS, looks)
    raise ConfigError(_why_never(whole, *bounds))


def _overview(
    satellites: Sequence[Satellite],
    site: Site,
    from_utc_ns: int,
    days: int,
    looks: Sequence[tuple[TargetVisibility, BoolArray]] = (),
) -> TargetVisibility:
    """Whole days, by light too, every quarter of an hour beside what was looked at."""
    whole_ns = from_utc_ns + np.arange(days * 96 + 1, dtype=np.int64) * (NS_PER_DAY // 96)
    at_ns = np.concatenate([whole_ns, *(seen.t_utc_ns for seen, _ in looks)])
    return compute_target_visibility(satellites, site, np.sort(at_ns))


def visibility_conditions(
    seen: TargetVisibility, limits: LimitsConfig, optics: OpticsConfig
) -> dict[str, BoolArray]:
    """Return for each condition of a night at which of the N instants it is met, (N,) bool.

    The keys appear in error messages: "up", "in darkness", "lit", "bright", "in one field".
    """
    low_deg = limits.min_altitude_deg + ALTITUDE_MARGIN_DEG
    with np.errstate(invalid="ignore"):
        is_up = (seen.altitude_deg >= low_deg) & (
            np.abs(seen.hour_angle_deg) < limits.max_hour_angle_deg - ALTITUDE_MARGIN_DEG
        )
        is_reached = np.abs(seen.dec_deg) <= HIGHEST_DECLINATION_DEG
        return {
            "up": np.all(is_up & is_reached, axis=0),
            "in darkness": seen.sun_altitude_deg <= limits.twilight_deg - 0.2,
            "lit": np.all(seen.lit >= 1.0, axis=0),
            "bright": np.all(seen.snr >= MIN_SNR, axis=0),
            "in one field": seen.apart_deg <= TOGETHER_FIELDS * min(optics.field_deg),
        }


def _best_run(
    looks: Sequence[tuple[TargetVisibility, BoolArray]],
    step_ns: int,
    frames: int,
    short_side_deg: float,
) -> tuple[VisibilityWindow, bool] | None:
    """The first run of instants long enough, and True; else the longest, and False."""
    is_good = np.concatenate([good for _, good in looks])
    t_utc_ns = np.concatenate([seen.t_utc_ns for seen, _ in looks])[is_good]
    ground = np.concatenate([seen.ground_rate_arcsec_s for seen, _ in looks])[is_good]
    if len(t_utc_ns) == 0:
        return None
    breaks = np.flatnonzero(np.diff(t_utc_ns) > step_ns) + 1
    starts, ends = [0, *breaks], [*breaks, len(t_utc_ns)]
    windows = []
    for start, end in zip(starts, ends, strict=True):
        visible_s = float(t_utc_ns[end - 1] - t_utc_ns[start]) / NS_PER_S
        window = VisibilityWindow(t_start_utc_ns=int(t_utc_ns[start]), visible_s=visible_s)
        if visible_s >= frames * ground_rate_cadence_s(float(ground[start]), short_side_deg):
            return window, True
        windows.append(window)
    return max(windows, key=lambda each: each.visible_s), False


def _why_never(
    seen: TargetVisibility,
    satellites: Sequence[Satellite],
    limits: LimitsConfig,
    optics: OpticsConfig,
) -> str:
    """The first condition that is never met together with those before it."""
    named = [each.element_set for each in satellites]
    names = " and ".join(each.name or str(each.norad_id) for each in named)
    held = visibility_conditions(seen, limits, optics)
    asked: list[str] = []
    for name in held:
        asked.append(name)
        if not np.any(np.all([held[each] for each in asked], axis=0)):
            break
    words = {
        "up": f"above {limits.min_altitude_deg + ALTITUDE_MARGIN_DEG:.0f} deg and within reach",
        "in darkness": f"up while the Sun is below {limits.twilight_deg:.0f} deg",
        "lit": "up in darkness and in sunlight",
        "bright": f"so bright that its streak has an SNR of {MIN_SNR:.0f}",
        "in one field": f"within {TOGETHER_FIELDS * min(optics.field_deg):.2f} deg of each other",
    }[asked[-1]]
    remedy = "another --site, or --at a later time"
    if asked[-1] == "in one field":
        seen_deg = seen.apart_deg[np.all([held[each] for each in asked[:-1]], axis=0)]
        words += f" (the closest: {np.min(seen_deg):.1f} deg)"
        remedy = "fewer targets"
    epoch = utc_ns_to_iso(int(seen.t_utc_ns[0]), 0)
    days = round(float(seen.t_utc_ns[-1] - seen.t_utc_ns[0]) / NS_PER_DAY)
    return (
        f"{names} is never {words} from this site in the {days} days from {epoch}, the"
        f" epoch of its elements: try {remedy}"
    )


def expect_visible(
    satellites: Sequence[Satellite],
    site: Site,
    t_utc_ns: int,
    *,
    limits: LimitsConfig,
    optics: OpticsConfig,
) -> None:
    """Raise ConfigError with the reason where the targets cannot be seen at an instant."""
    seen = compute_target_visibility(satellites, site, np.array([t_utc_ns], dtype=np.int64))
    at = utc_ns_to_iso(t_utc_ns, 0)
    try_this = "without --at a time is picked"
    if seen.sun_altitude_deg[0] > limits.twilight_deg:
        raise ConfigError(
            f"at {at} the Sun stands at {seen.sun_altitude_deg[0]:+.1f} deg, below"
            f" {limits.twilight_deg:+.0f} is needed: {try_this}"
        )
    for index, each in enumerate(satellites):
        name = each.element_set.name or str(each.element_set.norad_id)
        altitude_deg = float(seen.altitude_deg[index, 0])
        hour_angle_deg = float(seen.hour_angle_deg[index, 0])
        if not np.isfinite(altitude_deg):
            raise ConfigError(f"at {at} SGP4 has no place for {name}: {try_this}")
        if altitude_deg < limits.min_altitude_deg:
            raise ConfigError(
                f"at {at} {name} stands at an altitude of {altitude_deg:+.1f} deg,"
                f" {limits.min_altitude_deg:+.0f} is needed: {try_this}"
            )
        if abs(hour_angle_deg) > limits.max_hour_angle_deg:
            raise ConfigError(
                f"at {at} {name} stands at hour angle {hour_angle_deg:+.1f} deg, the mount reaches"
                f" {limits.max_hour_angle_deg:.0f}: {try_this}"
            )
        if seen.lit[index, 0] < 0.5:
            raise ConfigError(f"at {at} {name} is in the Earth's shadow: {try_this}")
    if seen.apart_deg[0] > TOGETHER_FIELDS * min(optics.field_deg):
        raise ConfigError(
            f"at {at} the targets stand {seen.apart_deg[0]:.1f} deg apart,"
            f" {TOGETHER_FIELDS * min(optics.field_deg):.2f} at most fit one field: {try_this}"
        )


def visible_duration_s(
    satellites: Sequence[Satellite],
    site: Site,
    t_utc_ns: int,
    *,
    limits: LimitsConfig,
    optics: OpticsConfig,
    up_to_s: float,
) -> float:
    """Return for how many seconds all conditions stay met, at most ``up_to_s``.

    The time counts from ``t_utc_ns``; the conditions are those of ``visibility_conditions``.
    """
    step_s = max(up_to_s / 200.0, 1.0)
    ahead_ns = np.rint(np.arange(0.0, up_to_s + step_s, step_s) * NS_PER_S).astype(np.int64)
    seen = compute_target_visibility(satellites, site, np.int64(t_utc_ns) + ahead_ns)
    good = np.all(list(visibility_conditions(seen, limits, optics).values()), axis=0)
    ends = np.flatnonzero(~good)
    return float(up_to_s if len(ends) == 0 else ends[0] * step_s)
