"""Where a close-up lies in a frame, also in one that shows no star."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from rsoconsole.engine.aim.states import Taken
from rsoconsole.engine.tasks.preview import CloseupPlaces
from rsoconsole.records import ChartStar, NotSolved
from rsoconsole.sky import pixel_to_sky
from tests.nights.made_up_night import solution_of
from tests.rigs.engine_rig import rig

WIDE, HIGH = 4656, 3520


def frame(ra_deg: float | None, dec_deg: float) -> Any:
    return SimpleNamespace(pointing_ra_icrs_deg=ra_deg, pointing_dec_icrs_deg=dec_deg)


def reduction(solution: Any) -> Any:
    found = SimpleNamespace(frame_id=2, width_px=WIDE, height_px=HIGH, detections=(), rejected=())
    return SimpleNamespace(solution=solution, detections=found)


def following(ra_deg: float, dec_deg: float) -> Any:
    return SimpleNamespace(lead_measured=None, track=SimpleNamespace(x=(ra_deg, 0.0, dec_deg, 0.0)))


def test_under_cloud_the_close_up_is_where_the_track_is_predicted():
    places, plate = CloseupPlaces(), solution_of(1, 150.0, -5.0)
    ra, dec = (float(each) for each in pixel_to_sky(plate.wcs, 1000.0, 900.0))
    there = places.of(frame(150.0, -5.0), reduction(plate), following(ra, dec))
    assert there == pytest.approx((1000.0, 900.0), abs=0.01)
    # The mount goes on with the satellite; the next frame is all cloud.
    cloud = reduction(NotSolved(frame_id=2, reason="0 stars, 8 needed", ms=1.0))
    there = places.of(frame(150.2, -5.0), cloud, following(ra + 0.2, dec))
    assert there == pytest.approx((1000.0, 900.0), abs=1.0)
    # What lies beside the frame, and a frame of which nobody knows where it looks, have none.
    assert places.of(frame(150.2, -5.0), cloud, following(ra + 9.0, dec)) is None
    assert places.of(frame(None, -5.0), cloud, following(ra + 0.2, dec)) is None


def test_before_the_first_plate_there_is_no_place():
    cloud = reduction(NotSolved(frame_id=2, reason="0 stars, 8 needed", ms=1.0))
    assert CloseupPlaces().of(frame(150.0, -5.0), cloud, following(150.0, -5.0)) is None


def test_the_frames_brightest_stars_are_kept_with_its_picture(monkeypatch: pytest.MonkeyPatch):
    """By autonomy and without."""
    r = rig({1, 2, 3})
    stars = (ChartStar(3.0, 4.0, 500.0), ChartStar(5.0, 6.0, 400.0))
    kept, reduce = {}, r.reducer.reduce

    monkeypatch.setattr(
        r.reducer, "reduce", lambda frame: replace(reduce(frame), chart_stars=stars)
    )
    monkeypatch.setattr(
        r.memory, "save_preview", lambda number, _picture, given=None: kept.update({number: given})
    )
    r.engine.arm()
    r.engine.run(frames=2)
    r.engine.handle(Taken(by="operator"))
    r.engine.run(frames=4)
    assert r.engine.authority.state == "MANUAL"
    assert len(kept) == 4
    assert set(kept.values()) == {stars}
