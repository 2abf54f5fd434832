"""What can be done with a recorded night: small letters mean what they mean everywhere, capitals
are this screen's own."""

from rsoconsole.console.commands.command import KeyCommand, Place
from rsoconsole.console.commands.command import command as _command

_HERE: tuple[Place, ...] = ("review",)

REVIEW_COMMANDS: tuple[KeyCommand, ...] = (
    _command("play", "space", "Play or pause", "the night as it went on", "time", where=_HERE),
    _command("frame_back", "comma", "Frame back", "one frame", "time", where=_HERE),
    _command("frame_on", "full_stop", "Frame on", "one frame", "time", where=_HERE),
    _command("ten_back", "left", "Ten back", "ten frames", "time", where=_HERE),
    _command("ten_on", "right", "Ten on", "ten frames", "time", where=_HERE),
    _command("hundred_back", "pageup", "Hundred back", "a hundred frames", "time", where=_HERE),
    _command("hundred_on", "pagedown", "Hundred on", "a hundred frames", "time", where=_HERE),
    _command(
        "event_back",
        "less_than_sign",
        "Event back",
        "to the one before, of the chosen kind",
        "time",
        where=_HERE,
    ),
    _command(
        "event_on",
        "greater_than_sign",
        "Event on",
        "to the next one of the chosen kind",
        "time",
        where=_HERE,
    ),
    _command(
        "event_kind",
        "E",
        "Kind of event",
        "any, miss, rejection, loss, operator, note, alarm, or what the log is searched for",
        "time",
        where=_HERE,
    ),
    _command("first_frame", "home", "First frame", "of the night", "time", where=_HERE),
    _command(
        "last_frame",
        "end",
        "Last frame",
        "of a night that goes on: follow it from there",
        "time",
        where=_HERE,
    ),
    _command(
        "slower",
        "left_square_bracket,minus",
        "Slower",
        "of playing; ×1 is as it was",
        "time",
        where=_HERE,
    ),
    _command(
        "faster", "right_square_bracket,plus", "Faster", "of playing, to ×1000", "time", where=_HERE
    ),
    _command(
        "goto_moment",
        "g,colon",
        "Go to a moment",
        "a frame's number or a UTC time: 128, 03:14, 03:14:22",
        "time",
        where=_HERE,
    ),
    _command(
        "compare",
        "K",
        "Compare",
        "keeps this moment as A; from another one: both side by side",
        "time",
        where=_HERE,
    ),
    _command(
        "blink",
        "B",
        "Blink",
        "the whole screen between A and where you were",
        "time",
        where=_HERE,
    ),
    _command(
        "forget_moment", "U", "Forget A", "no moment is kept to compare with", "time", where=_HERE
    ),
    _command(
        "tune_scope",
        "A",
        "Tune over all frames",
        "the tuning pane computes over the last 40 frames, or over all so far",
        "streaks",
        where=_HERE,
    ),
)
