"""Marks by hand: without autonomy they start a track, refined they are as good as the light."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config, with_setting
from rsoconsole.control import MarkByHand
from rsoconsole.engine.aim.states import ClockSet, LimitMet, NightEnded
from rsoconsole.engine.operator._hand_marks import detected_measurement, with_mark_figures
from rsoconsole.night import recorded_figures
from rsoconsole.pipeline import HELD, refined_mark, replay
from rsoconsole.pipeline.cycle.decisions import KEPT, TAKEN_BACK
from rsoconsole.pipeline.cycle.track_assignment import KEPT_S, TrackAssignment
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import (
    CommandResult,
    Detection,
    Frame,
    Measurement,
    NotSolved,
    OperatorAction,
    TrackState,
)
from rsoconsole.session import decode, encode
from rsoconsole.sky import sky_to_pixel
from rsoconsole.words import text
from tests.makers import NS, T0_UTC_NS, geo_measurement
from tests.pipeline.test_rulings import night, replayed, say
from tests.rigs.engine_rig import START_DEG, PlainCamera, Rig, rig
from tests.rigs.rewritten import rewrite_log

CONFIG = Config.model_validate({"search": {"recentre": "every"}})
WIDE, HIGH = 6000, 2000
DRAWN_ROWS = 400
FWHM_PX = 2.5
LENGTH_PX = 119.0


class WideCamera(PlainCamera):
    """As wide as a satellite drifts in some frames."""

    def wait_frame(self, timeout_s: float) -> Frame:
        plain = super().wait_frame(timeout_s)
        return dataclasses.replace(plain, pixels=np.zeros((HIGH, WIDE), np.uint16))


def in_hand(frames: set[int] | None = None) -> Rig:
    """The operator has the mount over a satellite that the detector does not see."""
    r = rig(frames or set(), CONFIG)
    r.camera.__class__ = WideCamera
    r.engine.arm()
    r.engine.run(frames=1)
    nudge(r)
    r.mount.at_deg = START_DEG[0] - 0.05, START_DEG[1] - 0.3
    return r


def nudge(r: Rig) -> None:
    assert say(r, "nudge", east_arcmin=0.0, north_arcmin=0.01).ok
    assert r.engine.authority.state == "MANUAL"


def place_px(r: Rig, frame_id: int) -> tuple[float, float]:
    """Where the satellite really is in a frame that was looked at."""
    shown = r.engine.cycle.hand.shown(frame_id)
    since_s = (shown.taken.t_mid_utc_ns - T0_UTC_NS) / NS
    here = geo_measurement(2, ra_deg=START_DEG[0], dec_deg=START_DEG[1], cadence_s=since_s)
    x, y = sky_to_pixel(shown.solution.wcs, here.ra_icrs_deg, here.dec_icrs_deg)
    return float(x), float(y)


def mark(r: Rig, frame_id: int, *, off_px: float = 0.0, **other: Any) -> Any:
    x, y = place_px(r, frame_id)
    half = LENGTH_PX / 2.0
    ends = {"x_a": x - half + off_px, "y_a": y, "x_b": x + half + off_px, "y_b": y}
    return say(r, "mark", frame=frame_id, **ends, **other)


def results(r: Rig) -> list[str]:
    return [text(a.outcome) for a in r.memory.of(OperatorAction) if a.outcome.kind == "ruled"]


def assert_replayed_alike(r: Rig) -> None:
    log = [decode(*encode(record)[::2]) for record in r.memory.records]
    frames = list(replay(log, CONFIG))
    assert all(frame.is_as_recorded for frame in frames)
    assert frames[-1].after == r.engine.following
    assert recorded_figures(log) == track_figures(frames)
    told = rewrite_log([(n, record) for n, record in enumerate(log)], CONFIG)
    assert [record for _, record in told.log] == log


def test_two_marks_while_the_operator_has_the_mount_start_a_track_that_resume_follows():
    r = in_hand({7, 8})
    r.engine.run(frames=4)
    assert mark(r, 3).ok
    assert r.engine.authority.kept is None
    assert mark(r, 4).ok
    assert r.engine.authority.state == "MANUAL"
    kept = r.engine.authority.kept
    assert kept is not None
    assert kept.lead_measured.source == "operator"
    assert results(r) == [
        "frame 3: used: ±2.5″ RA ±2.5″ Dec; the first of a track: mark it in a later frame, too",
        "frame 4: used: ±2.5″ RA ±2.5″ Dec; a track begins with it, to be resumed",
    ]
    r.engine.run(frames=6)
    assert say(r, "resume").ok
    assert r.engine.following.state == "COAST"
    r.engine.run(frames=8)
    # The detector sees it again: what the marks began is what it measures.
    assert r.engine.following.state == "TRACK"
    assert r.engine.following.track_id == kept.track_id
    assert_replayed_alike(r)
    tracks = TrackAssignment()
    for record in r.memory.records:
        tracks.receive(record)
    (track,) = tracks.tracks()
    assert [m.frame_id for m in track.measurements] == [3, 4, 7, 8]


def test_a_third_mark_measures_the_track_that_two_began():
    r = in_hand()
    r.engine.run(frames=5)
    for frame_id in (3, 4, 5):
        assert mark(r, frame_id).ok
    assert results(r)[-1] == "frame 5: used: ±2.5″ RA ±2.5″ Dec"
    assert r.engine.authority.kept.lead_measured.frame_id == 5
    assert r.engine.authority.kept.track_id == 1


def test_marks_that_agree_on_no_motion_start_nothing_and_the_last_one_waits():
    r = in_hand()
    r.engine.run(frames=5)
    assert mark(r, 3).ok
    assert mark(r, 4, off_px=900.0).ok
    assert r.engine.authority.kept is None
    assert not r.memory.of(TrackState)
    assert mark(r, 5, off_px=900.0).ok
    assert r.engine.authority.kept is not None


def test_a_mark_is_taken_back_and_what_it_led_to_with_it():
    r = in_hand({8, 9})
    r.engine.run(frames=5)
    assert mark(r, 3).ok
    assert mark(r, 4).ok
    assert say(r, "take_back").ok
    assert r.engine.authority.kept is None
    assert results(r)[-1] == "frame 4: as if nothing had been said of it"
    assert mark(r, 5).ok
    assert r.engine.authority.kept.lead_measured.frame_id == 5
    assert say(r, "take_back", frame=3).ok
    assert r.engine.authority.kept is None
    assert mark(r, 3).ok
    assert say(r, "resume").ok
    r.engine.run(frames=9)
    assert_replayed_alike(r)
    assert not say(r, "take_back", frame=9).ok


def test_what_was_followed_before_is_kept_until_the_marks_begin_another():
    r = in_hand({1, 2, 3})
    say(r, "resume")
    r.engine.run(frames=4)
    before = r.engine.following
    assert before.track is not None
    nudge(r)
    r.mount.at_deg = START_DEG[0] - 0.05, START_DEG[1] - 0.3
    r.engine.run(frames=7)
    assert mark(r, 6, off_px=900.0).ok
    assert r.engine.authority.kept.track_id == before.track_id
    assert mark(r, 7, off_px=900.0).ok
    assert r.engine.authority.kept.track_id == before.track_id + 1
    say(r, "resume")
    r.engine.run(frames=8)
    assert_replayed_alike(r)


def look_beside(r: Rig, frames: int, later_s: float = 0.0) -> None:
    """Frames in the operator's hand, over a satellite that the detector does not see."""
    r.mount.at_deg = START_DEG[0] - 0.05 + later_s / 240.0, START_DEG[1] - 0.3
    r.engine.run(frames=frames)


