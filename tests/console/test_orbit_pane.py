"""The orbit in the console: what is said of it, and where it stands."""

import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from rsoconsole.config import Config, ConsoleConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.pane_layout import FULL, LARGE, THREE_COLUMNS, orbit_box, pane_boxes
from rsoconsole.console.drawing.plain import to_ascii
from rsoconsole.console.night.engine_view import EngineView, OrbitPrediction, predict_orbit
from rsoconsole.console.orbit.lines import (
    OrbitPaneContents,
    orbit_lines,
    orbit_pane_contents,
    target_words,
)
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.screens.review import ReviewScreen
from rsoconsole.console.timeline.lines import review_top_lines
from rsoconsole.console.tuning.tuning_pane import TunePane
from rsoconsole.console.watches import watch as outlook_watch
from rsoconsole.console.watches.watch import OutlookWatch
from rsoconsole.console.words.words import top_lines
from rsoconsole.night import NightView
from rsoconsole.pipeline import FuturePosition, OrbitOutlook
from rsoconsole.records import FollowedAgain
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.nights import orbit_night
from tests.nights.orbit_night import (
    BEST,
    FOLLOWED,
    NEXT,
    estimate_of,
    folded,
    identified_of,
    state,
    to,
)
from tests.rigs.review_rig import frame_shown, play_review, press
from tests.rigs.seat_rig import FakeWire, pane, play, until

NOW = night.t_of(20)
SITE = Config().site
HINT = "perhaps INTELSAT 14 (36097) has the right motion, 900″ (60 s) ahead of its elements"
WIDE = replace(BEST, name="実践衛星")
SIZES = ((47, 15), (59, 8), (57, 12), (80, 30), (40, 11), (120, 20), (20, 4), (1, 1))


def place(after_s: int, **changes: Any) -> FuturePosition:
    where = FuturePosition(
        t_utc_ns=NOW + after_s * NS,
        ra_icrs_deg=83.04,
        dec_icrs_deg=-5.87,
        sigma_arcsec=2.1,
        altitude_deg=48.2,
        azimuth_deg=201.4,
        range_km=37_000.0,
        lit=1.0,
    )
    return replace(where, **changes)


OUTLOOK = OrbitOutlook(
    ahead=(
        place(600),
        place(3600, sigma_arcsec=754.0, lit=0.0),
        place(86_400, sigma_arcsec=9_000.0, altitude_deg=-12.0),
    ),
    is_up=True,
    sets_utc_ns=NOW + 7200 * NS,
    rises_utc_ns=None,
    eclipse_utc_ns=(NOW + 600 * NS, NOW + 4200 * NS),
)
AHEAD = OrbitPrediction(
    folder=None,
    estimate=estimate_of(20),
    from_utc_ns=NOW,
    outlook=OUTLOOK,
    elements={"raan_deg": 82.14, "argp_deg": 40.0},
    sigmas={"e": 2e-5, "i_deg": 3e-3, "raan_deg": 0.4, "argp_deg": 130.0},
)
KNOWN = OrbitPaneContents(
    estimate=estimate_of(20), identified=identified_of(20), ahead=AHEAD, now_utc_ns=NOW
)


def said(shown: OrbitPaneContents, width: int = 80, height: int = 30) -> str:
    lines = orbit_lines(shown, width, height)
    assert len(lines) <= height
    texts = ["".join(text for text, _ in line) for line in lines]
    for text in texts:
        assert len(text) <= width
        assert not any(unicodedata.east_asian_width(c) in "WF" for c in text)
        assert to_ascii(text).isascii()
    return "\n".join(texts)


def inks(shown: OrbitPaneContents) -> dict[str, str]:
    return {text.strip(): ink for line in orbit_lines(shown, 80, 30) for text, ink in line}


# -- what the pane says -----------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "shown",
    [
        KNOWN,
        replace(KNOWN, identified=None),
        replace(KNOWN, ahead=None),
        replace(KNOWN, identified=identified_of(20, hint=HINT * 3, reason="很" * 90)),
        replace(
            KNOWN, identified=identified_of(20, matches=(replace(BEST, name="実践衛星"), NEXT))
        ),
        OrbitPaneContents(absence="an orbit needs 3 measurements: 1 so far"),
    ],
)
def test_it_fits_every_place_it_is_given(shown: OrbitPaneContents, size: tuple[int, int]) -> None:
    assert "orbit" in said(shown, *size) or size == (1, 1)


