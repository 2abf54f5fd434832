"""The first seconds: a simulated night says so, says what will come, and F1 begins with a tour."""

from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.commands.glossary import TERMS, glossary_text
from rsoconsole.console.dialogs.help import HelpDialog
from rsoconsole.console.dialogs.tour import TourDialog, TourMemory, intro_text, tour_pages
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.words import top_lines
from rsoconsole.night import NightView
from rsoconsole.sky import iso_to_utc_ns
from tests.rigs.seat_rig import FakeWire, play, until

NOW = iso_to_utc_ns("2023-06-22T05:30:07Z")
SEARCHING = EngineView(reach="attached", state="SEARCH", holder="autonomy", now_utc_ns=NOW)


def top(night: NightView, width: int) -> str:
    return "".join(text for text, _ in top_lines(night, SEARCHING, False, width, 1)[0])


def test_a_simulated_night_says_so_and_every_night_its_date():
    simulated, real = NightView(is_simulated=True), NightView()
    assert top(simulated, 120).startswith(" DEMO SIMULATED ")
    assert top(simulated, 80).startswith(" DEMO ")
    assert "DEMO" not in top(real, 120)
    for night in (simulated, real):
        for width in (80, 120):
            assert top(night, width).rstrip().endswith("2023-06-22 05:30:07Z")
            assert len(top(night, width)) == width


def test_the_date_gives_way_to_the_target_in_a_narrow_terminal():
    engine = EngineView(reach="attached", state="TRACK", holder="autonomy", now_utc_ns=NOW)
    found = ("INTELSAT 14 of two", "a = 42166±1 km")
    line = top_lines(NightView(is_simulated=True), engine, False, 80, 1, found=found)[0]
    words = "".join(text for text, _ in line)
    assert "INTELSAT 14 of two" in words
    assert "05:30:07Z" in words
    assert "2023" not in words


def test_until_something_is_followed_it_says_what_will_come():
    text = intro_text(NightView(is_simulated=True), SEARCHING, {})
    assert "searches for a satellite that nobody told it about" in text
    assert "F1 explains" in text
    assert text.endswith("Other nights: rsoconsole demo --list")
    assert intro_text(NightView(is_simulated=True, track_frame_id=4), SEARCHING, {}) == ""
    assert intro_text(NightView(), SEARCHING, {}) == ""
    assert "F2 explains" in intro_text(NightView(is_simulated=True), SEARCHING, {"help": "F2"})


@pytest.mark.parametrize("page", tour_pages({}), ids=lambda page: page[0])
def test_a_page_of_the_tour_fits_80_columns_and_24_lines(page: tuple[str, str]):
    lines = page[1].splitlines()
    assert len(lines) <= 20
    assert max(map(len, lines)) <= 74


def test_the_glossary_has_the_terms_of_the_screen_in_a_few_lines_each():
    text = glossary_text()
    for term in (
        "τ",
        "Q ",
        "R ",
        "NIS",
        "3σ bounds",
        "constrained by prior",
        "weak geometry",
        "FWHM",
    ):
        assert term in text
    assert max(map(len, text.splitlines())) <= 70
    assert all(len(words) <= 280 for _, words in TERMS)


def test_the_first_f1_is_the_tour_and_the_next_the_help(wire: FakeWire, tmp_path: Path):
    memory = TourMemory(tmp_path / "state")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        app._tour = memory
        await pilot.press("f1")
        await until(pilot, lambda: isinstance(app.screen, TourDialog))
        await pilot.press("right", "right", "right", "right", "right")
        await pilot.pause()
        assert isinstance(app.screen, TourDialog)  # an arrow more would move the telescope
        await pilot.press("enter")
        await until(pilot, lambda: app.screen is app.live)
        assert not memory.is_due
        await pilot.press("f1")
        await until(pilot, lambda: isinstance(app.screen, HelpDialog))
        await pilot.press("tab")
        page = app.screen.query_one("#page")
        assert "Normalised innovation squared" in str(page.render())
        await pilot.press("t")
        await until(pilot, lambda: isinstance(app.screen, TourDialog))

    play(wire, scene)


def test_in_a_pane_with_keys_of_its_own_f1_explains_those_first(wire: FakeWire, tmp_path: Path):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        app._tour = TourMemory(tmp_path / "state")
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "f1")
        await until(pilot, lambda: isinstance(app.screen, HelpDialog))
        page = str(app.screen.query_one("#page").render())
        assert page.startswith("Now: the tuning pane")

    play(wire, scene)


def test_stop_works_in_the_tour(wire: FakeWire, tmp_path: Path):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        app._tour = TourMemory(tmp_path)
        await pilot.press("f1")
        await until(pilot, lambda: isinstance(app.screen, TourDialog))
        await pilot.press("x")
        await until(pilot, lambda: "stop" in wire.verbs)

    play(wire, scene)