def follow_what_is_kept(r: Rig) -> None:
    """Give the mount back, and one frame more."""
    if not r.engine.authority.is_resumable:
        r.engine.arm()
    assert say(r, "resume").ok
    r.engine.run(frames=r.engine.frame_id + 1)


def tracked_and_taken_back() -> Rig:
    """A track that goes on, and a mount that autonomy still has."""
    r = in_hand({1, 2, 3, 4, 5, 6})
    say(r, "resume")
    r.engine.run(frames=6)
    assert r.engine.following.track is not None
    return r


@pytest.mark.parametrize("ended_by", ["limit", "clock", "night"])
def test_marks_after_what_leaves_no_track_to_follow_again_are_replayed_as_the_night_had_them(
    ended_by: str,
):
    r = tracked_and_taken_back()
    triggers = {
        "limit": LimitMet(words="altitude 5 deg, below 20"),
        "clock": ClockSet(step_s=0.4),
        "night": NightEnded(words="rain", parks=False),
    }
    r.engine.handle(triggers[ended_by])
    assert r.engine.authority.kept is None
    last = r.engine.frame_id
    nudge(r)
    look_beside(r, last + 3)
    assert mark(r, last + 2).ok
    assert r.engine.authority.kept is None
    assert mark(r, last + 3).ok
    assert r.engine.authority.kept.track_id > 1
    follow_what_is_kept(r)
    assert_replayed_alike(r)


