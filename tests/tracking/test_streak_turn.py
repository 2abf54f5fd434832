"""What a streak's direction says of its middle: stars upon one end, and stars that drift."""

import dataclasses

import numpy as np
import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.records import Measurement, NotFollowed, TrackState
from rsoconsole.tracking import Following, FollowSettings, FrameInput, Motion, follow
from rsoconsole.tracking.filters.streak_length import across_error_arcsec, end_offset_arcsec
from rsoconsole.tracking.initiation import acquisition
from tests.makers import NS, T0_UTC_NS, geo_measurement

EAST = Motion(150.0, 0.0)
STAR = 15
"""The frame in which a star lies upon an end."""


def streak(frame_id: int, west_arcsec: float, east_arcsec: float, random=None) -> Measurement:
    """Of a geostationary satellite, whose ends lie so far north of its path."""
    whole = geo_measurement(frame_id, cov_sky_arcsec2=(0.09, 0.0, 0.09))
    noise = np.zeros(2) if random is None else random.normal(0.0, 0.3 / 3600.0, 2)
    assert whole.ends_icrs_deg is not None
    (ra_a, dec_a), (ra_b, dec_b) = whole.ends_icrs_deg
    return dataclasses.replace(
        whole,
        ra_icrs_deg=whole.ra_icrs_deg + noise[0],
        dec_icrs_deg=whole.dec_icrs_deg + noise[1] + (west_arcsec + east_arcsec) / 7200.0,
        ends_icrs_deg=(
            (ra_a + noise[0], dec_a + noise[1] + west_arcsec / 3600.0),
            (ra_b + noise[0], dec_b + noise[1] + east_arcsec / 3600.0),
        ),
    )


def followed(streaks: list[Measurement]) -> list:
    settings = FollowSettings(filter=FilterConfig(), half_field_deg=0.62)
    after, records = Following(), []
    for m in streaks:
        t_utc_ns = T0_UTC_NS + (m.frame_id - 1) * 30 * NS
        seen = FrameInput(
            frame_id=m.frame_id, t_mid_utc_ns=t_utc_ns, exposure_s=10.0, measurements=(m,)
        )
        after, said = follow(after, seen, settings)
        records += said
    return records


def followed_as_measured(streaks: list[Measurement]) -> list:
    """Where nothing is made of their direction."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(acquisition, "across_error_arcsec", lambda *_: 0.0)
        return followed(streaks)


def night(seed: int, drift_arcsec: float = 0.0, upon_end_arcsec: float = 0.0) -> list[Measurement]:
    """Thirty frames whose stars drift, turning each streak, and one star upon one end."""
    random = np.random.default_rng(seed)
    return [
        streak(n, -drift_arcsec, drift_arcsec + (upon_end_arcsec if n == STAR else 0.0), random)
        for n in range(1, 31)
    ]


def updates(records: list) -> list[TrackState]:
    return [r for r in records if isinstance(r, TrackState) and r.kind == "updated"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("drift_arcsec", [0.0, 8.0])
def test_a_streak_with_a_star_upon_one_end_is_taken_for_what_it_is_worth(seed, drift_arcsec):
    streaks = night(seed, drift_arcsec, upon_end_arcsec=12.0)
    refused = [r for r in followed_as_measured(streaks) if isinstance(r, NotFollowed)]
    assert [(r.frame_id, r.reason.kind) for r in refused] == [(STAR, "NIS")]
    records = followed(streaks)
    assert not [r for r in records if isinstance(r, NotFollowed)]
    path = geo_measurement(1).dec_icrs_deg
    off = [abs(r.x[2] - path) * 3600.0 for r in updates(records) if r.frame_id >= STAR]
    # The star had moved its middle by 6 arcsec: hardly any of it is believed.
    assert max(off) < 0.6


def test_stars_that_drift_turn_every_streak_and_take_nothing_from_it():
    still, drifting = (updates(followed(night(9, d))) for d in (0.0, 8.0))
    own = updates(followed_as_measured(night(9, 8.0)))
    sigma = [np.sqrt(each[-1].P[2][2]) * 3600.0 for each in (still, drifting, own)]
    assert sigma[1] == pytest.approx(sigma[0], rel=0.02)
    assert sigma[1] == pytest.approx(sigma[2], rel=0.1)


def test_more_is_added_the_further_it_turns():
    added = []
    for turn in (0.0, 5.0, 20.0):
        m = streak(1, -turn, turn)
        assert end_offset_arcsec(m, EAST) == pytest.approx(turn, abs=1e-3)
        added.append(across_error_arcsec(m, EAST, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert added[0] < 0.02 < added[1] < added[2] / 3.0


def test_the_sense_of_a_streak_is_not_known_and_does_not_matter():
    m = streak(1, -7.0, 7.0)
    assert m.ends_icrs_deg is not None
    reverse = dataclasses.replace(m, ends_icrs_deg=m.ends_icrs_deg[::-1])
    assert end_offset_arcsec(m, EAST) == end_offset_arcsec(reverse, EAST)
