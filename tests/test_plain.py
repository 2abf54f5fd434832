"""The screen for terminals without Unicode: ASCII, as wide as before, and still to be read."""

import string

from hypothesis import given
from hypothesis import strategies as st
from rich.segment import Segment
from rich.style import Style
from textual.color import Color
from textual.pilot import Pilot

from rsoconsole.config import ConsoleConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.plain import PlainFilter, plain
from tests.seat_rig import FakeWire, play, until

BLACK = Color(0, 0, 0)


@given(st.text())
def test_whatever_it_is_given_it_gives_as_many_ascii_characters(text):
    assert plain(text).isascii()
    assert len(plain(text)) == len(text)


def test_what_the_seat_says_stays_readable():
    assert plain("α 05:32:11 δ -04°52′10″ ±0.2″ → COAST · 3σ") == (
        'a 05:32:11 d -04o52\'10" ~0.2" > COAST . 3s'
    )
    assert plain("├── 3σ ─┤") == "+-- 3s -+"
    assert plain("⠛⣤⠁⡀⠀") == "*o'. "
    assert plain(string.printable) == string.printable


def test_pictures_become_brighter_signs_where_there_is_more_light():
    filter_ = PlainFilter()
    greys = [
        Segment("▀▀", Style(color=f"rgb({v},{v},{v})", bgcolor=f"rgb({v},{v},{v})"))
        for v in (0, 60, 130, 255)
    ]
    assert [text for text, _, _ in filter_.apply(greys, BLACK)] == ["  ", "::", "++", "@@"]


def test_a_terminal_without_unicode_gets_letters_only(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        for _ in range(2):
            shown = app.screen._compositor.render_strips()
            assert all(segment.text.isascii() for strip in shown for segment in strip)
            await pilot.press("f1")
            await pilot.pause()
        text = "\n".join("".join(segment.text for segment in strip) for strip in shown)
        assert "STOP" in text

    play(wire, scene, settings=ConsoleConfig(ascii=True))


def test_where_it_is_not_asked_for_nothing_is_changed(wire: FakeWire):
    async def scene(app: ConsoleApp, _pilot: Pilot[str]) -> None:
        assert not any(isinstance(each, PlainFilter) for each in app._filters)

    play(wire, scene, settings=ConsoleConfig(ascii=False))
