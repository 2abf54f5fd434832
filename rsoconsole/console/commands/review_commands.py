"""What can be done with a recorded night: small letters mean what they mean everywhere, capitals
are this screen's own."""

from functools import partial

from rsoconsole.console.commands.command import KeyCommand, Place
from rsoconsole.console.commands.command import command as _command

_HERE: tuple[Place, ...] = ("review",)
_time = partial(_command, group="time", where=_HERE)

REVIEW_COMMANDS: tuple[KeyCommand, ...] = (
    _time("play", "space", "Play or pause", "the night as it went on"),
    _time("frame_back", "comma", "Frame back", "one frame"),
    _time("frame_on", "full_stop", "Frame on", "one frame"),
    _time("ten_back", "left", "Ten back", "ten frames"),
    _time("ten_on", "right", "Ten on", "ten frames"),
    _time("hundred_back", "pageup", "Hundred back", "a hundred frames"),
    _time("hundred_on", "pagedown", "Hundred on", "a hundred frames"),
    _time("event_back", "less_than_sign", "Event back", "to the one before, of the chosen kind"),
    _time("event_on", "greater_than_sign", "Event on", "to the next one of the chosen kind"),
    _time(
        "event_kind",
        "E",
        "Kind of event",
        "any, miss, rejection, loss, operator, note, alarm, or what the log is searched for",
    ),
    _time("first_frame", "home", "First frame", "of the night"),
    _time("last_frame", "end", "Last frame", "of a night that goes on: follow it from there"),
    _time("slower", "left_square_bracket,minus", "Slower", "of playing; ×1 is as it was"),
    _time("faster", "right_square_bracket,plus", "Faster", "of playing, to ×1000"),
    _time(
        "goto_moment",
        "g,colon",
        "Go to a moment",
        "a frame's number or a UTC time: 128, 03:14, 03:14:22",
    ),
    _time("compare", "K", "Compare", "keeps this moment as A; from another one: both side by side"),
    _time("blink", "B", "Blink", "the whole screen between A and where you were"),
    _time("forget_moment", "U", "Forget A", "no moment is kept to compare with"),
    _command(
        "tune_scope",
        "A",
        "Tune over all frames",
        "the tuning pane computes over the last 40 frames, or over all so far",
        "streaks",
        where=_HERE,
    ),
)