def test_marks_after_what_was_kept_grew_too_old_are_replayed_as_the_night_had_them():
    r = tracked_and_taken_back()
    assert say(r, "disarm").ok
    assert r.engine.authority.kept is not None
    r.clock.t_utc_ns += round((KEPT_S + 60.0) * NS)
    r.engine._one_turn(is_bounded=False)
    assert r.engine.authority.kept is None
    nudge(r)
    look_beside(r, 9, KEPT_S + 60.0)
    assert mark(r, 8).ok
    assert mark(r, 9).ok
    assert r.engine.authority.kept.track_id == 2
    follow_what_is_kept(r)
    assert_replayed_alike(r)


def test_a_frame_that_was_not_solved_says_so_before_anything_is_made_of_it():
    r = in_hand()
    r.engine.run(frames=3)
    hand = r.engine.cycle.hand
    shown = hand.shown(3)
    blind = dataclasses.replace(
        shown, solution=NotSolved(frame_id=3, reason="4 stars, 8 needed", ms=1.0)
    )
    hand._frames = (dataclasses.replace(hand._frames[-1], observations=blind),)
    outcome = say(r, "mark", frame=3, x_a=1.0, y_a=1.0, x_b=9.0, y_b=1.0)
    assert not outcome.ok
    assert "not solved" in outcome.message


def test_a_mark_that_replaces_nothing_does_not_say_so_on_record():
    r = rig(set(), CONFIG)
    r.camera.__class__ = WideCamera
    r.engine.arm()
    r.engine.run(frames=3)
    ends = {"x_a": 1.0, "y_a": 1.0, "x_b": 9.0, "y_b": 1.0, "frame": 3}
    assert say(r, "mark", **ends).ok
    assert say(r, "mark", replaces=True, **ends).ok
    said = [a.arguments for a in r.memory.of(OperatorAction) if a.verb == "mark"]
    # Each is there twice: as it was accepted, and with what came of it.
    assert [arguments.get("replaces") for arguments in said] == [None, None, True, True]


def test_a_rough_mark_asks_before_it_replaces_a_better_measurement():
    r = rig({*range(1, 9)}, CONFIG)
    r.camera.__class__ = WideCamera
    r.engine.arm()
    r.engine.run(frames=6)
    taken = r.engine.following.lead_measured
    ends = {"x_a": 1.0, "y_a": 0.0, "x_b": 120.0, "y_b": 0.0, "frame": 6, "sigma_px": 90.0}
    asked = say(r, "mark", **ends)
    assert not asked.ok
    assert asked.data["asks"] == "replaces"
    assert asked.data["sigma_arcsec"] == pytest.approx(113.0, rel=0.05)
    assert asked.data["better_arcsec"] == pytest.approx(1.0, rel=0.1)
    assert "yours is ±113″" in asked.message
    # One row of the notice, which says "refused: " first.
    assert len(f"refused: {asked.message}") < 79
    assert r.engine.following.lead_measured == taken
    assert say(r, "mark", replaces=True, **ends).ok
    assert r.engine.following.lead_measured.source == "operator"
    # And back: the detector's own measurement counts again.
    assert say(r, "take_back").ok
    assert r.engine.following.lead_measured == taken


# -- on the light beneath it -------------------------------------------------------------------


def sky_with(streak: tuple[float, float, float, float] | None, peak: float = 40.0) -> np.ndarray:
    """A frame with noise, stars and a straight streak between two ends."""
    rng = np.random.default_rng(4)
    light = rng.normal(700.0, 12.0, (DRAWN_ROWS, 1200))
    y, x = np.mgrid[0:DRAWN_ROWS, 0:1200].astype(float)
    sigma = FWHM_PX / 2.3548
    for _ in range(60):
        sx, sy = rng.uniform(20, 1180), rng.uniform(20, DRAWN_ROWS - 20)
        near = (slice(int(sy) - 10, int(sy) + 11), slice(int(sx) - 10, int(sx) + 11))
        r2 = (x[near] - sx) ** 2 + (y[near] - sy) ** 2
        light[near] += rng.uniform(200, 4000) * np.exp(-r2 / (2 * sigma**2))
    if streak is not None:
        (xa, ya, xb, yb), length = streak, math.dist(streak[:2], streak[2:])
        dx, dy = (xb - xa) / length, (yb - ya) / length
        along = (x - xa) * dx + (y - ya) * dy
        across = (y - ya) * dx - (x - xa) * dy
        ends = np.vectorize(math.erf)
        lit = 0.5 * (
            ends((along / (sigma * 1.4142)).ravel())
            - ends(((along - length) / (sigma * 1.4142)).ravel())
        ).reshape(x.shape)
        light += peak * lit * np.exp(-(across**2) / (2 * sigma**2))
    return np.clip(light, 0, 65535).astype(np.uint16)