@pytest.mark.parametrize("size", [(47, 15), (59, 8), (57, 12), (80, 30)])
def test_name_elements_and_places_ahead_are_told_at_every_agreed_size(size) -> None:
    text = said(KNOWN, *size)
    for words in (
        "constrained by prior (geo)",
        "INTELSAT 14 (36097)",
        "98%",
        "3.1″ off",
        "then SES 10 (42432)",
        "12.0′ off",
        "a 42165±9 km",
        "e .00030±.00002",
        "i .052±.003°",
        "05:32:10 ",
        "-05:52:12 ±2.1″",
        "±12.6′",
        "±2.5°",
        "201",
        "sets 04:23Z (2h00)",
    ):
        assert words in text
    assert "dark" in text


def test_with_room_it_says_who_guides_how_well_it_fits_and_what_else_is_known() -> None:
    text = said(KNOWN)
    for words in (
        "aims by the filter",
        "orbit's NIS 1.2 /1 (ideal 2)",
        "rms .41″",
        "18 directions in 8m30",
        "node 82.1±.4°",
        "elements 0.4 d old",
        "against 31204 objects",
        "eccentricity about 0.002",
        "eclipse 02:33Z (10m00) to 03:33Z",
    ):
        assert words in text
    assert "argument" not in text  # what is not known to 60 degrees is not told
    guiding = replace(KNOWN, estimate=estimate_of(20, is_guide=True, nis=14.0, outliers=2))
    assert "aims by the orbit" in said(guiding)
    assert inks(guiding)["orbit's NIS 14.0 /1 (ideal 2)"] == "warn"
    assert inks(guiding)["2 left out"] == "warn"


def test_doubt_is_a_sign_and_a_word_never_a_colour_alone() -> None:
    doubtful = replace(
        KNOWN, identified=identified_of(20, verdict="ambiguous", reason="A and B fit alike")
    )
    assert "INTELSAT 14 (36097)?" in said(doubtful)
    assert "ambiguous: A and B fit alike" in said(doubtful)
    assert target_words(doubtful) == ("INTELSAT 14?", "a = 42165±9 km", "by prior")
    reason = "no catalogued object within 0.2 deg moves like this; the nearest is 3 deg off"
    unknown = replace(KNOWN, identified=identified_of(20, verdict="unknown", reason=reason))
    assert "unknown: no catalogued object within 0.2 deg" in said(unknown, 47, 15)
    assert target_words(unknown)[0] == "not in catalogue"


def test_a_manoeuvre_is_hinted_at_before_the_places_ahead_are_left_out() -> None:
    moved = replace(KNOWN, identified=identified_of(20, hint=HINT))
    assert "manoeuvre? perhaps INTELSAT 14" in said(moved, 59, 8)
    assert "warn" in {ink for text, ink in inks(moved).items() if text.startswith("manoeuvre?")}


def test_without_a_name_it_says_why() -> None:
    assert "not identified yet" in said(replace(KNOWN, identified=None))
    unnamed = replace(KNOWN, identified=None, has_catalogue=False)
    assert "no name: the setting catalogue.tle_files is empty" in said(unnamed)
    assert target_words(unnamed) == ("", "a = 42165±9 km", "by prior")


def test_an_orbit_that_is_not_observable_has_no_size_in_the_first_line() -> None:
    vague = estimate_of(20, label="not observable", prior="none", sigma_a_km=60_000.0)
    shown = replace(KNOWN, estimate=vague)
    assert "orbit · not observable ─" in said(shown)
    assert inks(shown)["not observable"] == "warn"
    assert target_words(shown) == ("INTELSAT 14", "", "")
    lost = place(86_400, ra_icrs_deg=float("nan"), sigma_arcsec=float("nan"))
    falling = replace(AHEAD, outlook=replace(OUTLOOK, ahead=(*OUTLOOK.ahead[:2], lost)))
    assert "24 h: it has come down" in said(replace(shown, ahead=falling))


def test_what_is_down_or_in_eclipse_already_is_said_plainly() -> None:
    dark = replace(OUTLOOK, is_up=False, rises_utc_ns=None, eclipse_utc_ns=(NOW, NOW + 600 * NS))
    text = said(replace(KNOWN, ahead=replace(AHEAD, outlook=dark)))
    assert "is down  does not rise within a day  in eclipse to 02:33Z" in text
    calm = replace(OUTLOOK, sets_utc_ns=None, eclipse_utc_ns=None)
    text = said(replace(KNOWN, ahead=replace(AHEAD, outlook=calm)))
    assert "does not set within a day  no eclipse within a day" in text


