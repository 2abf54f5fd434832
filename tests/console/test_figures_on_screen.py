"""What an observer reads off the panes: each figure with its word, once, and of what it is."""

import dataclasses
import math
import re
from pathlib import Path
from typing import Any, cast

import pytest
from textual.containers import VerticalScroll
from textual.pilot import Pilot

from rsoconsole.cli.demo import demo
from rsoconsole.config import Config
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.ask import GotoDialog
from rsoconsole.console.dialogs.help import HelpDialog
from rsoconsole.console.drawing.plot import Line
from rsoconsole.console.night.engine_view import EngineView, read_engine_view
from rsoconsole.console.orbit.lines import orbit_lines, orbit_pane_contents, target_words
from rsoconsole.console.panes.last_line import key_line, live_keys
from rsoconsole.console.tuning.lines import TuneWords, tune_lines
from rsoconsole.console.tuning.tuning_pane import TuneFigures, Tuning
from rsoconsole.console.tuning.what_if_watch import (
    count_present_settings_frames,
    lead_track_frames,
    track_quality,
)
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.leaving import time_left_in_field_s
from rsoconsole.console.words.panels import confidence_lines, nis_lines, residual_lines
from rsoconsole.console.words.tunable import NAMES
from rsoconsole.console.words.words import top_lines
from rsoconsole.night import (
    ELSEWHERE,
    FrameRow,
    LogLine,
    Night,
    NightView,
    TrackFigures,
    line_of,
    recorded_figures,
)
from rsoconsole.night.log_lines import append_line
from rsoconsole.night.night_view import Pointing
from rsoconsole.records import (
    Cause,
    Detections,
    Event,
    FollowedAgain,
    HiddenBy,
    Miss,
    Missed,
    Solution,
    StateChange,
    Topic,
)
from rsoconsole.session import SessionReader
from rsoconsole.words import duration_words
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.nights.orbit_night import estimate_of, folded, state, to
from tests.rigs.engine_rig import solution_at
from tests.rigs.seat_rig import FakeWire, play, until

SIZE = (120, 40)


def plain(lines: list[Line]) -> str:
    return "\n".join("".join(text for text, _ in line) for line in lines)


def figures(**changes: Any) -> TrackFigures:
    return dataclasses.replace(
        recorded_figures([]),
        frames=40,
        updates=40,
        misses=0,
        residual_rms_arcsec=0.5,
        nis_mean=2.0,
        nis_band=(1.42, 2.68),
        inside_3sigma=1.0,
        state="TRACK",
        log_likelihood_mean=-1.0,
        **changes,
    )


# -- the tuning pane ------------------------------------------------------------------------------


def tuned(now: TrackFigures, then: TrackFigures | None, has_changes: bool, **words: Any) -> str:
    tuning = Tuning()
    tuning.see({"detector.tau": 0.1})
    if has_changes:
        tuning.step(1)
    return plain(tune_lines(tuning, TuneFigures(now, then), words=TuneWords(**words))(47, 22))


def test_fewer_measurements_are_said_to_make_the_figures_no_comparison():
    fewer = dataclasses.replace(figures(), updates=26, misses=14, residual_rms_arcsec=0.3)
    said = " ".join(tuned(figures(), fewer, True).split())
    assert "14 fewer frames are measured if tried: rms and NIS are of other frames" in said
    assert "not comparable" not in tuned(figures(), figures(), True)


def test_where_nothing_is_tried_the_old_comparison_is_gone():
    said = tuned(figures(), dataclasses.replace(figures(), residual_rms_arcsec=9.87), False)
    assert "nothing tried" in said
    assert "9.87" not in said


def test_figures_of_frames_by_two_settings_say_so():
    assert "12 of 40 by what is in force now" in tuned(figures(), None, False, of_present=12)
    for all_of_one in (None, 40):
        assert "in force now" not in tuned(figures(), None, False, of_present=all_of_one)


def test_frames_by_the_same_settings_count_whenever_they_were():
    q = "filter.q_multiplier"
    rows = tuple(
        FrameRow(frame_id=n, is_reduced=True, settings={q: 2.25} if n in {5, 6, 7} else {})
        for n in range(1, 11)
    )
    back = NightView(rows=rows, config=Config(), changed={q: 1.0})
    assert count_present_settings_frames(back, 10) == 7
    assert count_present_settings_frames(dataclasses.replace(back, changed={q: 2.25}), 10) == 3
    assert (
        count_present_settings_frames(dataclasses.replace(back, changed={"log.level": "x"}), 4) == 3
    )