STREAK = (540.0, 230.0, 655.0, 252.0)


def rough(ends: tuple[float, ...], sigma: float) -> Detection:
    xa, ya, xb, yb = ends
    return Detection(
        frame_id=1,
        confidence=1.0,
        x_px=(xa + xb) / 2,
        y_px=(ya + yb) / 2,
        x_a_px=xa,
        y_a_px=ya,
        x_b_px=xb,
        y_b_px=yb,
        box_px=(min(xa, xb), min(ya, yb), max(xa, xb), max(ya, yb)),
        length_px=math.dist(ends[:2], ends[2:]),
        width_px=0.0,
        snr=0.0,
        sigma_along_px=sigma,
        sigma_across_px=sigma,
        is_clipped=False,
        method="operator",
    )


@pytest.fixture(scope="module")
def lit() -> np.ndarray:
    return sky_with(STREAK)


@pytest.mark.parametrize(
    ("off", "sigma"),
    [((3, -2, -3, 2), 4.0), ((10, 8, -9, -6), 20.0), ((-30, 20, 35, -25), 60.0)],
    ids=["near", "rough", "one square of the field"],
)
def test_a_rough_mark_becomes_the_streak_beneath_it(lit: np.ndarray, off: Any, sigma: float):
    found = refined_mark(lit, rough(tuple(np.add(STREAK, off)), sigma), star_fwhm_px=FWHM_PX)
    assert found is not None
    middle = (STREAK[0] + STREAK[2]) / 2, (STREAK[1] + STREAK[3]) / 2
    assert math.dist((found.x_px, found.y_px), middle) < 1.0
    assert found.sigma_along_px < 1.0
    assert found.sigma_across_px < 0.5
    assert found.method == "operator"


def test_where_there_is_no_light_a_mark_stays_as_it_was_made():
    dark = sky_with(None)
    for sigma in (2.0, 20.0, 60.0):
        assert refined_mark(dark, rough(STREAK, sigma), star_fwhm_px=FWHM_PX) is None


def test_a_streak_elsewhere_is_not_meant(lit: np.ndarray):
    beside = (540.0, 130.0, 655.0, 152.0)
    assert refined_mark(lit, rough(beside, 4.0), star_fwhm_px=FWHM_PX) is None


@pytest.mark.parametrize("has_pixels", [True, False])
def test_the_engine_says_how_good_a_mark_is_and_why(lit: np.ndarray, has_pixels: bool):
    r = in_hand()
    r.engine.run(frames=3)
    verdicts: Any = r.engine.handlers[MarkByHand].check
    verdicts.__self__._pixels_of = lambda _frame_id: lit if has_pixels else None
    xa, ya, xb, yb = STREAK
    outcome = say(
        r, "mark", frame=3, x_a=xa - 20, y_a=ya + 15, x_b=xb + 20, y_b=yb + 9, sigma_px=50.0
    )
    assert outcome.ok
    (made,) = [m for m in r.memory.of(Measurement) if m.source == "operator"]
    sigma_arcsec = math.sqrt(max(made.cov_sky_arcsec2[0], made.cov_sky_arcsec2[2]))
    if has_pixels:
        assert "refined on the light beneath it" in outcome.message
        assert sigma_arcsec < 2.0
        assert math.dist((made.x_px, made.y_px), ((xa + xb) / 2, (ya + yb) / 2)) < 1.0
    else:
        assert "not kept: it stays as you made it" in outcome.message
        assert sigma_arcsec == pytest.approx(50.0 * 1.26, rel=0.02)


# -- a frame is kept while a mark is made in it ------------------------------------------------


