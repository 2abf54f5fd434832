"""Reasons as sentences: the one place that words them. Nothing is ever decided by the words."""

from typing import assert_never

from rsoconsole.reasons import BelowTau, Cause, Missed, MissKind, NotTaken, Reason

_MISSED: dict[MissKind, str] = {
    "no detection": "no detection",
    "nothing fits": "nothing fits the prediction",
    "cannot be told apart": "cannot be told apart from its neighbour",
    "not solved": "detected, but not solved: {detail}",
    "no time": "the frame has no time",
    "not measured": "not measured",
    "instrument": "{detail}",
}


def text(reason: Reason | str) -> str:
    """The sentence."""
    match reason:
        case str():
            return reason
        case BelowTau():
            return f"confidence {reason.confidence:.2f} below tau {reason.tau:.2f}"
        case NotTaken():
            return _not_taken(reason)
        case Missed():
            said = _MISSED[reason.kind].replace("{detail}", reason.detail)
            return "; ".join(part for part in (reason.hidden_by, said, reason.lost) if part)
        case Cause():
            return _cause(reason)
        case _:
            assert_never(reason)


def _not_taken(reason: NotTaken) -> str:  # noqa: PLR0911 -- one case a kind
    match reason.kind:
        case "NIS":
            return f"NIS {reason.nis or 0.0:.1f} above the gate {reason.limit or 0.0:.1f}"
        case "cannot be told apart":
            return "cannot be told apart from its neighbour"
        case "refused":
            return "refused by the operator"
        case "not chosen":
            return "the operator chose another one"
        case "another taken":
            return "another one is taken"
        case "another leads":
            return "another one leads"
        case "clipped at start":
            return "clipped by the frame: starts no track"
        case "neighbour":
            return "stands where a neighbour of the one followed was"
        case _:
            assert_never(reason.kind)


def _cause(reason: Cause) -> str:  # noqa: PLR0911, PLR0912 -- one case a kind
    match reason.kind:
        case "armed" | "disarmed" | "STOP" | "resumed" | "looked for again":
            return f"{reason.kind} by {reason.by}"
        case "moved by hand":
            return f"{reason.by} moves the mount"
        case "limit met":
            return f"limit met: {reason.detail}"
        case "too many limits":
            return f"{reason.detail}; move away by hand or park, then arm again"
        case "clock set":
            return f"the clock was set by {reason.step_s or 0.0:+.1f} s"
        case "night ended":
            return f"the night ends: {reason.detail}"
        case "not pointing":
            return f"not armed: {reason.detail}"
        case "instrument" | "operator's word":
            return reason.detail
        case "engine ended":
            return "the engine ends"
        case "two frames agree":
            return "two frames agree on one motion"
        case "measured again":
            return "measured again"
        case "waiting":
            plural = "" if reason.detections == 1 else "s"
            return f"{reason.detections} detection{plural}, waiting for a second frame"
        case "missed":
            return text(reason.missed or "")
        case _:
            assert_never(reason.kind)