def test_what_is_tried_is_judged_over_the_same_frames():
    def said(change: float, **words: Any) -> str:
        then = dataclasses.replace(figures(), log_likelihood_mean=-1.0 + change)
        return " ".join(tuned(figures(), then, True, **words).split())

    assert "τ 0.125 against 0.1: no difference (Δ log L -0.01 over 40 frames)" in said(-0.01)
    assert ": better (Δ log L +0.20" in said(0.2)
    assert ": worse (Δ log L -0.20" in said(-0.2)
    assert "τ 0.125 against as it was: no difference" in said(0.0, of_present=12)
    fewer = dataclasses.replace(figures(), updates=26)
    assert "Δ log L" not in tuned(figures(), fewer, True)


def test_what_was_applied_is_named_with_both_values():
    tuning = Tuning()
    tuning.see({"filter.q_multiplier": 1.0})
    tuning.row = NAMES.index("filter.q_multiplier")
    tuning.changes = {"filter.q_multiplier": 2.25}
    tuning.apply()
    tuning.see({"filter.q_multiplier": 2.25})
    lines = plain(tune_lines(tuning, TuneFigures(figures()))(60, 30))
    assert "tune · Q× 1 → 2.25 in force" in lines


def test_a_cross_at_the_mean_nis_has_its_band():
    low = dataclasses.replace(figures(), nis_mean=1.37)
    assert "✓ from 1.42 to 2.68" in tuned(low, None, False)
    assert "✓ from" not in tuned(figures(), None, False)


# -- how good the track is, in one place ----------------------------------------------------------


def measured(n: int, residual: float, nis: float, sigma: float = 1.0) -> FrameRow:
    return FrameRow(
        frame_id=n,
        is_reduced=True,
        is_followed=True,
        residual_arcsec=(residual, 0.0),
        sigma_arcsec=(sigma, sigma),
        nis=nis,
    )


def test_the_orbit_s_pane_says_how_good_the_track_is():
    rows = (
        FrameRow(frame_id=1, miss="no detection", is_reduced=True),  # before it was followed
        measured(2, 3.0, 9.0),
        measured(3, 4.0, 16.0),
        FrameRow(frame_id=4, miss="no detection", is_reduced=True),
        FrameRow(frame_id=5, miss=ELSEWHERE, is_reduced=True, was_sought=False),
    )
    view = dataclasses.replace(
        folded(state(5), to(5, "ACQUIRE", "TRACK"), estimate_of(5)).view(),
        rows=rows,
        track_frame_id=2,
        folder=None,
    )
    found = track_quality(view)
    assert found is not None
    assert (found.frames, found.misses) == (3, 1)
    assert found.residual_rms_arcsec == pytest.approx(math.sqrt(12.5))
    assert (found.nis_mean, found.inside_3sigma) == (12.5, 0.5)
    said = plain(orbit_lines(orbit_pane_contents(view, EngineView(reach="recorded"), None), 90, 20))
    assert "rms 3.54″" in said
    assert "3σ holds 50%" in said
    assert "1 missed" in said
    assert "NIS 12.5 /2 (ideal 2" in said
    assert "lag-1" not in said  # too few
    assert track_quality(dataclasses.replace(view, track=None)) is None


@pytest.mark.parametrize(("signs", "is_white"), [((1, 1), False), ((1, -1, -1, 1), True)])
def test_residuals_that_resemble_each_other_are_said_to(signs: tuple[int, ...], is_white: bool):
    rows = tuple(measured(n, 2.0 * signs[n % len(signs)], 2.0) for n in range(1, 41))
    view = dataclasses.replace(
        folded(state(5), to(5, "ACQUIRE", "TRACK"), estimate_of(5)).view(), rows=rows
    )
    view = dataclasses.replace(view, track_frame_id=1, folder=None)
    found = track_quality(view)
    assert found is not None
    assert found.lag_one is not None
    assert (abs(found.lag_one) < found.lag_one_bound) == is_white
    lines = orbit_lines(orbit_pane_contents(view, EngineView(reach="recorded"), None), 90, 20)
    (ink,) = [ink for line in lines for text, ink in line if "lag-1 " in text]
    assert ink == ("" if is_white else "warn")


