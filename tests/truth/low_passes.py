"""Passes of real low satellites over a site, and the streaks that a telescope would measure there.

Their truth is SGP4 of published element sets, moved by no code of the product's own orbits.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from rsoconsole.orbits import PredictedPosition, Satellite, StreakEnds
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import icrs_to_altaz, iso_to_utc_ns, site_gcrs, wrap_180
from rsoconsole.words import NS_PER_S
from tests.truth.regimes import TLES, samples

SITE = Site(latitude_deg=45.0, longitude_deg=8.0, elevation_m=200.0)
MIN_ALTITUDE_DEG = 20.0
END_ARCSEC = 0.3 * 1.26
SCATTER_S = 0.015
STEP_S = 60
FAST_ARCSEC_S = 0.6 * 3600.0


def are_there() -> bool:
    """Whether the element files that these passes are of lie beside the project."""
    return (TLES / "mix_20230622.tle").exists()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LowPass:
    """One pass above 20 deg, but for less than a minute at either end."""

    satellite: Satellite
    norad_id: int
    rise_utc_ns: int
    set_utc_ns: int
    top_altitude_deg: float
    fastest_arcsec_s: float


def low_passes(count: int = 30, site: Site = SITE) -> tuple[LowPass, ...]:
    """Passes of two days that culminate between 25 and 85 deg, at random; five are fast ones."""
    return _all_passes(site)[:count]


@cache
def _all_passes(site: Site) -> tuple[LowPass, ...]:
    t = iso_to_utc_ns("2023-06-22T00:00:00Z") + np.arange(0, 2 * 86_400, STEP_S) * NS_PER_S
    found = []
    for sample in samples("low orbit", 20):
        if sample.entry.eccentricity < 0.1:
            found += _of(Satellite(sample.entry), sample.entry.norad_id, site, t)
    order = np.random.default_rng(5).permutation(len(found))
    fast = [n for n in order if found[n].fastest_arcsec_s > FAST_ARCSEC_S][:5]
    others = [n for n in order if n not in fast]
    return tuple(found[n] for n in [*fast, *others])


def _of(satellite: Satellite, norad_id: int, site: Site, t: FloatArray) -> list[LowPass]:
    altitude, speed = np.full(len(t), -90.0), np.zeros(len(t))
    near = _is_about_as_high(satellite, site, t)
    places = satellite.astrometric_place(site, t[near])
    altitude[near], _ = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t[near])
    east = places.ra_rate_deg_s * np.cos(np.radians(places.dec_icrs_deg))
    speed[near] = 3600.0 * np.hypot(east, places.dec_rate_deg_s)
    is_up = altitude > MIN_ALTITUDE_DEG
    found = []
    for n in np.flatnonzero(~is_up[:-1] & is_up[1:]):
        last = n + 1 + int(np.argmin(is_up[n + 1 :]))
        top = float(altitude[n : last + 1].max())
        if last > n + 3 and 25.0 <= top <= 85.0:
            found.append(
                LowPass(
                    satellite=satellite,
                    norad_id=norad_id,
                    rise_utc_ns=int(t[n + 1]),
                    set_utc_ns=int(t[last - 1]),
                    top_altitude_deg=top,
                    fastest_arcsec_s=float(speed[n : last + 1].max()),
                )
            )
    return found


def _is_about_as_high(satellite: Satellite, site: Site, t: FloatArray) -> FloatArray:
    """Where an exact look is worth it: over a round Earth at most 3 deg too low."""
    place = site_gcrs(site, t)[0]
    line = satellite.position_gcrs(t)[0] - place
    up = np.sum(line * place, 1) / np.linalg.norm(line, axis=1) / np.linalg.norm(place, axis=1)
    return up > np.sin(np.radians(MIN_ALTITUDE_DEG - 3.0))


def streak_of(
    one: LowPass,
    t_mid_utc_ns: int,
    random: np.random.Generator,
    *,
    exposure_s: float = 0.2,
    bias_s: float = 0.0,
    scatter_s: float = SCATTER_S,
    shake_arcsec: float = 0.0,
    hidden: float = 0.0,
    site: Site = SITE,
) -> StreakEnds:
    """What a frame shows, ends to 0.3 px, the shutter late at random; in either sense.

    ``shake_arcsec``: what the ends are off beyond what is said of them; ``hidden``: the share of
    the streak that is not to be seen at its end.
    """
    half_ns = round(exposure_s / 2.0 * NS_PER_S)
    t = np.array([t_mid_utc_ns - half_ns, t_mid_utc_ns + half_ns])
    late_ns = round(float(random.normal(bias_s, scatter_s)) * NS_PER_S)
    places = one.satellite.astrometric_place(site, t + late_ns)
    if hidden:
        t = np.array([t[0], t[1] - round(hidden * exposure_s * NS_PER_S)])
        places = one.satellite.astrometric_place(site, t + late_ns)
    off_deg = random.normal(0.0, np.hypot(END_ARCSEC, shake_arcsec) / 3600.0, (2, 2))
    streak = StreakEnds(
        t_open_utc_ns=int(t[0]),
        t_close_utc_ns=int(t_mid_utc_ns + half_ns),
        ra_icrs_deg=places.ra_icrs_deg + off_deg[0] / np.cos(np.radians(places.dec_icrs_deg)),
        dec_icrs_deg=places.dec_icrs_deg + off_deg[1],
        sigma_along_arcsec=np.full(2, END_ARCSEC),
        sigma_across_arcsec=np.full(2, END_ARCSEC),
    )
    return streak if random.random() < 0.5 else streak.reversed


def off_arcsec(one: LowPass, place: PredictedPosition, site: Site = SITE) -> FloatArray:
    """(2,) truth minus a predicted place, east and north."""
    true = one.satellite.astrometric_place(site, np.array([place.t_utc_ns]))
    east = wrap_180(float(true.ra_icrs_deg[0]) - place.ra_icrs_deg)
    east *= np.cos(np.radians(place.dec_icrs_deg))
    return 3600.0 * np.array([east, float(true.dec_icrs_deg[0]) - place.dec_icrs_deg])


def sigmas_off(off: FloatArray, place: PredictedPosition) -> float:
    """Its length in units of the ellipse that was stated."""
    return float(np.sqrt(off @ np.linalg.solve(place.covariance_arcsec2, off)))


def in_true_sense(one: LowPass, streak: StreakEnds) -> StreakEnds:
    """As SGP4 runs through it."""
    true = one.satellite.astrometric_place(SITE, streak.ends_utc_ns)
    turn = sum(
        np.diff(theirs)[0] * np.diff(ours)[0]
        for theirs, ours in (
            (true.ra_icrs_deg, streak.ra_icrs_deg),
            (true.dec_icrs_deg, streak.dec_icrs_deg),
        )
    )
    return streak if turn > 0.0 else streak.reversed