@pytest.mark.slow("a night of a hundred frames")
def test_a_frame_is_kept_while_somebody_marks_in_it_however_many_come_meanwhile():
    r = night(set(range(1, 90)) - {9})
    r.engine.run(frames=12)
    begun = say(r, "begin_mark", frame=9)
    assert begun.ok
    assert begun.data["frames"] == HELD
    r.engine.run(frames=9 + 3 * KEPT)
    markable = r.engine.status().markable_frames or ()
    assert markable == (9, *range(10 + 2 * KEPT, 10 + 3 * KEPT))
    between = 9 + KEPT
    assert "any more" in say(r, "mark", frame=between, x_a=1.0, y_a=1.0, x_b=50.0, y_b=1.0).message
    assert say(r, "mark", frame=9, x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0).ok
    (made,) = [m for m in r.memory.of(Measurement) if m.source == "operator"]
    assert made.frame_id == 9
    assert r.engine.following.state == "TRACK"
    # It can be taken back, and is let go some time later.
    assert "on frame 9" not in say(r, "take_back").message
    r.engine.run(frames=9 + 3 * KEPT + TAKEN_BACK)
    assert min(r.engine.status().markable_frames or ()) > 9 + KEPT
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_a_frame_that_is_too_old_is_refused_when_the_mark_begins():
    r = night(set(range(1, 60)))
    r.engine.run(frames=KEPT + 6)
    refused = say(r, "begin_mark", frame=3)
    assert not refused.ok
    assert "only on frames 7 to 18" in refused.message
    assert not [a for a in r.memory.of(OperatorAction) if a.verb == "begin_mark"]


def test_a_mark_that_is_left_off_lets_its_frame_go():
    r = night(set(range(1, 60)))
    r.engine.run(frames=5)
    assert say(r, "begin_mark", frame=4).ok
    assert say(r, "begin_mark", frame=4, on=False).ok
    r.engine.run(frames=5 + KEPT)
    assert 4 not in (r.engine.status().markable_frames or ())


def test_two_slow_marks_start_a_track_and_a_replay_agrees():
    r = in_hand()
    r.engine.run(frames=4)
    assert say(r, "begin_mark", frame=4).ok
    second = 7
    r.engine.run(frames=4 + KEPT + 2)
    assert mark(r, 4).ok
    assert say(r, "begin_mark", frame=second).ok
    r.engine.run(frames=second + 2 * KEPT)
    assert mark(r, second).ok
    assert r.engine.authority.kept is not None
    assert "a track begins with it" in results(r)[-1]
    assert say(r, "resume").ok
    r.engine.run(frames=second + 2 * KEPT + 3)
    assert r.engine.following.last_track_id == 1
    assert_replayed_alike(r)


def test_the_pixels_of_a_frame_are_kept_while_somebody_marks_in_it(lit: np.ndarray):
    r = in_hand()
    r.engine.configure(with_setting(r.engine.config, "session.keep_frames", "last"))
    r.engine.run(frames=3)
    there = {3: lit}
    r.engine.decisions._pixels_of = there.get
    assert say(r, "begin_mark", frame=3).ok
    there.clear()  # the session keeps those of the last frames alone
    xa, ya, xb, yb = STREAK
    outcome = say(r, "mark", frame=3, x_a=xa - 20, y_a=ya + 15, x_b=xb + 20, y_b=yb, sigma_px=50.0)
    assert "refined on the light beneath it" in outcome.message
    assert not r.engine.decisions._marked_pixels


def test_what_came_of_a_mark_says_how_good_it_is_and_how_far_from_the_automatic_one():
    r = in_hand()
    r.engine.run(frames=3)
    automatic = geo_measurement(3)
    by_hand = dataclasses.replace(
        automatic,
        measurement_id="3-m0",
        dec_icrs_deg=automatic.dec_icrs_deg + 0.6 / 3600.0,
        cov_sky_arcsec2=(0.29**2, 0.0, 0.14**2),
        source="operator",
    )
    shown = dataclasses.replace(r.engine.cycle.hand.shown(3), measurements=(automatic,))
    result = CommandResult(kind="ruled", ruled="taken by hand", frame_id=3, left_alone=1)
    found = detected_measurement(by_hand, shown, None)
    assert found == automatic
    said = text(with_mark_figures(result, by_hand, found))
    assert said == (
        "frame 3: used: ±0.29″ RA ±0.14″ Dec, 0.6″ from the automatic measurement,"
        " which is set aside"
    )
    # What is far away is another streak: it is not what the mark takes the place of.
    away = dataclasses.replace(automatic, dec_icrs_deg=automatic.dec_icrs_deg + 0.1)
    assert (
        detected_measurement(by_hand, dataclasses.replace(shown, measurements=(away,)), None)
        is None
    )
    said = text(with_mark_figures(result, by_hand, None))
    assert said == "frame 3: used: ±0.29″ RA ±0.14″ Dec; 1 more not taken"
