"""Commands: older clients are understood, what is wrong is said in words, policy is the verb's."""

import json
from typing import Any

import pytest

from rsoconsole.control import (
    COMMANDS,
    Accept,
    AimOffset,
    AnswerControlRequest,
    Arm,
    ChooseStreak,
    Command,
    Goto,
    Hold,
    MarkByHand,
    Nudge,
    Preview,
    Set,
    SetTracking,
    Stop,
    command_words,
    make_command,
)
from rsoconsole.control.command import register_command

PLACE = {"ra_icrs_deg": 83.05, "dec_icrs_deg": -4.87}

OLDER: list[tuple[str, dict[str, Any], Command]] = [
    ("arm", {"override": []}, Arm()),
    ("arm", {"override": ["disk", "sun"]}, Arm(override=("disk", "sun"))),
    ("goto", {**PLACE, "override": []}, Goto(**PLACE)),
    ("goto", {"ra_icrs_deg": 83, "dec_icrs_deg": -4}, Goto(ra_icrs_deg=83.0, dec_icrs_deg=-4.0)),
    ("nudge", {"east_arcmin": 1, "north_arcmin": 0.0}, Nudge(east_arcmin=1.0, north_arcmin=0.0)),
    ("preview", PLACE, Preview(move=Goto(**PLACE))),
    (
        "preview",
        {"east_arcmin": 1.0, "north_arcmin": 2.0},
        Preview(move=Nudge(east_arcmin=1.0, north_arcmin=2.0)),
    ),
    (
        "preview",
        {"lead_s": 2.0, "along_arcmin": 0.0, "across_arcmin": 1.0},
        Preview(move=AimOffset(lead_s=2.0, along_arcmin=0.0, across_arcmin=1.0)),
    ),
    ("hold", {"until": "clear"}, Hold(until="clear")),
    ("hold", {"until": None}, Hold()),
    ("track", {"on": False}, SetTracking(is_on=False)),
    ("track", {}, SetTracking()),
    ("set", {"name": "detector.tau", "value": 0.2}, Set(name="detector.tau", value=0.2)),
    (
        "set",
        {"name": "filter.preset", "value": "paper", "frames": 5},
        Set(name="filter.preset", value="paper", frames=5),
    ),
    ("choose", {"frame": 7, "x": 3.0, "y": 4.5}, ChooseStreak(frame_id=7, x_px=3.0, y_px=4.5)),
    ("accept", {}, Accept()),
    (
        "mark",
        {"frame": 7, "x_a": 1.0, "y_a": 2.0, "x_b": 9.0, "y_b": 2.0, "sigma_px": 1.5},
        MarkByHand(frame_id=7, x_a_px=1.0, y_a_px=2.0, x_b_px=9.0, y_b_px=2.0, sigma_px=1.5),
    ),
    (
        "answer_seat",
        {"gives": True, "to": "ann@tty1"},
        AnswerControlRequest(gives=True, to="ann@tty1"),
    ),
    ("stop", {"whatever": [1]}, Stop()),
    *((verb, {}, COMMANDS[verb]()) for verb in ("status", "disarm", "resume", "park", "unpark")),
    *((verb, {}, COMMANDS[verb]()) for verb in ("abort", "seek", "shutdown", "ask_seat")),
]
"""What consoles, panels and shells have sent since the first version."""


@pytest.mark.parametrize(("verb", "arguments", "command"), OLDER)
def test_what_older_clients_send_is_the_command_that_it_was(
    verb: str, arguments: dict[str, Any], command: Command
):
    assert make_command(verb, arguments) == command


@pytest.mark.parametrize("command", [command for _, _, command in OLDER], ids=str)
def test_a_command_comes_off_the_wire_as_it_went_on(command: Command):
    assert make_command(command.verb, json.loads(json.dumps(command.arguments()))) == command