def test_a_size_that_the_prior_gives_says_so():
    def words(prior: str) -> str:
        estimate = dataclasses.replace(estimate_of(5), prior=prior)
        shown = orbit_pane_contents(
            folded(state(5), to(5, "ACQUIRE", "TRACK"), estimate).view(),
            EngineView(reach="recorded"),
            None,
        )
        return plain(orbit_lines(shown, 90, 20)) + " | " + " ".join(target_words(shown)[1:])

    assert words("geo").count("km by prior") == 2
    assert "by prior" not in words("none").replace("constrained by prior", "")


def test_the_track_s_quality_agrees_with_the_tuning_pane_s_figures(tmp_path: Path):
    """Two ways to the same figures: the fold's rows, and the log's records."""
    writer = night.begin(tmp_path / "n")
    night.armed(writer)
    night.add_frames(writer, range(1, 31), missed=(12, 20))
    reader, fold = SessionReader(tmp_path / "n"), Night(tmp_path / "n", {}, Config())
    away = night.solution_of(20, 10.0, 0.0)
    records = [
        (seq, t, away if isinstance(record, Solution) and record.frame_id == 20 else record)
        for seq, t, record in reader.records()
    ]
    for _, t_utc_ns, record in records:
        fold.fold_record(t_utc_ns, record)
    writer.close()
    view = fold.view()
    assert view.rows[-11].miss == ELSEWHERE
    told = [record for *_, record in records]
    theirs = recorded_figures(told, len(lead_track_frames(view, 20)), of_lead=True)
    ours = track_quality(view, 20)
    assert ours is not None
    assert ours.frames == theirs.frames
    assert ours.misses == 1  # the other frame looked elsewhere
    assert ours.residual_rms_arcsec == pytest.approx(theirs.residual_rms_arcsec)
    assert ours.nis_mean == pytest.approx(theirs.nis_mean)
    assert ours.inside_3sigma == pytest.approx(theirs.inside_3sigma)
    assert ours.misses == theirs.misses


# -- each sigma and each NIS with its word --------------------------------------------------------


def test_three_sigma_says_of_what():
    view = NightView(rows=(measured(1, 0.5, 1.5),))
    assert "bounds 3σ 3.00″" in plain(residual_lines(view, "east", 47, 5))
    assert "(ideal 2)" in plain(nis_lines(view, 47, 1))


# -- what is no miss ------------------------------------------------------------------------------


def test_a_frame_in_which_nobody_looked_for_anything_is_no_miss():
    sought = FrameRow(frame_id=1, is_reduced=True)
    lines = confidence_lines(NightView(rows=(sought,)), 47, 5)[1:]
    assert "○" in plain(lines)
    unsought = dataclasses.replace(sought, was_sought=False)
    assert "○" not in plain(confidence_lines(NightView(rows=(unsought,)), 47, 5)[1:])


def solved_at(n: int, ra_deg: float) -> Solution:
    return dataclasses.replace(solution_at(ra_deg, -5.0), frame_id=n)


@pytest.mark.parametrize(("off_deg", "is_miss"), [(0.0, True), (10.0, False)])
def test_a_frame_that_looked_elsewhere_is_no_miss(off_deg: float, is_miss: bool):
    taken = dataclasses.replace(night.taken(6, 150.0, -5.0), width_px=4000, height_px=3000)
    # The reference pixel is the corner: a little inside of it.
    solution = solved_at(6, 150.0 - 0.5 - off_deg)
    wcs = dataclasses.replace(solution.wcs, crval_dec_deg=-5.5)
    solution = dataclasses.replace(solution, wcs=wcs)
    found = folded(
        to(3, "ACQUIRE", "TRACK"),
        state(5),
        taken,
        solution,
        state(6, "predicted"),
        Miss(frame_id=6, reason=Missed(kind="no detection"), track_id=1),
    )
    row = found.row(6)
    assert row is not None
    assert row.was_sought is is_miss
    assert (row.miss == ELSEWHERE) is not is_miss
    said = found.log[-1].text
    assert ("miss: no detection" in said) is is_miss
    assert ("no miss: frame 0006 was not pointed at it" in said) is not is_miss


# -- the field by hand ----------------------------------------------------------------------------


