"""What reasons meant while they were sentences: the one place that reads prose.

That were all of schema 1 to 3, and in the first sessions of schema 4 outcomes of commands, what
spoke against a candidate, what misses were put down to, what ended tracks and why slews were
refused. What is not recognised is told as it was. Figures are those that the sentence told.
"""

import re
import types
from collections.abc import Mapping

from rsoconsole.reasons import (
    ACCEPTED,
    DONE,
    BelowTau,
    Cause,
    CauseKind,
    CommandResult,
    DroppedBy,
    HiddenBy,
    Missed,
    MissKind,
    MotionMismatch,
    NotAStreak,
    NotAStreakKind,
    NotTaken,
    NotTakenKind,
    ResultKind,
    RuledKind,
    SlewRefusal,
    SlewRefusalKind,
    TrackLost,
    Unclassified,
    done,
)
from rsoconsole.records import Topic

_BELOW_TAU = re.compile(r"confidence (?P<confidence>\d\.\d\d) below tau (?P<tau>\d\.\d\d)")
_NIS = re.compile(r"NIS (?P<nis>[\d.]+) above the gate (?P<limit>[\d.]+)")
_FAR = re.compile(
    r"clipped, and (?P<away>\d+) arcsec from the prediction, (?P<allowed>\d+) at most"
)
_RUNS = re.compile(r"streak runs (?P<off>\d+) deg off the expected motion")
_IS_LONG = re.compile(r"streak is (?P<length>\d+) arcsec long, (?P<expected>\d+) expected")
_NO_SECOND = "no second frame: "
_NOT_TAKEN: dict[str, NotTakenKind] = {
    "cannot be told apart from its neighbour": "cannot be told apart",
    "refused by the operator": "refused",
    "the operator chose another one": "not chosen",
    "another one is taken": "another taken",
    "another one leads": "another leads",
    "clipped by the frame: starts no track": "clipped at start",
    "stands where a neighbour of the one followed was": "neighbour",
}
_FIGURES = {
    "value": r"(?P<value>[+-]?\d+\.\d)",
    "bound": r"(?P<bound>-?\d+\.\d)",
    "by": r"(?P<by>\d+\.\d|0\.\d{3}|less than 0\.001)",
    "azimuth": r"(?P<azimuth>\d+)",
    "side": "(?P<side>east|west|None)",
    "later": r"(, (?P<later>\d+) s from now)?",
    "ago": r"(?P<ago>\d+)",
    "ahead": r"(?P<ahead>\d+\.\d)",
    "detail": "(?P<detail>.*)",
}
_REFUSAL_WORDS: tuple[tuple[SlewRefusalKind, str], ...] = (
    ("altitude", "altitude {value} deg is {by} below the limit of {bound}{later}"),
    (
        "horizon",
        "altitude {value} deg is {by} below the horizon of {bound} at azimuth {azimuth}{later}",
    ),
    ("hour angle", "hour angle {value} deg is {by} beyond the limit of {bound}{later}"),
    (
        "pier",
        "hour angle {value} deg {side} of the pier is {by} past the meridian's limit of"
        " {bound}{later}",
    ),
    (
        "polar axis",
        "the polar axis stands {value} deg past the meridian, {by} beyond the limit of {bound}",
    ),
    ("Sun", "{value} deg from the Sun is {by} inside its cone of {bound}{later}"),
    (
        "past the Sun",
        "the way there passes {value} deg from the Sun, {by} inside its cone of {bound}",
    ),
    (
        "nearer to the Sun",
        "the way there comes to {value} deg from the Sun, {by} nearer than {bound} before",
    ),
    ("twilight", "the Sun at altitude {value} deg is {by} above the limit of {bound}{later}"),
    (
        "meridian policy",
        "hour angle {value} deg: the mount would change to the {side} side of its pier,"
        r" and mount\.meridian is hold",
    ),
    ("direction", "{detail} is no direction"),
    ("clock", "the clock says {detail}: set it"),
    ("aimed before", "aimed for {ago} min ago, at most 5 are taken"),
    ("aimed ahead", "aimed {ahead} h ahead, at most 2 are taken"),
    ("ends before", "the exposure would end before it is aimed for or before now"),
    ("ends ahead", "ends {ahead} h ahead, at most 4 are taken"),
)
_REFUSALS = tuple((kind, re.compile(said.format(**_FIGURES))) for kind, said in _REFUSAL_WORDS)
_REFUSED = "slew refused: "
_HIDDEN = re.compile(
    r"cloud: (?P<stars>\d+) stars where (?P<usual>\d+) were"
    r"|cloud: the stars are (?P<mag>[\d.]+) mag fainter"
    r"|only (?P<few>\d+) stars, cloud\?"
    r"|(?P<shadow>eclipse: in the Earth's shadow)"
    r"|eclipse: in the penumbra, (?P<percent>\d+)% of the Sun left"
)
_LOST = re.compile(
    r"3 sigma of (?P<arcmin>\d+) arcmin ((?P<field>no longer fits the field)|is too wide)"
    r"|coasted for (?P<min>\d+) min"
)
_MISSED: dict[str, MissKind] = {
    "no detection": "no detection",
    "nothing fits the prediction": "nothing fits",
    "cannot be told apart from its neighbour": "cannot be told apart",
    "the frame has no time": "no time",
    "not measured": "not measured",
}
_NOT_SOLVED = "detected, but not solved: "
_PLAIN: dict[str, CauseKind] = {
    "the engine ends": "engine ended",
    "two frames agree on one motion": "two frames agree",
    "measured again": "measured again",
}
_BY: tuple[CauseKind, ...] = ("armed", "disarmed", "STOP", "resumed", "looked for again")
_DETAILED: dict[str, CauseKind] = {
    "limit met: ": "limit met",
    "the night ends: ": "night ended",
    "not armed: ": "not pointing",
}
_MOVES, _TOO_MANY = " moves the mount", "; move away by hand or park, then arm again"
_CLOCK = re.compile(r"the clock was set by (?P<step_s>[+-][\d.]+) s")
_WAITING = re.compile(r"(?P<detections>\d+) detections?, waiting for a second frame")
_RULED = re.compile(r"frame \d+: (rejected|taken).*|followed again by the operator's word")
_NOT_A_STREAK: dict[str, NotAStreakKind] = {
    "the line fit broke on it: see the log": "fit broke",
    "same streak as a more confident candidate": "same streak",
    "no unbroken light along a line there": "no light",
    "light goes on beyond its ends: part of a longer trail": "longer trail",
    "patchy or bent: a cosmic ray or stars in a row": "patchy",
    "dark in between: stars in a row": "dark in between",
    "no line fits the light in the box": "no line",
    "the box lies outside the frame": "outside the frame",
    "no ends found: nothing stands out of the sky along a line": "nothing stands out",
    "no ends found: the light runs on for a thousand pixels or more": "runs on far",
    "no ends found: the light runs on": "runs on",
    "darker than the sky": "darker than the sky",
    "no ends found: they fade into the sky or lie behind a star": "no ends",
}
_VALUE, _LIMIT = r"(?P<value>[\d.]+)", r"(?P<limit>[\d.]+)"
_WITH_FIGURES: tuple[tuple[str, NotAStreakKind, float], ...] = (
    ("not measured: {limit} more confident candidates in the frame", "not measured", 1.0),
    ("below tau {limit} however well a line fits", "below tau", 1.0),
    (
        "one of {value} streaks of one length and direction: the stars are trailed",
        "trailed stars",
        1.0,
    ),
    ("too faint: signal to noise {value}, {limit} needed", "too faint", 1.0),
    (r"narrower than a star \({value} of {limit} px\): a cosmic ray", "too narrow", 1.0),
    (
        r"wider than a star \({value} of {limit} px\): an aircraft or glare",
        "too wide",
        1.0,
    ),
    ("too short: {value} px, hardly longer than a star is wide", "too short", 1.0),
    ("only {value} % of its length is lit: not one streak", "unlit", 0.01),
    ("uneven over {value} % of its length: stars in a row", "uneven", 0.01),
    ("light uneven by {value} %: stars in a row", "uneven", 0.01),
)
"""Sentences with figures: kind, and the unit of the value told."""
_MEASURED: tuple[tuple[re.Pattern[str], NotAStreakKind, float], ...] = tuple(
    (re.compile(pattern.replace("{value}", _VALUE).replace("{limit}", _LIMIT)), kind, unit)
    for pattern, kind, unit in _WITH_FIGURES
)
OUTCOME_KINDS: Mapping[str, ResultKind] = types.MappingProxyType({"stopped": "answered"})
"""What came of a command, as its kind was first -> as it is: the mount's word was a STOP's end."""
_STOPPED = re.compile(r"stopped in (?P<ms>\d+) ms by (?P<path>.*)")
_RESULT = re.compile(
    r"frame (?P<frame_id>\d+): (?P<ruled>rejected|taken by the operator's hand|taken)"
    r"(, (?P<left_alone>\d+) left alone)?"
)
_DROPPED: dict[str, DroppedBy] = {
    "dropped by STOP": "STOP",
    "dropped: a limit was met": "limit met",
    "dropped: the night ends": "night ended",
    "dropped: the engine ends": "engine ended",
}


