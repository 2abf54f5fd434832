"""The sky of an hour against the same computed for the instant itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.sky import icrs_to_jnow, lst_deg, separation_deg, sun_icrs, wrap_180
from rsoconsole.sky.epoch import hourly_sky
from rsoconsole.words import NS_PER_S

TENTH_ARCSEC_DEG = 0.1 / 3600.0
INSTANT_NS = st.integers(1_300_000_000, 1_900_000_000).map(lambda s: s * NS_PER_S)


@settings(max_examples=60, deadline=None)
@given(
    ra=st.floats(0, 359.99),
    dec=st.floats(-90, 90),
    t_utc_ns=INSTANT_NS,
    later_s=st.integers(0, 3 * 3600),
)
def test_three_hours_on_the_hours_sky_still_holds_to_a_tenth_of_an_arcsecond(
    ra, dec, t_utc_ns, later_s
):
    epoch, t_ns = hourly_sky(t_utc_ns), t_utc_ns + later_s * NS_PER_S
    # The worst that was found: 0.1000014 arcsec, near an equinox.
    off_deg = separation_deg(*epoch.icrs_to_apparent_deg(ra, dec), *icrs_to_jnow(ra, dec, t_ns))
    assert off_deg < 1.02 * TENTH_ARCSEC_DEG
    turned = float(epoch.sidereal_deg(-81.05, t_ns)) - lst_deg(-81.05, t_ns)
    assert abs(wrap_180(turned)) < TENTH_ARCSEC_DEG


@settings(max_examples=40, deadline=None)
@given(t_utc_ns=INSTANT_NS, later_s=st.integers(0, 6 * 3600))
def test_six_hours_on_the_sun_is_where_it_is_to_two_arcseconds(t_utc_ns, later_s):
    t_ns = t_utc_ns + later_s * NS_PER_S
    ra, dec = hourly_sky(t_utc_ns).sun_apparent_deg(t_ns)
    apart_deg = separation_deg(float(ra), float(dec), *icrs_to_jnow(*sun_icrs(t_ns), t_ns))
    assert apart_deg < 20 * TENTH_ARCSEC_DEG


def test_the_sun_passes_the_equinox_without_a_leap():
    equinox_ns = 1_742_461_260 * NS_PER_S
    hours = equinox_ns + np.arange(-12, 13) * 3600 * NS_PER_S
    ra = np.array([float(hourly_sky(int(t)).sun_apparent_deg(int(t))[0]) for t in hours])
    steps = wrap_180(np.diff(ra))
    assert steps == pytest.approx(np.full(24, 0.038), abs=0.002)