def by_hand(**changes: Any) -> tuple[NightView, EngineView]:
    track = dataclasses.replace(night.state_of(6, 150.0, -5.0, "updated"), t_utc_ns=night.t_of(6))
    row = FrameRow(
        frame_id=7,
        t_utc_ns=night.t_of(7),
        is_solved=True,
        plate_icrs_deg=(150.0, -5.0),
        rotation_deg=0.0,
    )
    view = NightView(
        config=Config(),
        state="MANUAL",
        state_since_utc_ns=night.t_of(6),
        kept_track=track,
        frame=night.taken(7, 150.0, -5.0),
        rows=(row,),
    )
    told = {"state": "MANUAL", "holder": "operator", "kept": "INTELSAT 21", "is_tracking": True}
    return view, read_engine_view(told | {"now_utc_ns": night.t_of(6)} | changes)


def test_by_hand_it_is_said_when_the_satellite_leaves_the_field():
    view, engine = by_hand()
    assert view.config is not None
    assert view.frame is not None
    assert view.kept_track is not None
    left_s = time_left_in_field_s(view, view.kept_track, view.rows[0], night.t_of(6))
    half_arcsec = 0.5 * view.frame.width_px * view.config.optics.scale_arcsec_px
    rate = abs(view.kept_track.x[1]) * 3600.0 * math.cos(math.radians(5.0))
    assert left_s == pytest.approx(half_arcsec / rate, rel=1e-6)
    said = plain(figure_lines(view, engine, None, 120, 5))
    assert f"INTELSAT 21 leaves the field in {left_s / 60.0:.0f} min" in said
    late = read_engine_view(
        {"state": "MANUAL", "kept": "INTELSAT 21", "now_utc_ns": night.t_of(6) + 3600 * NS}
    )
    assert "INTELSAT 21 is out of the field" in plain(figure_lines(view, late, None, 120, 5))


@pytest.mark.parametrize(
    "changes", [{"is_slewing": True}, {"is_tracking": False}, {"kept": None}, {"state": "IDLE"}]
)
def test_nothing_is_said_of_a_field_that_does_not_go_with_the_stars(changes: dict[str, Any]):
    view, engine = by_hand(**changes)
    assert "the field" not in plain(figure_lines(view, engine, None, 120, 5))


def test_after_a_slew_by_hand_nothing_is_said_of_the_field_before_it():
    view, engine = by_hand()
    row = dataclasses.replace(view.rows[0], mount_icrs_deg=(150.0, -5.0))
    later = dataclasses.replace(row, frame_id=8, mount_icrs_deg=(157.5, -5.0), is_solved=None)
    for rows, is_said in (((row,), True), ((row, later), False)):
        seen = dataclasses.replace(view, rows=rows)
        said = plain(figure_lines(seen, engine, None, 120, 5))
        assert ("leaves the field" in said) is is_said
    ordered = Pointing(
        t_utc_ns=night.t_of(6), ra_icrs_deg=157.5, dec_icrs_deg=-5.0, is_ordered=True
    )
    sent = dataclasses.replace(view, pointing=ordered)
    assert "leaves the field" not in plain(figure_lines(sent, engine, None, 120, 5))


def held(now_utc_ns: int, **changes: Any) -> tuple[NightView, EngineView]:
    """Autonomy has the mount and moves nothing; the frames go on."""
    view, _ = by_hand()
    view = dataclasses.replace(view, state="TRACK", track=view.kept_track, kept_track=None)
    told = {"state": "TRACK", "holder": "autonomy", "is_held": True, "is_tracking": True}
    named = {"target": "INTELSAT 21", "now_utc_ns": now_utc_ns}
    return view, read_engine_view(told | named | changes)


def test_held_it_is_said_when_the_satellite_leaves_the_field_and_which_key_goes_after_it():
    view, engine = held(night.t_of(6))
    said = plain(figure_lines(view, engine, None, 120, 5))
    assert re.search(r"INTELSAT 21 leaves the field in \d+ (min|s)", said)
    view, late = held(night.t_of(6) + 3600 * NS)
    said = plain(figure_lines(view, late, None, 120, 5))
    assert "INTELSAT 21 is outside the field: h follows it again" in said
    said = plain(figure_lines(view, late, None, 120, 5, keymap={"hold_or_resume": "f7"}))
    assert "f7 follows it again" in said


