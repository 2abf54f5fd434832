"""Chooses the night for satellites that the user names: time, exposures, first pointing."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rsoconsole.base import SolverError
from rsoconsole.config import Config
from rsoconsole.orbits import CatalogueEntry, Satellite
from rsoconsole.records import FloatArray
from rsoconsole.simulator.mount.mount_model import MountTraits, systematic_error_deg
from rsoconsole.simulator.nights._visibility import (
    VisibilityWindow,
    compute_target_visibility,
    expect_visible,
    first_window,
    visible_duration_s,
)
from rsoconsole.simulator.nights.night_plan import (
    NightPlan,
    exposure_for_rate_s,
    ground_rate_cadence_s,
    regime,
)
from rsoconsole.sky import (
    SkyPlaces,
    StarCatalogue,
    hour_angle_icrs_deg,
    icrs_of_hour_angle,
    icrs_to_jnow,
    pier_side,
    sky_to_pixel,
    tan_wcs,
    wrap_360,
)
from rsoconsole.words import NS_PER_S

BESIDE_FIELDS = 0.2
"""Largest offset of the first pointing from the first target, in short sides of the field."""
INNER = 0.92
"""Largest distance of a target from the centre at the first two exposures, in half fields."""
COMES_S = 20.0
"""Seconds from the night's start until a low satellite passes the first pointing."""
_TRIES = 60
_PURPOSE = 0x7461726765