@pytest.mark.parametrize(
    ("verb", "arguments", "says"),
    [
        ("dance", {}, "the engine knows no 'dance'; it knows stop, status,"),
        ("goto", {"ra_icrs_deg": 3.0}, "goto needs dec_icrs_deg, a number"),
        ("goto", PLACE | {"dec_icrs_deg": "north"}, "dec_icrs_deg must be a number"),
        ("goto", PLACE | {"ra_icrs_deg": True}, "ra_icrs_deg must be a number"),
        ("goto", PLACE | {"ra_icrs_deg": float("inf")}, "a number that can be worked with"),
        ("goto", PLACE | {"dec_icrs_deg": 95.0}, "outside -90 to 90"),
        ("goto", PLACE | {"speed": 3}, "goto knows no 'speed'; it takes ra_icrs_deg, dec_icrs_deg"),
        ("goto", PLACE | {"override": "sun"}, "override must be a list of names"),
        ("nudge", {"east_arcmin": 600.0, "north_arcmin": 60.0}, "at most 600 arcmin: use goto"),
        ("preview", PLACE | {"dec_icrs_deg": 95.0}, "outside -90 to 90"),
        ("hold", {"until": "dawn"}, "until 'clear', or until you resume"),
        ("track", {"on": 1}, "on must be true or false"),
        ("set", {"name": "detector.tau"}, "set needs value, a number or text"),
        ("set", {"name": "detector.tau", "value": True}, "value must be a number or text"),
        ("set", {"name": "a.b", "value": 1, "frames": 0}, "a number from 1 to 1000"),
        ("set", {"name": "a.b", "value": 2**60}, "a number that can be worked with"),
        ("accept", {"frame": "x"}, "frame must be a whole number"),
        ("note", {"text": "  "}, "a note needs words"),
        ("disarm", {"now": 1}, "it takes no arguments"),
    ],
)
def test_what_is_no_command_is_said_to_be_none_in_words(
    verb: str, arguments: dict[str, Any], says: str
):
    with pytest.raises(ValueError, match=says):
        make_command(verb, arguments)


@pytest.mark.parametrize(
    ("verb", "arguments", "says"),
    [
        ("goto", PLACE | {"override": ["sun"]}, "go to α 05:32:12.0 δ -04:52:12, overriding sun"),
        ("nudge", {"east_arcmin": 0.0, "north_arcmin": 0.5}, "nudge 30″ north"),
        ("set", {"name": "a.b", "value": 3, "frames": 1}, "a.b 3 for 1 frame"),
        ("track", {"on": False}, "stand still"),
        ("arm", {"override": []}, "arm"),
        ("mark", {"frame": 7}, "mark, frame 7"),
        ("goto", {"alt": 50, "az": None}, "goto, alt 50"),
        ("of another version", {"a": [1, 2], "b": ""}, "of another version, a 1, 2"),
    ],
)
def test_any_sessions_record_has_words(verb: str, arguments: dict[str, Any], says: str):
    assert command_words(verb, arguments) == says


def test_what_each_verb_may_is_as_it_has_been():
    def those(name: str) -> set[str]:
        return {verb for verb, command in COMMANDS.items() if getattr(command, name)}

    assert those("is_immediate") == {"stop", "status"}
    assert those("is_urgent") == {
        *("abort", "track", "disarm", "goto", "nudge", "park", "unpark", "hold")
    }
    assert those("moves_mount") == {"goto", "nudge", "arm", "resume", "seek", "track"}
    assert those("survives_stop") == {"disarm", "shutdown", "stop", "status"}
    assert set(COMMANDS) - those("needs_control") == {
        *("stop", "status", "preview", "note", "ask_seat", "answer_seat")
    }
    assert those("is_on_panel") == {
        *("arm", "disarm", "hold", "resume", "set", "ask_seat", "answer_seat")
    }


def test_a_verb_is_taken_once():
    with pytest.raises(ValueError, match="a command 'stop' already"):
        register_command(Stop)
