"""Several satellites are named in a strip, each in a colour of its own, at no plot's cost."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widget import Widget

from rsoconsole.config import ConsoleConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.track_marks import track_ink
from rsoconsole.console.picture.marks import Window, frame_marks, mark_characters
from rsoconsole.console.words.track_lines import track_list_lines, track_strip_line
from tests.console.test_track_list import FRAMES, of_eight
from tests.nights import eight_tracks as eight
from tests.rigs.seat_rig import FakeWire, click, pane, play, screen_text, until

SIZES = [(80, 24), (120, 40), (200, 60), (60, 20)]
PLOTS = ("#confidence", "#east", "#north", "#nis")


@pytest.fixture
def seat_of_eight(tmp_path: Path) -> Iterator[FakeWire]:
    writer = of_eight(tmp_path)
    yield FakeWire(tmp_path / "eight")
    writer.close()


def strip(width: int, chosen: int | None = None) -> str:
    line = track_strip_line(eight.night_of_eight().view(), chosen, "6", width)
    said = "".join(text for text, _ in line)
    assert len(said) <= width
    return said


@pytest.mark.parametrize(
    ("width", "said"),
    [
        (20, " 2* ASTRA … · +7 [6]"),
        (40, " 2* ASTRA 1L · 1 ASTRA 1KR · +6 [6]"),
        (60, " 2* ASTRA 1L · 1 ASTRA 1KR · 3 ASTRA 1M · +5 [6]"),
        (80, " 2* ASTRA 1L · 1 ASTRA 1KR · 3 ASTRA 1M · 4 ASTRA 1N · +4 [6]"),
    ],
)
def test_the_lead_is_first_and_those_without_room_are_counted(width: int, said: str):
    assert strip(width) == said


def test_all_are_named_where_there_is_room_and_one_without_a_name_is_its_number():
    assert strip(120).endswith(" · 5 ASTRA 19.2E SPARE? · 6 · 7 EUTELSAT 25B · 8 [6]")


def test_the_chosen_one_is_beside_the_lead_and_reversed():
    assert strip(50, chosen=5).startswith(" 2* ASTRA 1L · 5 ASTRA 19.2E")
    line = track_strip_line(eight.night_of_eight().view(), 5, "6", 80)
    assert [text for text, ink in line if ink == "here"] == ["5 ASTRA 19.2E SPARE?"]


def test_a_track_has_one_colour_in_strip_list_and_picture():
    night = eight.night_of_eight()
    in_strip = {
        t.split(" ")[0].strip("*"): i for t, i in track_strip_line(night.view(), 9, "6", 200)
    }
    rows = track_list_lines(night.view(), 2, None, 60, 20)[2:10]
    in_list = {row[1][0].strip(): row[1][1] for row in rows if len(row) > 1}
    window = Window.at((0.0, 0.0), (eight.WIDTH_PX, eight.HEIGHT_PX), (120, 40))
    written = mark_characters(frame_marks(night.frame(FRAMES)), window).values()
    in_picture = {sign: kind for sign, kind in written if sign.isdigit()}
    for track in (1, 4, 5, 6, 7, 8):
        assert in_strip[f"{track}"] == in_list[f"{track}"] == in_picture[f"{track}"]
        assert in_strip[f"{track}"] == track_ink(track)
    assert len({track_ink(track) for track in range(1, 7)}) == 6


def rows_of(widget: Widget) -> int:
    return widget.size.height if widget.display else 0


@pytest.mark.parametrize("size", SIZES)
def test_the_strip_takes_its_row_from_the_log_and_none_from_a_plot(
    wire: FakeWire, seat_of_eight: FakeWire, size: tuple[int, int]
):
    rows: dict[bool, dict[str, int]] = {}

    def seen(has_strip: bool):
        async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
            await until(pilot, lambda: app.live.query_one("#strip").display == has_strip)
            names = (*PLOTS, "#frame", "#facts", "#log")
            rows[has_strip] = {name: rows_of(app.live.query_one(name)) for name in names}
            assert ("6 Satellites" in pane(app, "keys")) == has_strip
            if has_strip:
                assert pane(app, "strip").startswith(" 2* ASTRA 1L")
                assert pane(app, "strip").endswith("[6]")
                assert pane(app, "strip") in screen_text(app)

        return scene

    play(seat_of_eight, seen(True), size, frames=FRAMES)
    play(wire, seen(False), size)
    alone, several = rows[False], rows[True]
    assert several.pop("#log") == alone.pop("#log") - 1
    assert several == alone


@pytest.mark.parametrize("size", SIZES)
def test_the_strip_is_read_in_ascii(seat_of_eight: FakeWire, size: tuple[int, int]):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.query_one("#strip").display)
        row = app.live.query_one("#strip").region
        strip = app.screen._compositor.render_strips()[row.y]
        shown = strip.apply_filter(app._filters[-1], app.screen.background_colors[1])
        text = "".join(segment.text for segment in shown).strip()
        assert text.isascii()
        assert "2* ASTRA 1L . " in text
        assert "[6]" in text

    play(seat_of_eight, scene, size, frames=FRAMES, settings=ConsoleConfig(ascii=True))


def test_tab_goes_through_the_tracks_and_their_plots(seat_of_eight: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: len(app.live.night.tracks) == eight.COUNT)
        seen = []
        for _ in range(eight.COUNT):
            await pilot.press("tab")
            seen.append(app.live.chosen_track_id)
        assert seen == [3, 4, 5, 6, 7, 8, 1, None]
        await pilot.press("tab")
        assert pane(app, "strip").startswith(" 2* ASTRA 1L · 3 ASTRA 1M")
        await until(pilot, lambda: "plots: track 3 (ASTRA 1M)" in pane(app, "keys"))
        assert not app.live.query_one("#tracks").display
        assert seat_of_eight.verbs == []

    play(seat_of_eight, scene, (120, 40), frames=FRAMES)


def test_a_click_on_the_key_opens_the_list_and_the_log_hides_the_strip(seat_of_eight: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.query_one("#strip").display)
        await click(app, pilot, "6 Satellites")
        await until(pilot, lambda: "tracks: 8" in pane(app, "tracks"))
        await pilot.press("escape", "l")
        await until(pilot, lambda: not app.live.query_one("#strip").display)

    play(seat_of_eight, scene, (120, 40), frames=FRAMES)


def test_with_one_satellite_tab_says_that_there_is_no_other(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("tab")
        await until(pilot, lambda: "no second satellite" in pane(app, "keys"))

    play(wire, scene)