def test_until_it_is_computed_where_it_leads_that_is_said() -> None:
    assert "computing where it leads" in said(replace(KNOWN, ahead=None))
    assert "computing" not in said(replace(KNOWN, ahead=None, has_site=False))
    stuck = replace(KNOWN, ahead=replace(AHEAD, outlook=None))
    assert "where it leads cannot be computed" in said(stuck)


# -- what is known at an instant --------------------------------------------------------------


def seen(*records: Any, ahead: OrbitPrediction | None = None, **changes: Any) -> OrbitPaneContents:
    view = replace(folded(*records).view(), folder=None, **changes)
    return orbit_pane_contents(view, EngineView(reach="recorded"), ahead)


def test_why_there_is_no_orbit_is_said() -> None:
    assert "nothing is followed" in seen().absence
    begun = (state(4, "initial"), to(4, "ACQUIRE", "TRACK"))
    assert seen(*begun).absence == "an orbit needs 3 measurements: 2 so far"
    more = (*begun, *(state(n) for n in range(5, 9)))
    assert "on record" in seen(*more).absence
    off = Config.model_validate({"orbit": {"online": False}})
    assert "orbit.online is off" in seen(*more, config=off).absence
    live = orbit_pane_contents(folded(*more).view(), EngineView(reach="attached"), None)
    assert live.absence == "no orbit yet: the measurements so far tell none"


def test_an_orbit_from_before_a_word_on_a_frame_says_so_and_how_old_it_is() -> None:
    view = replace(folded(*FOLLOWED, FollowedAgain(frame_id=5)).view(), folder=None)
    engine = EngineView(reach="attached", now_utc_ns=view.orbit_utc_ns + 130 * NS)
    shown = orbit_pane_contents(view, engine, None)
    lines = "\n".join("".join(t for t, _ in line) for line in orbit_lines(shown, 60, 12))
    assert shown.absence == ""
    assert "from 2m10 ago: being fitted again after your word" in lines
    assert "42" in target_words(shown)[1]
    fitted = folded(*FOLLOWED, FollowedAgain(frame_id=5), estimate_of(5)).view()
    assert orbit_pane_contents(replace(fitted, folder=None), engine, None).since_word_s is None


def test_what_was_computed_of_another_moment_is_not_shown() -> None:
    then = replace(AHEAD, estimate=estimate_of(5), from_utc_ns=night.t_of(5))
    assert seen(*FOLLOWED, ahead=then).ahead is then
    assert seen(*FOLLOWED, state(6), estimate_of(6), ahead=then).ahead is then
    later = replace(then, estimate=estimate_of(6))
    assert seen(*FOLLOWED, ahead=later).ahead is None
    old = replace(then, from_utc_ns=night.t_of(5) - 400 * NS)
    assert seen(*FOLLOWED, ahead=old).ahead is None
    assert seen(*FOLLOWED, ahead=replace(then, folder=Path("other"))).ahead is None


def test_the_last_orbit_of_a_lost_one_says_of_when_it_is() -> None:
    shown = seen(*FOLLOWED, to(7, "COAST", "LOST"))
    assert shown.is_past
    assert said(shown).startswith("─ last orbit 02:15:50 · ")
    assert "aims by" not in said(shown)
    assert target_words(shown) == ("", "", "")


def test_where_it_leads_agrees_with_the_orbit_itself() -> None:
    ahead = predict_orbit(estimate_of(20), Config(), NOW)
    assert ahead.outlook is not None
    # A geostationary satellite stands still over the ground.
    places = [(each.altitude_deg, each.azimuth_deg) for each in ahead.outlook.ahead]
    for altitude_deg, azimuth_deg in places:
        assert altitude_deg == pytest.approx(places[0][0], abs=0.3)
        assert azimuth_deg == pytest.approx(places[0][1], abs=0.3)
    assert ahead.outlook.sets_utc_ns is None
    assert ahead.elements["e"] == pytest.approx(estimate_of(20).e, rel=1e-6)
    assert (ahead.sigmas["raan_deg"] or 0.0) > 0.0