def test_held_nothing_is_said_of_a_field_that_a_slew_is_leaving_or_that_autonomy_follows():
    view, engine = held(night.t_of(6))
    slew = Pointing(t_utc_ns=night.t_of(8), ra_icrs_deg=151.0, dec_icrs_deg=-5.0, is_ordered=True)
    slewing = dataclasses.replace(view, pointing=slew)
    assert "the field" not in plain(figure_lines(slewing, engine, None, 120, 5))
    view, free = held(night.t_of(6), is_held=False)
    assert "the field" not in plain(figure_lines(view, free, None, 120, 5))


# -- cloud, and what is held for it ---------------------------------------------------------------

IN_CLOUD = Missed(kind="no detection", hidden_by=(HiddenBy(kind="fewer stars", stars=3),))


def missed(n: int, reason: Missed) -> tuple[Any, ...]:
    found = Detections(frame_id=n, width_px=4000, height_px=3000, detections=())
    change = StateChange(
        frame_id=n, before="TRACK", after="COAST", reason=Cause(kind="missed", missed=reason)
    )
    taken = night.taken(n, 150.0, -5.0)
    return taken, found, state(n, "predicted"), Miss(frame_id=n, reason=reason, track_id=1), change


@pytest.mark.parametrize(
    ("reason", "is_named"), [(IN_CLOUD, True), (Missed(kind="no detection"), False)]
)
def test_under_cloud_the_last_line_names_the_key_that_waits_for_the_stars(
    reason: Missed, is_named: bool
):
    view = folded(to(3, "ACQUIRE", "TRACK"), state(5), *missed(6, reason)).view()
    assert view.is_in_cloud is is_named
    engine = read_engine_view({"state": "COAST", "holder": "autonomy"})
    for width in (80, 100):
        keys = live_keys(engine, can_act=True, is_in_cloud=view.is_in_cloud)
        line = plain(key_line(keys)(width, 1))
        assert ("w Hold until it clears" in line) is is_named
    held = dataclasses.replace(engine, is_held=True)
    assert "w" not in [each.key for each in live_keys(held, can_act=True, is_in_cloud=True)]


def test_a_hold_until_it_clears_says_so_in_the_first_line():
    told = {"state": "COAST", "holder": "autonomy", "is_held": True}
    for is_until_clear in (True, False):
        engine = read_engine_view(told | {"resumes_when_clear": is_until_clear})
        said = plain(top_lines(NightView(), engine, False, 120, 1))
        assert ("HELD until it clears" in said) is is_until_clear


# -- what is followed again -----------------------------------------------------------------------


def test_changes_of_state_that_come_out_the_same_are_told_once_and_a_coast_goes_on():
    first = (to(3, "ACQUIRE", "TRACK"), state(5), *missed(6, IN_CLOUD), *missed(7, IN_CLOUD)[:-1])
    log = folded(*first)
    texts = [line.text for line in log.log if line.kind == "StateChange"]
    again = (FollowedAgain(frame_id=6), *missed(6, IN_CLOUD)[2:], FollowedAgain(frame_id=7))
    view = folded(*again, *missed(7, IN_CLOUD)[2:-1], before=log).view()
    assert [line.text for line in view.log if line.kind == "StateChange"] == texts
    now = night.t_of(8)
    engine = read_engine_view({"state": "COAST", "holder": "autonomy", "now_utc_ns": now})
    # Since frame 5, in which it was measured last, however often it came to a coast since.
    since = duration_words((now - night.state_of(5, 0.0, 0.0, "updated").t_utc_ns) / NS)
    assert f"COAST {since}" in plain(top_lines(view, engine, False, 120, 1))


def test_a_change_of_state_that_comes_out_otherwise_is_news():
    log = folded(to(3, "ACQUIRE", "TRACK"), state(5), *missed(6, IN_CLOUD))
    count = sum(line.kind == "StateChange" for line in log.log)
    other = missed(6, Missed(kind="nothing fits"))
    folded(FollowedAgain(frame_id=6), *other[2:], before=log)
    assert sum(line.kind == "StateChange" for line in log.log) == count + 1


# -- orbit or filter ------------------------------------------------------------------------------


def test_a_turn_between_two_that_promise_the_same_is_no_news():
    for topic, is_news in (("predictor", True), ("close predictor", False)):
        event = Event(level="info", text="aims by", frame_id=3, topic=cast(Topic, topic))
        assert (line_of(event, night.t_of(3)) is not None) is is_news


