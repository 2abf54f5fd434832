"""Which streaks of two frames are one satellite, where several stand in the field."""

import dataclasses
import math

import pytest

from rsoconsole.records import Measurement
from rsoconsole.tracking.initiation.chains import pairs_between
from tests.makers import geo_measurement

EXPOSURE_S = 10.0
AWAY_ARCSEC = ((0.0, 0.0), (56.0, 66.0), (317.0, 161.0))
"""Members of a slot (Amazonas 2, 3 and 5 in June 2023), west and south of the first."""


def slot(frame_id: int, members: int, bent_deg: float = 0.0) -> list[Measurement]:
    """Streaks that all stand askew by an angle."""
    return [
        bent(
            geo_measurement(frame_id, ra_deg=150.0 - west / 3586.3, dec_deg=-5.0 - south / 3600.0),
            bent_deg,
        )
        for west, south in AWAY_ARCSEC[:members]
    ]


def bent(m: Measurement, angle_deg: float) -> Measurement:
    """Its ends turned about its middle, as drifting stars turn them."""
    assert m.ends_icrs_deg is not None
    (ra, dec), _ = m.ends_icrs_deg
    cos_dec = math.cos(math.radians(m.dec_icrs_deg))
    east, north = (ra - m.ra_icrs_deg) * cos_dec, dec - m.dec_icrs_deg
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    east, north = c * east - s * north, s * east + c * north
    ends = (
        (m.ra_icrs_deg + east / cos_dec, m.dec_icrs_deg + north),
        (m.ra_icrs_deg - east / cos_dec, m.dec_icrs_deg - north),
    )
    return dataclasses.replace(m, ends_icrs_deg=ends)


@pytest.mark.parametrize("bent_deg", [0.0, 3.0, 6.0])
def test_members_of_a_slot_find_themselves_where_the_stars_drift(bent_deg):
    """A streak points to where its neighbour will be, but all have gone one way."""
    firsts, seconds = slot(1, 3, bent_deg), slot(2, 2, bent_deg)
    found = pairs_between(firsts, seconds, EXPOSURE_S)
    assert [firsts.index(found[second]) for second in seconds] == [0, 1]


def test_one_of_another_orbit_finds_itself_too():
    other = [
        geo_measurement(n, ra_deg=150.3, rate_dec_deg_s=0.003, rate_deg_s=0.002) for n in (1, 2)
    ]
    firsts, seconds = [*slot(1, 2), other[0]], [other[1], *slot(2, 2)]
    found = pairs_between(firsts, seconds, EXPOSURE_S)
    assert [firsts.index(found[second]) for second in seconds] == [2, 0, 1]


def test_what_moves_otherwise_than_its_streak_says_is_no_pair():
    firsts = slot(1, 2)
    seconds = [
        dataclasses.replace(each, dec_icrs_deg=each.dec_icrs_deg + 0.1) for each in slot(2, 2)
    ]
    assert pairs_between(firsts, seconds, EXPOSURE_S) == {}