def test_an_orbit_that_leads_nowhere_is_shown_all_the_same(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def breaks(*_: Any, **__: Any) -> None:
        raise ArithmeticError("no such orbit")

    came: list[OrbitPrediction] = []
    skies: list[Any] = []
    watch = OutlookWatch(skies.append, came.append)
    watch.update(folded(*FOLLOWED).view(), EngineView(reach="recorded"))
    monkeypatch.setattr(outlook_watch, "predict_orbit", breaks)
    watch._look()
    assert len(skies) == 1
    assert [ahead.outlook for ahead in came] == [None]
    assert came[0].estimate == estimate_of(5)
    assert "cannot be computed" in caplog.text


def test_the_limits_are_told_as_soon_as_it_is_known_where_the_telescope_looks() -> None:
    skies: list[Any] = []
    watch = OutlookWatch(skies.append, lambda _: None)
    told = folded().view()
    for mount_deg in (None, None, 150.0, 151.0):
        engine = EngineView(
            reach="attached",
            now_utc_ns=night.t_of(5),
            mount_ra_icrs_deg=mount_deg,
            mount_dec_icrs_deg=None if mount_deg is None else -5.0,
        )
        watch.update(told, engine)
        watch._look()
    assert [bool(sky.margins_deg) for sky in skies] == [False, True]


def test_the_limits_follow_a_telescope_that_was_sent_elsewhere(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(outlook_watch, "BREATH_S", 0.0)
    skies: list[Any] = []
    watch = OutlookWatch(skies.append, lambda _: None)
    told = folded().view()
    for mount_deg in (150.0, 150.1, 190.0):
        engine = EngineView(
            reach="attached",
            now_utc_ns=night.t_of(5),
            mount_ra_icrs_deg=mount_deg,
            mount_dec_icrs_deg=-5.0,
        )
        watch.update(told, engine)
        watch._look()
    first, second = (dict(sky.margins_deg) for sky in skies)
    assert all(abs(first[name] - second[name]) > 5.0 for name in ("altitude", "hour angle"))


def test_it_is_computed_again_for_another_orbit_and_not_for_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outlook_watch, "BREATH_S", 0.0)
    came: list[OrbitPrediction] = []
    watch = OutlookWatch(lambda _: None, came.append)
    found = folded(*FOLLOWED)
    engine = EngineView(reach="attached", now_utc_ns=night.t_of(5))
    for _ in range(3):
        watch.update(found.view(), engine)
        watch._look()
    assert len(came) == 1
    watch.update(folded(state(6), estimate_of(6), before=found).view(), engine)
    watch._look()
    assert [ahead.estimate.frame_id for ahead in came] == [5, 6]
    watch.update(folded(FollowedAgain(frame_id=6), before=found).view(), engine)
    watch._look()
    assert len(came) == 2


# -- the first line ---------------------------------------------------------------------------


def test_the_first_line_has_the_target_and_cuts_it_first() -> None:
    view = NightView(state="TRACK", state_since_utc_ns=NOW, last_utc_ns=NOW)
    engine = EngineView(
        reach="attached", state="TRACK", holder="autonomy", now_utc_ns=NOW + 724 * NS
    )
    found = ("INTELSAT 14?", "a = 42165±9 km", "by prior")

    def line(width: int, found: tuple[str, str, str] = found) -> str:
        top = top_lines(view, engine, False, width, 1, found=found)[0]
        text = "".join(text for text, _ in top)
        assert len(text) == width
        return text

    assert "AUTO has the mount  INTELSAT 14? a = 42165±9 km" in line(80)
    assert "AUTO has the mount  INTELSAT 14?  " in line(64)
    assert "AUTO has the mount  INTEL" in line(50)
    assert line(50).endswith("Z ")
    # However little room there is, the time stands apart.
    assert all(line(width)[-11] == " " for width in range(45, 100))
    assert "target unidentified a = 42165±9 km" in line(90, ("", "a = 42165±9 km", "by prior"))
    past = review_top_lines(view, EngineView(reach="recorded"), None, 80, 1, found=found)[0]
    assert "INTELSAT 14? a = 42165±9 km" in "".join(text for text, _ in past)
    for rows, width in ((1, 40), (2, 60)):
        past = review_top_lines(view, EngineView(reach="recorded"), None, width, rows, found=found)
        assert all(sum(len(text) for text, _ in each) <= width for each in past)


# -- where it stands --------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60), (112, 36), (60, 16), (40, 12)])
def test_it_has_a_place_in_every_terminal_and_leaves_state_keys_and_picture(size) -> None:
    for rows in (0, 3):
        box, boxes = orbit_box(*size, timeline_rows=rows), pane_boxes(*size, timeline_rows=rows)
        assert box.x + box.width <= size[0]
        assert box.y >= boxes["top"].height
        assert box.y + box.height <= size[1] - 1 - rows
        if size[0] >= FULL[0]:
            assert box.x >= boxes["frame"].width
            assert box.height >= 12
        assert ("orbit" in boxes) == (size[0] >= LARGE[0])
        if size[0] >= LARGE[0]:
            assert boxes["orbit"].height >= 8
            assert boxes["log"].height >= 2
        if size[0] >= THREE_COLUMNS[0]:
            assert box.width == boxes["nis"].width


@pytest.fixture(scope="module")
def named_night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A night of twenty frames with orbits and names, closed."""
    writer = orbit_night.write(tmp_path_factory.mktemp("orbit") / "night")
    writer.close()
    return writer.folder


def shown_text(screen: Any) -> str:
    found = screen.query_one("#orbit", LinesPane)
    return found.text if found.display else ""


@pytest.mark.parametrize("size", [(80, 24), (60, 16), (40, 12)])
def test_a_key_opens_it_over_the_plots_and_everything_else_goes_on(
    named_night: Path, impatient_seat: None, size: tuple[int, int]
) -> None:
    wire = FakeWire(named_night)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        assert not shown_text(app.live)
        await pilot.press("o")
        await until(pilot, lambda: "INTELSAT 14 (36097)" in shown_text(app.live))
        await until(pilot, lambda: "24 h" in shown_text(app.live))
        assert app.screen is app.live
        frame = app.live.query_one("#frame")
        assert frame.display == (size[0] >= 60)
        await pilot.press("h")
        await until(pilot, lambda: "hold" in wire.verbs)
        wire.status["holder"] = "operator"  # from autonomy an arrow takes nothing at once
        await until(pilot, lambda: app.live.engine.holder == "operator")
        await pilot.press("up", "x")
        await until(pilot, lambda: "stop" in wire.verbs)
        assert {"hold", "nudge"} <= set(wire.verbs)
        await until(pilot, lambda: app.live.stop_news is not None)
        await pilot.press("o")
        assert not shown_text(app.live)

    play(wire, scene, size)


def test_a_mark_is_made_in_a_picture_that_is_seen(named_night: Path, impatient_seat: None) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("o")
        await until(pilot, app.live.is_picture_covered)
        await pilot.press("m")
        assert not shown_text(app.live)
        assert app.live.marking is not None

    play(FakeWire(named_night), scene, (60, 16))


@pytest.mark.parametrize("size", [(120, 40), (200, 60)])
def test_in_a_larger_terminal_it_stands_and_the_key_makes_it_large(
    named_night: Path, impatient_seat: None, size: tuple[int, int]
) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        found = app.live.query_one("#orbit", LinesPane)
        await until(pilot, lambda: "24 h" in shown_text(app.live))
        assert "INTELSAT 14 a = 42165±9 km" in pane(app, "top")
        height = found.size.height
        await pilot.press("o")
        await until(pilot, lambda: found.size.height > height)
        assert "objects" in found.text
        await pilot.press("escape")
        await until(pilot, lambda: found.size.height == height)

    play(FakeWire(named_night), scene, size)


def test_the_tuning_pane_and_the_log_take_its_place_and_give_it_back(
    named_night: Path, impatient_seat: None
) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        tune = app.live.query_one("#tune", TunePane)
        await pilot.press("o", "t")
        assert tune.display
        assert not shown_text(app.live)
        await pilot.press("o")  # its own: to load a preset
        assert tune.display
        assert not shown_text(app.live)
        await pilot.press("t", "o")
        assert not tune.display
        assert shown_text(app.live)
        await pilot.press("l")
        assert not shown_text(app.live)
        await pilot.press("o")
        assert shown_text(app.live)
        assert not app.live.is_log_open

    play(FakeWire(named_night), scene)


def test_it_works_read_only_and_in_letters_only(named_night: Path, impatient_seat: None) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("o")
        await until(pilot, lambda: "INTELSAT" in shown_text(app.live))
        assert to_ascii(shown_text(app.live)).isascii()

    settings = ConsoleConfig(ascii=True)
    play(FakeWire(named_night), scene, read_only=True, settings=settings)


def test_a_review_has_the_orbit_of_the_moment(named_night: Path, impatient_seat: None) -> None:
    def observations(review: ReviewScreen) -> int:
        return 0 if review.orbit.estimate is None else review.orbit.estimate.observations

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("o")
        await press(review, pilot, "g", *"12", "enter")
        assert frame_shown(review) == 12
        assert observations(review) == 9
        await until(pilot, lambda: "24 h" in shown_text(review))
        assert "INTELSAT 14 (36097)" in shown_text(review)
        await press(review, pilot, "g", *"2", "enter")
        await until(pilot, lambda: "nothing is followed" in shown_text(review))
        await press(review, pilot, "end")
        await until(pilot, lambda: observations(review) == 18)
        await until(pilot, lambda: "24 h" in shown_text(review))
        await pilot.press("escape")
        assert not shown_text(review)

    play_review(named_night, scene)
