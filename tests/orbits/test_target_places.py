"""True places of every kind of orbit against skyfield, and how many of them a streak needs."""

import numpy as np
import pytest

from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import Satellite, parse_element_sets
from rsoconsole.simulator import SensorModel
from rsoconsole.simulator.sky.passes import ExposureGeometry, satellite_passes
from rsoconsole.sky import separation_deg, sky_to_pixel, tan_wcs, times
from tests.orbits.test_places import earth, site_below, skyfield_site, skyfield_timescale
from tests.tiers import plain_first
from tests.truth.regimes import EACH, REGIMES, TLES, samples

__all__ = ["earth"]

HUNDREDTH_ARCSEC = 0.01
NS = 1_000_000_000
# Public catalogue of 2020-09-08 and 2023-06-22: one of each regime, drag and deep-space
# resonances (one day, half a day) included.
TRANSCRIBED = """\
INTELSAT 14
1 36097U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2 36097   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
SYNCOM 2 (A 26)
1 00634U 63031A   23171.68089951 -.00000181  00000-0  00000-0 0  9997
2 00634  32.2611 315.7086 0009889 175.0367 108.4350  1.00265605219405
NAVSTAR 48 (USA 151)
1 26407U 00040A   23172.40787153 -.00000010  00000-0  00000-0 0  9995
2 26407  55.2400 258.5844 0156700 290.6776  69.8441  2.00569859168055
DELTA 1 R/B
1   862U 64047B   20252.16579054 -.00000159 +00000-0 +00000-0 0  9991
2   862 015.9623 217.7159 7097683 337.9569 002.5315 02.05102512214896
COSMOS 862
1  9495U 76105A   20245.71669278 -.00000714 +00000-0 +00000-0 0  9998
2  9495 069.7288 170.0245 5790197 253.8478 038.0746 02.00655905199259
ISS (ZARYA)
1 25544U 98067A   23173.35687861  .00014974  00000-0  26726-3 0  9991
2 25544  51.6437 302.9025 0004670  68.4285  27.3619 15.50268647402591
"""


def worst_arcsec(entry, earth, rng) -> float:
    """The largest distance from skyfield's place at five instants of five days."""
    from skyfield.api import EarthSatellite

    satellite = Satellite(entry)
    off = []
    for day in range(5):
        t = entry.epoch_utc_ns + int((day + rng.random()) * times.NS_PER_DAY)
        site = site_below(rng, satellite, t)
        timescale = skyfield_timescale(t)
        instant = timescale.tt_jd(*(float(part) for part in times.jd_tt(t)))
        theirs = EarthSatellite.from_satrec(entry.record, timescale)
        ra, dec, _ = (earth + skyfield_site(site)).at(instant).observe(earth + theirs).radec()
        ours = satellite.astrometric_place(site, np.array([t]))
        place = (ours.ra_icrs_deg[0], ours.dec_icrs_deg[0])
        off.append(separation_deg(*place, ra._degrees, dec.degrees) * 3600.0)
    return max(off)


@pytest.mark.parametrize(
    "entry", parse_element_sets(TRANSCRIBED).entries, ids=lambda each: each.name
)
def test_a_place_of_every_kind_of_orbit_agrees_with_skyfield(entry, earth):
    assert worst_arcsec(entry, earth, np.random.default_rng(entry.norad_id)) < HUNDREDTH_ARCSEC


@pytest.mark.shared_data
@pytest.mark.skipif(not TLES.exists(), reason=f"{TLES} is not here")
@pytest.mark.parametrize("regime", plain_first(2, REGIMES))
def test_places_of_twenty_objects_of_a_regime_agree_with_skyfield(regime, earth):
    rng = np.random.default_rng(20261122)
    chosen = samples(regime)
    assert len(chosen) == EACH
    worst = {each.entry.name: worst_arcsec(each.entry, earth, rng) for each in chosen}
    assert max(worst.values()) < HUNDREDTH_ARCSEC, worst


def test_the_way_of_a_low_satellite_is_drawn_to_a_tenth_of_a_pixel():
    """Against places every 5 ms, over the longest exposure there is: ten degrees of sky."""
    iss = parse_element_sets(TRANSCRIBED).entries[-1]
    satellite = Satellite(iss)
    t0 = iss.epoch_utc_ns
    rng = np.random.default_rng(3)
    bent_px = 0.0
    for _ in range(8):
        t = t0 + int(rng.uniform(0.0, 86_400.0)) * NS
        site = site_below(rng, satellite, t)
        exposure_s = 10.0
        fine = t + np.rint(np.linspace(0.0, exposure_s, 2001) * NS).astype(np.int64)
        places = satellite.astrometric_place(site, fine)
        optics = OpticsConfig()
        wcs = tan_wcs(
            float(places.ra_icrs_deg[1000]),
            float(places.dec_icrs_deg[1000]),
            scale_arcsec_px=optics.scale_arcsec_px,
            rotation_deg=0.0,
            is_flipped=False,
            width_px=optics.width_px,
            height_px=optics.height_px,
        )
        [found] = satellite_passes(
            [(satellite, lambda at: np.zeros(len(at)))],
            ExposureGeometry(
                site=site,
                sensor=SensorModel(),
                wcs=wcs,
                t_start_utc_ns=t,
                exposure_s=exposure_s,
            ),
        )
        share, nodes = np.linspace(0, 1, 2001), np.linspace(0, 1, len(found.streak.x_px))
        x, y = sky_to_pixel(wcs, places.ra_icrs_deg, places.dec_icrs_deg)
        drawn_x = np.interp(share, nodes, found.streak.x_px)
        drawn_y = np.interp(share, nodes, found.streak.y_px)
        seen = (np.abs(x - optics.width_px / 2) < optics.width_px) & (
            np.abs(y - optics.height_px / 2) < optics.height_px
        )
        assert np.max(np.hypot(drawn_x - x, drawn_y - y)[seen]) < 0.1
        eleven = np.linspace(0, 2000, 11).astype(int)
        straight_x = np.interp(share, share[eleven], x[eleven])
        straight_y = np.interp(share, share[eleven], y[eleven])
        bent_px = max(bent_px, float(np.max(np.hypot(straight_x - x, straight_y - y)[seen])))
    assert bent_px > 0.1, "with eleven places it would have failed"