def result(words: str) -> CommandResult:  # noqa: PLR0911 -- one case a kind
    """What came of a command."""
    if words in _DROPPED:
        return CommandResult(kind="dropped", dropped_by=_DROPPED[words])
    if words in {"accepted", "done"}:
        return ACCEPTED if words == "accepted" else DONE
    if words.startswith("refused: "):
        return CommandResult.refused(words.removeprefix("refused: "))
    if words.startswith("NOT confirmed: "):
        return CommandResult(kind="failed", detail=words.removeprefix("NOT confirmed: "))
    if (found := _STOPPED.fullmatch(words)) is not None:
        return CommandResult(kind="answered", stop_ms=float(found["ms"]), stop_path=found["path"])
    if (found := _RESULT.fullmatch(words)) is not None:
        ruled: RuledKind = "rejected" if found["ruled"] == "rejected" else "taken"
        return CommandResult(
            kind="ruled",
            ruled="taken by hand" if "hand" in found["ruled"] else ruled,
            frame_id=int(found["frame_id"]),
            left_alone=int(found["left_alone"] or 0),
        )
    return done(words)


def rejected(words: str) -> BelowTau | NotAStreak | Unclassified:
    """Why a candidate was rejected."""
    found = _BELOW_TAU.fullmatch(words)
    if found is not None:
        return BelowTau(confidence=float(found["confidence"]), tau=float(found["tau"]))
    if words in _NOT_A_STREAK:
        return NotAStreak(kind=_NOT_A_STREAK[words])
    for pattern, kind, unit in _MEASURED:
        if (found := pattern.fullmatch(words)) is not None:
            parts = {name: float(figure) for name, figure in found.groupdict().items()}
            value = None if "value" not in parts else parts["value"] * unit
            return NotAStreak(kind=kind, value=value, limit=parts.get("limit"))
    return Unclassified(words=words)


