"""One letter means one thing: on the live screen, in a review, in the opened frame."""

from collections import defaultdict

import pytest
from textual.binding import Binding

from rsoconsole.console.commands.command import Place
from rsoconsole.console.commands.commands import BY_NAME, commands_in
from rsoconsole.console.commands.keymap import load_keymap
from rsoconsole.console.frame.sheet_actions import FrameScreenActions
from rsoconsole.console.panes.last_line import MODE_KEYS

ALIKE = {
    **dict.fromkeys(("up", "down", "left", "right"), "moves: the telescope, in time, the cross"),
    "left_square_bracket": "less: a smaller step, slower",
    "right_square_bracket": "more: a larger step, faster",
    "minus": "less: slower, farther",
    "plus": "more: faster, nearer",
    "comma": "one step back: a frame, tau",
    "full_stop": "one step on: a frame, tau",
    "pageup": "farther back: a hundred frames, the kept frame before",
    "pagedown": "farther on: a hundred frames, the kept frame after",
    "g": "go to: a direction, a moment of the night",
    "enter": "takes what is pointed at: opens the frame, sets an end",
    "escape": "back",
    "end": "to the newest: of the plots, of the night",
}
"""Keys that mean on live, review and opened frame not the same thing, but one like it. All others
mean one thing on all of them: what a screen has for itself are capitals."""


def of_screen(place: Place) -> dict[str, str]:
    """What each key means there, by the command's name."""
    return {key: each.name for each in commands_in(place) for key in each.keys.split(",")}


def of_opened_frame() -> dict[str, str]:
    found = {}
    for binding in FrameScreenActions.BINDINGS:
        assert isinstance(binding, Binding)
        for key in binding.key.split(","):
            found[key] = binding.id or binding.action
    return found


SCREENS = {"live": of_screen("live"), "review": of_screen("review"), "frame": of_opened_frame()}


def test_no_key_means_two_things_but_those_that_are_alike():
    meanings: dict[str, set[str]] = defaultdict(set)
    for keys in SCREENS.values():
        for key, meaning in keys.items():
            meanings[key].add(meaning)
    differing = {key for key, found in meanings.items() if len(found) > 1}
    assert differing <= set(ALIKE)
    # What is said to be alike is on more than one screen: no exception is kept without need.
    assert set(ALIKE) <= differing


@pytest.mark.parametrize("screen", ["review", "frame"])
def test_what_a_screen_has_for_itself_is_a_capital(screen: str):
    others = {m for name, keys in SCREENS.items() if name != screen for m in keys.values()}
    for key, meaning in SCREENS[screen].items():
        if len(key) == 1 and key.isalpha() and meaning not in others and key not in ALIKE:
            assert key.isupper(), (key, meaning)


def test_the_last_line_names_the_keys_that_work():
    keys = SCREENS["frame"]
    for each in MODE_KEYS["sheet"]:
        if len(each.key) == 1 and each.key.isalpha():
            assert each.key in keys, each


def test_a_keymap_of_ones_own_goes_on_working(tmp_path):
    path = tmp_path / "keymap.toml"
    path.write_text('compare = "k"\nevent_kind = "e"\nmark = "f6"\n', encoding="utf-8")
    assert load_keymap(path) == {"compare": "k", "event_kind": "e", "mark": "f6"}
    assert BY_NAME["compare"].keys == "K"