def test_a_residual_from_the_orbit_s_prediction_says_so():
    for by, is_said in (("orbit", True), ("filter", False)):
        measured = dataclasses.replace(
            state(6),
            foretold_by=by,
            innovation_arcsec=(0.4, 0.1),
            sigma_innovation_arcsec=(1.0, 1.0),
            nis=0.2,
        )
        view = folded(night.taken(6, 150.0, -5.0), measured).view()
        for axis in ("east", "north"):
            title = plain(residual_lines(view, axis, 60, 5)).splitlines()[0]
            assert ("by the orbit" in title) is is_said


def turn(n: int, words: str) -> LogLine:
    line = line_of(Event(level="info", text=words, frame_id=n, topic="predictor"), night.t_of(n))
    assert line is not None
    return line


def test_turns_from_orbit_to_filter_and_back_are_one_line():
    log: list[LogLine] = []
    append_line(log, turn(3, "aims by the orbit from now on: a"))
    other = line_of(Event(level="info", text="the dome has opened"), night.t_of(4))
    assert other is not None
    append_line(log, other)
    append_line(log, turn(5, "aims by the filter again: b"))
    append_line(log, turn(9, "aims by the orbit from now on: c"))
    assert [line.text.partition(" (")[0] for line in log] == [
        "the dome has opened",
        "aims by the orbit from now on: c",
    ]
    assert "3 turns since" in log[-1].text
    for _ in range(8):
        append_line(log, dataclasses.replace(other, text=f"{len(log)}"))
    append_line(log, turn(40, "aims by the filter again: d"))
    assert "turns" not in log[-1].text  # the one before is long past


def test_the_aim_shown_is_the_next_one_in_the_log_s_words():
    view = NightView(track=night.state_of(4, 10.0, 0.0, "updated"), state="TRACK")
    for reason, words in (("filter", "aim: filter"), ("orbit", "aim: orbit")):
        engine = read_engine_view(
            {"state": "TRACK", "ra": 10.0, "dec": 0.0, "next_aim": {"reason": reason}}
        )
        assert words in plain(figure_lines(view, engine, None, 120, 5))


# -- dialogs --------------------------------------------------------------------------------------


def test_the_terms_begin_at_the_top_and_home_goes_there(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.resize_terminal(80, 24)
        await pilot.press("f1")
        await until(pilot, lambda: isinstance(app.screen, HelpDialog))
        await pilot.press("tab")
        box = app.screen.query_one(VerticalScroll)
        await pilot.press("pagedown", "pagedown")
        await until(pilot, lambda: box.scroll_offset.y > 20)
        await pilot.press("home")
        await until(pilot, lambda: box.scroll_offset.y == 0)
        await pilot.press("end")
        await until(pilot, lambda: box.scroll_offset.y > 20)
        await pilot.press("tab", "tab")
        await until(pilot, lambda: box.scroll_offset.y == 0)

    play(wire, scene, SIZE)


def test_go_to_says_that_the_present_track_is_kept(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("g")
        await until(pilot, lambda: isinstance(app.screen, GotoDialog))
        assert isinstance(app.screen, GotoDialog)
        assert "is kept meanwhile: u follows it again" in app.screen._caution

    play(wire, scene, SIZE)


# -- the end of a demo ----------------------------------------------------------------------------


def test_the_summary_adds_up_and_fits_80_columns(capsys: pytest.CaptureFixture[str]):
    orbit = {"label": "constrained by prior", "a_km": 42166.0, "sigma_a_km": 1.0}
    track = {
        "name": "INTELSAT 21",
        "tracks": [1],
        "frames": 190,
        "last_frame": 210,
        "state": "TRACK",
        "lost": None,
        "orbit": orbit,
    }
    demo._say_summary(
        {
            "frames": 210,
            "detections": 195,
            "misses": 1,
            "states": {"SEARCH": 3, "ACQUIRE": 1, "TRACK": 190, "COAST": 1, "MANUAL": 15},
            "target": "INTELSAT 21",
            "locked_after_frames": 4,
            "tracks": [track],
            "measured_rms_arcsec": 0.44,
            "prediction_rms_arcsec": 0.24,
            "nis_mean": 1.5,
            "inside_3sigma": 1.0,
            "latency_ms": {},
            "session": "n",
        }
    )
    said = capsys.readouterr().out
    assert "TRACK 190" in said
    assert "MANUAL 15" in said
    assert all(len(line) <= 80 for line in said.splitlines())
