"""A satellite that flashes shows parts of its streak: how short they may be and be its own."""

import dataclasses

import numpy as np
import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.records import Measurement, NotFollowed, TrackState
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from tests.makers import NS, T0_UTC_NS, geo_measurement

LAST = 20


def part(frame_id: int, share: float, phase: float) -> Measurement:
    """The share of a geostationary satellite's streak that is lit; ``phase`` 0: its western end."""
    whole = geo_measurement(frame_id, cov_sky_arcsec2=(0.3, 0.0, 0.05))
    assert whole.ends_icrs_deg is not None
    (west, dec), (east, _) = whole.ends_icrs_deg
    begins = west + (east - west) * (1.0 - share) * phase
    ends = begins + (east - west) * share
    return dataclasses.replace(
        whole, ra_icrs_deg=(begins + ends) / 2.0, ends_icrs_deg=((begins, dec), (ends, dec))
    )


def records(shares: list[float], seed: int = 1) -> list:
    """Of the frames whose streaks show these shares of their length, somewhere."""
    random = np.random.default_rng(seed)
    settings = FollowSettings(filter=FilterConfig(), half_field_deg=0.62)
    after, said = Following(), []
    for frame_id, share in enumerate(shares, 1):
        seen = FrameInput(
            frame_id=frame_id,
            t_mid_utc_ns=T0_UTC_NS + (frame_id - 1) * 30 * NS,
            exposure_s=10.0,
            measurements=(part(frame_id, share, random.uniform()),),
        )
        after, more = follow(after, seen, settings)
        said += more
    return said


def took_the_last(said: list) -> bool:
    return any(isinstance(r, TrackState) and r.measurement_id and r.frame_id == LAST for r in said)


@pytest.mark.parametrize("seed", range(5))
def test_of_what_flashes_parts_shorter_than_half_are_its_own(seed):
    shares = [0.9, 0.9, 0.8, *[0.6] * (LAST - 4)]
    assert took_the_last(records([*shares, 0.42], seed))


def test_of_what_shines_evenly_they_are_not():
    said = records([*[1.0] * (LAST - 1), 0.42])
    assert not took_the_last(said)
    refused = [r.reason.kind for r in said if isinstance(r, NotFollowed)]
    assert refused == ["moves otherwise"]


def test_two_streaks_that_cloud_cut_make_nothing_flash():
    said = records([*[1.0] * 10, 0.7, 0.7, *[1.0] * (LAST - 13), 0.42])
    assert not took_the_last(said)


def test_a_third_of_the_length_is_nobodys_part():
    assert not took_the_last(records([0.9, 0.9, 0.8, *[0.6] * (LAST - 4), 0.3]))
