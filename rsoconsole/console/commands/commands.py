"""The list of all console commands, from which keys, palette, help and footer are built.

A keymap file assigns other keys to a command by its name.
"""

from collections.abc import Mapping
from functools import partial

from rsoconsole.console.commands.command import BOTH, KeyCommand, Place
from rsoconsole.control import Abort, Unpark, WithdrawDecisions

_HERE: tuple[Place, ...] = ("review",)
_time = partial(KeyCommand, group="time", where=_HERE)

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
    KeyCommand(
        "tune_scope",
        "A",
        "Tune over all frames",
        "the tuning pane computes over the last 40 frames, or over all so far",
        "streaks",
        where=_HERE,
    ),
)


_telescope = partial(KeyCommand, group="telescope", acts=True)
_streaks = partial(KeyCommand, group="streaks", acts=True)
_on_both = partial(KeyCommand, where=BOTH)

SEAT_COMMANDS: tuple[KeyCommand, ...] = (
    KeyCommand(
        "stop",
        "ctrl+x",
        "STOP",
        "end every motion and exposure, disarm; works in dialogs and fields too",
        "safety",
        priority=True,
        is_everywhere=True,
    ),
    KeyCommand(
        "stop_by_letter",
        "x",
        "STOP",
        "the same, wherever one does not type",
        "safety",
        priority=True,
        is_everywhere=True,
    ),
    _telescope(
        "arm_or_disarm",
        "a",
        "Arm or disarm",
        "hand the mount to the engine, after its checklist; once more: disarm, where a track"
        " runs by a second press",
    ),
    _telescope(
        "hold_or_resume",
        "h",
        "Hold or resume",
        "no slews, still measured; once more: the mount back to autonomy, or an ended track"
        " followed again",
    ),
    _telescope(
        "wait_for_sky",
        "w",
        "Hold until it clears",
        "no slews while it is cloudy; goes on by itself when the stars are back",
    ),
    _telescope(
        "goto",
        "g",
        "Go to",
        "coordinates in any notation, a satellite, a star; shows the way before anything moves",
    ),
    KeyCommand(
        "up_now",
        "5",
        "What is up now",
        "satellites of the element files above the limit; enter plans a go-to",
        "telescope",
    ),
    _telescope("nudge_up", "up", "Nudge up", "by the step, up in the picture"),
    _telescope("nudge_down", "down", "Nudge down", "by the step, down in the picture"),
    _telescope("nudge_left", "left", "Nudge left", "by the step, left in the picture"),
    _telescope("nudge_right", "right", "Nudge right", "by the step, right in the picture"),
    KeyCommand(
        "smaller_step",
        "left_square_bracket",
        "Smaller step",
        "of the mount's nudges by arrows: 30′, 10′, 3′, 1′, 20″, 5″",
        "telescope",
    ),
    KeyCommand(
        "larger_step",
        "right_square_bracket",
        "Larger step",
        "of the nudges; in an opened frame both are of its cross",
        "telescope",
    ),
    _telescope(
        "aim",
        "i",
        "Aim beside",
        "ahead of or behind the prediction in time, along or across its motion",
    ),
    _telescope(
        "exposure", "e", "Exposure and cadence", "how long the shutter is open, and how often"
    ),
    _telescope(
        "abort_exposure",
        "b",
        "Abort the exposure",
        "give up the running exposure; the next begins as planned",
        sends=Abort(),
    ),
    _telescope("park", "p", "Park", "asks once; disarms and sends the mount to its park position"),
    _telescope(
        "undo",
        "u",
        "Follow again",
        "undo: a track that was dropped, for 12 frames; one that your own move ended, as long as it"
        " may be coasted (2 h, filter.max_coast_s); one that disarming, a search, a STOP or a fault"
        " ended, for at most 15 min of that: after a STOP it arms first; the first line counts the"
        " time down; a parked mount is released",
    ),
    _telescope(
        "unpark", "ctrl+u", "Unpark", "releases a parked mount; nothing moves", sends=Unpark()
    ),
    _telescope(
        "track_or_stand",
        "k",
        "Track or stand",
        "sidereal tracking on and off, while nobody else has the mount",
    ),
    _on_both(
        "verdicts",
        "v",
        "Verdicts",
        "every streak of the frame, what became of it and why; first after a mark those of"
        " the marked one, tab shows the other",
        "streaks",
    ),
    _streaks(
        "follow_next",
        "d",
        "Follow the next streak",
        "the next detection of the frame, or the one clicked, is the one to follow; that of another"
        " track makes it the lead; where no track would end, a click alone chooses",
    ),
    _streaks(
        "centre", "c", "Centre the streak", "point the telescope at what is followed, by hand"
    ),
    _streaks(
        "mark",
        "m",
        "Mark by hand",
        "the streak's two ends: arrows and enter twice, or drag; a measurement of your own, and"
        " two of them in two frames start a track. It can be begun in the last 12 frames; while"
        " you mark, the frame is kept for 600 more",
    ),
    _streaks(
        "accept", "y", "Accept", "take the frame's likeliest candidate, whatever the gates said"
    ),
    _streaks(
        "reject",
        "j",
        "Reject",
        "one of the last measurements, by its number, was something else: the track as if"
        " without it",
    ),
    _streaks(
        "take_back",
        "backspace",
        "Take back",
        "your last mark, choice, acceptance or rejection, as if it had not been said",
        sends=WithdrawDecisions(),
    ),
    _streaks(
        "seek",
        "s",
        "Seek it again",
        "search round where it must be, in a widening spiral; gives up a track, which asks for a"
        " second press",
    ),
    _on_both(
        "orbit",
        "o",
        "Orbit",
        "its elements, where it leads, which catalogued object it is; once more: as before",
        "streaks",
    ),
    _on_both(
        "tune",
        "t",
        "Tune",
        "tau, Q, R, gate and limits, with the effect on what was recorded shown first",
        "streaks",
    ),
    _on_both(
        "track_plots",
        "1",
        "Plots of the track",
        "confidence, residuals in their bounds, NIS",
        "plots",
    ),
    _on_both(
        "night_curves",
        "2",
        "Curves of the night",
        "FWHM, background, transparency and number of stars; once more: the plots",
        "plots",
    ),
    _on_both(
        "focus_help",
        "3",
        "Focus",
        "FWHM in large figures and its trend; once more: the plots",
        "plots",
    ),
    _on_both(
        "alignment",
        "4",
        "Drift and polar alignment",
        "how mount and stars drift apart, field rotation, which way the polar axis is off",
        "plots",
    ),
    _on_both(
        "track_list",
        "6",
        "Tracks of the field",
        "every satellite that is followed: state, residual, NIS; arrows choose one, enter makes it"
        " the lead, - drops it (u takes that back), + keeps it whatever it misses, → shows who"
        " stands next to whom, when they come closest and who is missing; once more: the plots of"
        " the chosen one",
        "plots",
    ),
    _on_both(
        "light_curve",
        "7",
        "Brightness of the track",
        "its magnitude in each frame with its error, bright side up, and its scatter; once more:"
        " the plots",
        "plots",
    ),
    _on_both(
        "next_track",
        "tab",
        "Next satellite",
        "the plots of the next one that is followed",
        "plots",
    ),
    KeyCommand("plots_back", "comma", "Plots back", "to earlier frames", "plots"),
    KeyCommand("plots_on", "full_stop", "Plots on", "to later frames", "plots"),
    KeyCommand("plots_wider", "minus", "More frames", "twice as many to a mark", "plots"),
    KeyCommand("plots_finer", "plus", "Fewer frames", "half as many to a mark", "plots"),
    KeyCommand("plots_newest", "end", "Newest frames", "one to a mark", "plots"),
    _on_both(
        "zoom", "z", "Zoom", "the field, the close-up, the close-up pixel by pixel", "picture"
    ),
    _on_both(
        "open_frame",
        "enter",
        "Open the frame",
        "at full resolution, where its pixels were kept; process it again with another τ or map",
        "picture",
    ),
    _on_both(
        "stretch",
        "f",
        "Stretch",
        "field as a chart, or its light: streaks, asinh, linear",
        "picture",
    ),
    _on_both(
        "give_seat",
        "ctrl+g",
        "Give control",
        "to the console that asks for it; said nothing, it goes there after 30 s",
        "console",
        acts=True,
    ),
    _on_both(
        "keep_seat",
        "ctrl+k",
        "Keep control",
        "though another console asks for it",
        "console",
        acts=True,
    ),
    _on_both(
        "sessions",
        "r",
        "Sessions and review",
        "the recorded nights, and this one: any moment of them again",
        "console",
    ),
    KeyCommand("note", "n", "Note", "a remark into the session", "console", acts=True),
    _on_both("log", "l", "Log", "all of it, and back; slash filters it", "console"),
    _on_both(
        "read",
        "ctrl+o",
        "Messages in full",
        "everything that was said, none of it cut; enter copies the chosen one",
        "console",
    ),
    _on_both(
        "copy",
        "ctrl+y",
        "Copy",
        "what is looked at, to the terminal's clipboard (OSC 52): a line of the log, the orbit,"
        " the tuning, or where things stand; shift and drag selects by the mouse in most terminals",
        "console",
    ),
    _on_both("filter_log", "slash", "Filter the log", "only lines with what you type", "console"),
    _on_both(
        "leave", "q", "Leave", "asks what becomes of the engine; from a review: back", "console"
    ),
    _on_both(
        "put_away",
        "escape",
        "Put away",
        "the log, a mark, what came of a STOP, the orbit, a notice",
        "console",
    ),
    KeyCommand(
        "help", "f1,question_mark", "Help", "the keys and signs", "console", is_everywhere=True
    ),
    KeyCommand(
        "suspend",
        "ctrl+z",
        "Suspend",
        "back to the shell, 'fg' comes back; the engine goes on meanwhile",
        "console",
        is_everywhere=True,
    ),
    KeyCommand(
        "colours",
        "ctrl+t",
        "Colours",
        "night (deep red) first, then the terminal's own, light last",
        "console",
        is_everywhere=True,
    ),
)
COMMANDS: tuple[KeyCommand, ...] = (*SEAT_COMMANDS, *REVIEW_COMMANDS)
BY_NAME: Mapping[str, KeyCommand] = {command.name: command for command in COMMANDS}


def commands_in(place: Place) -> tuple[KeyCommand, ...]:
    """Return the commands whose keys work on that screen, with those of the application."""
    return tuple(command for command in COMMANDS if command.is_available_on(place))
