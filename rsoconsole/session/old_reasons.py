"""What reasons meant while they were sentences (schema 1 to 3): the one place that reads prose.

What is not recognised stays text. Figures are those that the sentence told.
"""

import re

from rsoconsole.reasons import BelowTau, Cause, CauseKind, Missed, MissKind, NotTaken, NotTakenKind
from rsoconsole.records import Topic

_BELOW_TAU = re.compile(r"confidence (?P<confidence>\d\.\d\d) below tau (?P<tau>\d\.\d\d)")
_NIS = re.compile(r"NIS (?P<nis>[\d.]+) above the gate (?P<limit>[\d.]+)")
_NOT_TAKEN: dict[str, NotTakenKind] = {
    "cannot be told apart from its neighbour": "cannot be told apart",
    "refused by the operator": "refused",
    "the operator chose another one": "not chosen",
    "another one is taken": "another taken",
    "another one leads": "another leads",
    "clipped by the frame: starts no track": "clipped at start",
    "stands where a neighbour of the one followed was": "neighbour",
}
_LOST = re.compile(
    r"; (?P<lost>3 sigma of \d+ arcmin (no longer fits the field|is too wide)"
    r"|coasted for \d+ min)$"
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


def below_tau(words: str) -> BelowTau | str:
    """Why a candidate was rejected."""
    found = _BELOW_TAU.fullmatch(words)
    if found is None:
        return words
    return BelowTau(confidence=float(found["confidence"]), tau=float(found["tau"]))


def not_taken(words: str) -> NotTaken | str:
    """Why a track did not take a measurement."""
    if (found := _NIS.fullmatch(words)) is not None:
        return NotTaken(kind="NIS", nis=float(found["nis"]), limit=float(found["limit"]))
    kind = _NOT_TAKEN.get(words)
    return words if kind is None else NotTaken(kind=kind)


def missed(words: str) -> Missed | str:
    """Why a frame had no measurement."""
    found = _LOST.search(words)
    lost = "" if found is None else found["lost"]
    left = words if found is None else words[: found.start()]
    if _NOT_SOLVED in left:
        hidden, _, detail = left.partition(_NOT_SOLVED)
        hidden_by = hidden.removesuffix("; ")
        return Missed(kind="not solved", detail=detail, hidden_by=hidden_by, lost=lost)
    hidden_by, _, plain = left.rpartition("; ")
    kind = _MISSED.get(plain)
    return words if kind is None else Missed(kind=kind, hidden_by=hidden_by, lost=lost)


def cause(words: str) -> Cause | str:  # noqa: PLR0911 -- one case a kind
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
    return words if isinstance(miss, str) else Cause(kind="missed", missed=miss)


def topic_of(words: str) -> Topic:
    """What a line of the log is about."""
    if words.startswith("limit:"):
        return "limit"
    return "machine" if words.startswith("machine: ") else ""