def not_taken(words: str) -> NotTaken | Unclassified:
    """Why a track did not take a measurement."""
    if (found := _NIS.fullmatch(words)) is not None:
        return NotTaken(kind="NIS", nis=float(found["nis"]), limit=float(found["limit"]))
    if (found := _FAR.fullmatch(words)) is not None:
        return NotTaken.clipped_and_far(float(found["away"]), float(found["allowed"]))
    if words.startswith(_NO_SECOND):
        return _no_second(words.removeprefix(_NO_SECOND)) or Unclassified(words=words)
    if (mismatch := _mismatch(words)) is not None:
        return NotTaken(kind="moves otherwise", mismatch=mismatch)
    kind = _NOT_TAKEN.get(words)
    return Unclassified(words=words) if kind is None else NotTaken(kind=kind)


def _mismatch(words: str) -> MotionMismatch | None:
    if (found := _RUNS.fullmatch(words)) is not None:
        return MotionMismatch.of_direction(float(found["off"]))
    if (found := _IS_LONG.fullmatch(words)) is not None:
        return MotionMismatch.of_length(float(found["length"]), float(found["expected"]))
    is_order = words == "frames are not in order of time"
    return MotionMismatch(kind="order of time") if is_order else None


def _no_second(words: str) -> NotTaken | None:
    """Why no second frame began a track with it."""
    absent = missed(words)
    if isinstance(absent, Missed):
        return NotTaken(kind="no second frame", missed=absent)
    mismatch = _mismatch(words)
    if mismatch is None and words != "None":
        return None
    return NotTaken(kind="no second frame", mismatch=mismatch)


def missed(words: str) -> Missed | Unclassified:
    """Why a frame had no measurement."""
    left, _, last = words.rpartition("; ")
    ended = track_lost(last)
    lost = None if isinstance(ended, Unclassified) else ended
    left = words if lost is None else left
    if _NOT_SOLVED in left:
        hidden, _, detail = left.partition(_NOT_SOLVED)
        hidden_by = hidden_by_all(hidden.removesuffix("; "))
        return Missed(kind="not solved", detail=detail, hidden_by=hidden_by, lost=lost)
    hidden, _, plain = left.rpartition("; ")
    kind = _MISSED.get(plain)
    if kind is None:
        return Unclassified(words=words)
    return Missed(kind=kind, hidden_by=hidden_by_all(hidden), lost=lost)


