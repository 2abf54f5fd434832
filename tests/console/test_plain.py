"""The screen for terminals without Unicode: ASCII, as wide as before, and still to be read."""

import string
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from rich.segment import Segment
from rich.style import Style
from textual.color import Color
from textual.pilot import Pilot

import rsoconsole
from rsoconsole.config import ConsoleConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.plain import AsciiFilter, spell_out_signs, to_ascii
from tests.rigs.seat_rig import FakeWire, play, until

BLACK = Color(0, 0, 0)


@given(st.text())
def test_whatever_it_is_given_it_gives_as_many_ascii_characters(text):
    assert to_ascii(text).isascii()
    assert len(to_ascii(text)) == len(text)


def test_what_the_seat_says_stays_readable():
    assert to_ascii("α 05:32:11 δ -04°52′10″ ±0.2″ → COAST · 3σ") == (
        'a 05:32:11 d -04d52\'10" ~0.2" > COAST . 3s'
    )
    assert to_ascii("├── 3σ ─┤") == "+-- 3s -+"
    # What was measured is a star wherever in its cell it lies; what was missed is an o.
    assert to_ascii("⠛⣤⠁⡀⠀○") == "**'. o"
    assert to_ascii("⣀⠉") == "**"  # one that lies across two cells
    assert to_ascii(string.printable) == string.printable


def test_every_sign_that_the_screen_has_is_readable():
    signs = {
        sign
        for room in ("console", "control", "words", "night")
        for path in Path(rsoconsole.__file__).parent.joinpath(room).rglob("*.py")
        for sign in path.read_text(encoding="utf-8")
    }
    assert {each for each in signs - {*"▖▗▘▝▙▚▛▜▞▟"} if to_ascii(each) == "?"} == {"?"}


def test_signs_are_spelled_out_where_the_line_has_room():
    def said(*texts: str) -> str:
        return "".join(spell_out_signs(texts))

    assert said("a = 42166±1 km", "    02:23:27Z") == "a = 42166+-1 km   02:23:27Z"
    assert said("─ δ residual ", "──────", " 3σ 2.1″ ─") == '- Dec residual -- 3sig 2.1" -'
    assert said("  α 05:32:11", "  δ -04°52′10″", "     ") == " RA 05:32:11  Dec -04d52'10\"   "
    # An axis keeps its place: the gap before it gives the room.
    assert said("    τ┤", " . * ") == "  tau+ . * "
    # Where there is none the line's end gives way: a sign has one form.
    assert said("±1σ") == "+-1"
    assert said("±1 of 3σ!") == "+-1 of 3s"


@given(st.lists(st.text(alphabet="ab ─±°στ┤α", max_size=9), max_size=5))
def test_spelled_out_a_line_is_as_long_as_before(texts):
    made = spell_out_signs(texts)
    assert len("".join(made)) == len("".join(texts))
    assert "".join(made).isascii()


def test_pictures_become_brighter_signs_where_there_is_more_light():
    filter_ = AsciiFilter()
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
        assert not any(isinstance(each, AsciiFilter) for each in app._filters)

    play(wire, scene, settings=ConsoleConfig(ascii=False))
