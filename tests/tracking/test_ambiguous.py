"""Two tracks and one streak that fits both alike: how long each waits for the other."""

import dataclasses

import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.records import Measurement, Miss, TrackState
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from tests.makers import NS, T0_UTC_NS, geo_measurement

APART_DEG = 24.0 / 3600.0
BOTH, HIDDEN, ONE = 12, 12, 14
"""Frames that show both, none (cloud), and one of them alone."""


def shown(frame_id: int, ra_deg: float = 150.0) -> Measurement:
    m = geo_measurement(frame_id, ra_deg=ra_deg, cov_sky_arcsec2=(9.0, 0.0, 9.0))
    return dataclasses.replace(m, measurement_id=f"{frame_id}-{round((ra_deg - 150.0) * 1e4)}")


def records(most_ambiguous: int) -> list:
    settings = FollowSettings(
        filter=FilterConfig(most_ambiguous=most_ambiguous), half_field_deg=0.62
    )
    after, said = Following(), []
    for frame_id in range(1, BOTH + HIDDEN + ONE + 1):
        measurements: tuple[Measurement, ...] = ()
        if frame_id <= BOTH:
            measurements = (shown(frame_id), shown(frame_id, 150.0 + APART_DEG))
        elif frame_id > BOTH + HIDDEN:  # between where each is believed to be
            measurements = (shown(frame_id, 150.0 + APART_DEG / 2.2),)
        seen = FrameInput(
            frame_id=frame_id,
            t_mid_utc_ns=T0_UTC_NS + (frame_id - 1) * 30 * NS,
            exposure_s=10.0,
            measurements=measurements,
        )
        after, more = follow(after, seen, settings)
        said += more
    return said


def ambiguous_and_taken(said: list) -> tuple[list[int], list[int]]:
    """Frames behind the cloud in which a track could not be told apart, and was measured."""
    late = [r for r in said if getattr(r, "frame_id", 0) > BOTH + HIDDEN]
    unclear = {
        r.frame_id for r in late if isinstance(r, Miss) and r.reason.kind == "cannot be told apart"
    }
    taken = {r.frame_id for r in late if isinstance(r, TrackState) and r.kind == "updated"}
    return sorted(unclear), sorted(taken)


@pytest.mark.parametrize("most", [2, 4])
def test_after_so_many_frames_the_likelier_takes_it_and_goes_on(most):
    unclear, taken = ambiguous_and_taken(records(most))
    first = BOTH + HIDDEN + 1
    assert unclear == list(range(first, first + most))
    assert taken == list(range(first + most, BOTH + HIDDEN + ONE + 1))


def test_with_a_far_limit_one_waits_until_the_other_has_ended():
    unclear, taken = ambiguous_and_taken(records(1000))
    assert len(unclear) > 8
    assert min(taken) > max(unclear)