def choose_night(
    targets: Sequence[Satellite],
    config: Config,
    *,
    seed: int,
    frames: int,
    at_utc_ns: int | None,
    element_files: Sequence[Path],
    star_file: Path | None,
) -> NightPlan:
    """Plan the first night in which these satellites can be seen together.

    ``at_utc_ns``: start of the night; None: the first suitable time after the newest epoch of the
    targets' elements. ``frames``: number of exposures that the night should have. Site, limits and
    telescope are the configuration's; exposure and cadence suit the targets. ``star_file``: a
    whole-sky index file, for sky that the shipped stars do not cover. Raises ConfigError where the
    targets cannot be seen, SolverError where their sky has no stars.
    """
    site, limits, optics = config.site.to_site(), config.limits, config.optics
    short_side_deg = min(optics.field_deg)
    if at_utc_ns is None:
        epoch_ns = max(each.element_set.epoch_utc_ns for each in targets)
        window = first_window(
            targets,
            site,
            from_utc_ns=-(-epoch_ns // NS_PER_S) * NS_PER_S,
            frames=frames,
            limits=limits,
            optics=optics,
        )
    else:
        expect_visible(targets, site, at_utc_ns, limits=limits, optics=optics)
        longest_s = frames * config.exposure.cadence_s
        visible_s = visible_duration_s(
            targets, site, at_utc_ns, limits=limits, optics=optics, up_to_s=longest_s
        )
        window = VisibilityWindow(t_start_utc_ns=at_utc_ns, visible_s=visible_s)
    span_s = min(window.visible_s, frames * config.exposure.cadence_s)
    ahead_ns = np.rint(np.linspace(0.0, span_s, 60) * NS_PER_S).astype(np.int64)
    seen = compute_target_visibility(targets, site, np.int64(window.t_start_utc_ns) + ahead_ns)
    ground = float(seen.ground_rate_arcsec_s[0])
    in_time = ahead_ns <= round(frames * ground_rate_cadence_s(ground, short_side_deg) * NS_PER_S)
    exposure_s = exposure_for_rate_s(
        float(np.max(seen.rate_arcsec_s[in_time])), optics.scale_arcsec_px
    )
    cadence_s = ground_rate_cadence_s(ground, short_side_deg, exposure_s)
    exposed = config.exposure.model_copy(update={"exposure_s": exposure_s, "cadence_s": cadence_s})
    config = config.model_copy(update={"exposure": exposed})
    first = targets[0].element_set
    is_low = isinstance(first, CatalogueEntry) and regime(first) == "LEO"
    start = _start(targets, config, window.t_start_utc_ns, seed, is_low=is_low)
    names = tuple(each.element_set.name or str(each.element_set.norad_id) for each in targets)
    return NightPlan(
        title=", ".join(names),
        t_start_utc_ns=window.t_start_utc_ns,
        site=site,
        targets=tuple(each.element_set.norad_id for each in targets),
        names=names,
        start_hour_angle_deg=start[0],
        start_declination_deg=start[1],
        exposure_s=exposure_s,
        cadence_s=cadence_s,
        frames=frames,
        element_files=tuple(str(path) for path in element_files),
        star_file=_stars_for(seen.dec_deg[:, in_time], config, star_file, names[0]),
        visible_s=window.visible_s,
        leaps=is_low,
    )


def _start(
    targets: Sequence[Satellite], config: Config, t_start_utc_ns: int, seed: int, *, is_low: bool
) -> tuple[float, float]:
    """Hour angle and declination that the mount must believe in for its first exposure.

    The truth of it lies up to a fifth of the field beside the first target at mid-exposure, to a
    side that keeps every target in the field for a second exposure, if there is one. A low one
    comes by ``COMES_S`` after the night's beginning.
    """
    site, exposure = config.site.to_site(), config.exposure
    mid_s = COMES_S if is_low else exposure.start_latency_s + exposure.exposure_s / 2.0
    mids_s = np.array([mid_s, mid_s + exposure.cadence_s])
    mids = np.int64(t_start_utc_ns) + np.rint(mids_s * NS_PER_S).astype(np.int64)
    places = [each.astrometric_place(site, mids) for each in targets]
    aim_ra_deg, aim_dec_deg = float(places[0].ra_icrs_deg[0]), float(places[0].dec_icrs_deg[0])
    rng = np.random.default_rng([seed, _PURPOSE])
    best: tuple[float, float, float] | None = None
    for _ in range(_TRIES):
        beside_deg = BESIDE_FIELDS * min(config.optics.field_deg) * math.sqrt(rng.random())
        turn = rng.uniform(0.0, 2.0 * math.pi)
        dec_deg = aim_dec_deg + beside_deg * math.cos(turn)
        east_deg = beside_deg * math.sin(turn) / math.cos(math.radians(dec_deg))
        ra_deg = float(wrap_360(aim_ra_deg + east_deg))
        hour_angle_deg = hour_angle_icrs_deg(site, ra_deg, dec_deg, t_start_utc_ns)
        dec_jnow_deg = icrs_to_jnow(ra_deg, dec_deg, t_start_utc_ns)[1]
        worst = 0.0
        for index, t_mid in enumerate(mids):
            # The first exposure follows the stars, the search then holds the hour angle.
            centre = (ra_deg, dec_deg)
            if index > 0:
                centre = icrs_of_hour_angle(site, hour_angle_deg, dec_jnow_deg, int(t_mid))
            worst = max(worst, *(_off_centre(config, centre, each, index) for each in places))
        if best is None or worst < best[0]:
            best = (worst, hour_angle_deg, dec_jnow_deg)
        if worst <= INNER:
            break
    assert best is not None
    return _believed(config, *best[1:])


def _believed(config: Config, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
    """Hour angle and declination reported by a mount that looks there, random errors aside."""
    east_deg, north_deg = systematic_error_deg(
        hour_angle_deg, dec_deg, pier_side(hour_angle_deg), config.site.latitude_deg, MountTraits()
    )
    cos_dec = math.cos(math.radians(dec_deg))
    return hour_angle_deg + east_deg / cos_dec, dec_deg - north_deg


def _off_centre(
    config: Config, centre: tuple[float, float], places: SkyPlaces, index: int
) -> float:
    """Distance of a place from the centre, in half fields: 1 is the edge, whichever is nearer."""
    optics = config.optics
    wcs = tan_wcs(
        *centre,
        scale_arcsec_px=optics.scale_arcsec_px,
        rotation_deg=0.0,
        is_flipped=False,
        width_px=optics.width_px,
        height_px=optics.height_px,
    )
    ra, dec = places.ra_icrs_deg[index : index + 1], places.dec_icrs_deg[index : index + 1]
    x, y = sky_to_pixel(wcs, ra, dec)
    if not (np.isfinite(x[0]) and np.isfinite(y[0])):
        return math.inf
    out = (2.0 * x[0] / optics.width_px - 1.0, 2.0 * y[0] / optics.height_px - 1.0)
    return float(np.max(np.abs(out)))


def _stars_for(
    dec_deg: FloatArray, config: Config, star_file: Path | None, name: str
) -> str | None:
    """File of the stars that this way over the sky needs; None where the shipped ones do."""
    radius_deg = math.hypot(*config.optics.field_deg)
    shipped = StarCatalogue.load()
    furthest_deg = float(dec_deg.flat[int(np.argmax(np.abs(dec_deg)))])
    if shipped.covers(furthest_deg, radius_deg):
        return None
    if star_file is None:
        raise SolverError(
            f"{name} is at declination {furthest_deg:+.1f} deg, and the shipped stars end at"
            f" {shipped.dec_max_deg:.0f}: 'rsoconsole index install' gets the whole sky's"
        )
    return str(star_file)