def hidden_by_all(words: str) -> tuple[HiddenBy | Unclassified, ...]:
    """What a miss was put down to, as joined in one sentence; a refusal may hold semicolons."""
    left, behind = words, list[HiddenBy | Unclassified]()
    while left:
        before, _, last = left.rpartition("; ")
        cause = _hidden_by(last)
        if cause is None:
            break
        left, behind = before, [cause, *behind]
    if left.startswith(_REFUSED):
        refusal = slew_refusal(left.removeprefix(_REFUSED))
        behind.insert(0, HiddenBy(kind="slew refused", refusal=refusal))
    elif left:
        behind.insert(0, Unclassified(words=left))
    return tuple(behind)


def _hidden_by(words: str) -> HiddenBy | None:
    """Cloud or eclipse."""
    found = _HIDDEN.fullmatch(words)
    if found is None:
        return None
    if found["usual"] is not None:
        few, usual = int(found["stars"]), int(found["usual"])
        return HiddenBy(kind="fewer stars", stars=few, usual_stars=usual)
    if found["mag"] is not None:
        return HiddenBy.by_faint_stars(float(found["mag"]))
    if found["few"] is not None:
        return HiddenBy(kind="few stars", stars=int(found["few"]))
    if found["percent"] is not None:
        return HiddenBy(kind="penumbra", sun_percent=float(found["percent"]))
    return HiddenBy(kind="shadow")


def slew_refusal(words: str) -> SlewRefusal | Unclassified:
    """Why a slew was refused."""
    for kind, pattern in _REFUSALS:
        if (found := pattern.fullmatch(words)) is not None:
            parts = {name: said for name, said in found.groupdict().items() if said is not None}
            return _refusal(kind, parts)
    return Unclassified(words=words)


def _refusal(kind: SlewRefusalKind, parts: dict[str, str]) -> SlewRefusal:
    def figure(name: str) -> float | None:
        return float(parts[name]) if name in parts else None

    by_deg = 0.0 if parts.get("by") == "less than 0.001" else figure("by")
    side = parts.get("side")
    return SlewRefusal(
        kind=kind,
        value_deg=figure("value"),
        bound_deg=figure("bound"),
        # What was told as 0.100 was less than 0.1, which is told with one decimal.
        by_deg=0.0999 if parts.get("by") == "0.100" else by_deg,
        azimuth_deg=figure("azimuth"),
        side="east" if side == "east" else "west" if side == "west" else None,
        later_s=figure("later"),
        ago_min=figure("ago"),
        ahead_h=figure("ahead"),
        detail=parts.get("detail", ""),
    )


def track_lost(words: str) -> TrackLost | Unclassified:
    """What ended a track."""
    found = _LOST.fullmatch(words)
    if found is None:
        return Unclassified(words=words)
    if found["min"] is not None:
        return TrackLost(kind="coasted", coasted_min=float(found["min"]))
    return TrackLost.by_bounds(float(found["arcmin"]), fits_field=found["field"] is None)


def cause(words: str) -> Cause | Unclassified:  # noqa: PLR0911 -- one case a kind
    """Why the loop passed to another state."""
    if words in _PLAIN:
        return Cause(kind=_PLAIN[words])
    for kind in _BY:
        if words.startswith(f"{kind} by "):
            return Cause(kind=kind, by=words.removeprefix(f"{kind} by "))
    for begins, detailed in _DETAILED.items():
        if words.startswith(begins):
            return Cause(kind=detailed, detail=words.removeprefix(begins))
    if words.endswith(_MOVES):
        return Cause(kind="moved by hand", by=words.removesuffix(_MOVES))
    if words.endswith(_TOO_MANY):
        return Cause(kind="too many limits", detail=words.removesuffix(_TOO_MANY))
    if (found := _CLOCK.fullmatch(words)) is not None:
        return Cause(kind="clock set", step_s=float(found["step_s"]))
    if (found := _WAITING.fullmatch(words)) is not None:
        return Cause(kind="waiting", detections=int(found["detections"]))
    if _RULED.fullmatch(words) is not None:
        return Cause(kind="operator's word", detail=words)
    miss = missed(words)
    return miss if isinstance(miss, Unclassified) else Cause(kind="missed", missed=miss)


def topic_of(words: str) -> Topic:
    """What a line of the log is about."""
    if words.startswith("limit:"):
        return "limit"
    return "machine" if words.startswith("machine: ") else ""
