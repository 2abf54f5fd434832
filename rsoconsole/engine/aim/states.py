"""The loop's state machine: its states, triggers and transitions; without side effects.

``step(authority, trigger)`` returns the next state and the actions that it needs; the loop performs
and records them. Frames first pass through ``tracking.follow``, whose result arrives here as
``Followed``.

    IDLE -> SEARCH <-> ACQUIRE -> TRACK <-> COAST -> LOST -> SEARCH     while autonomy has the mount
    MANUAL     whenever the operator has it; autonomy waits until it is resumed or armed
    FAULT      with a reason and a way out
"""

from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import Any, Literal

from rsoconsole.records import Cause, LoopState
from rsoconsole.tracking import Following

Action = Literal["abort", "park", "start search", "search home", "forget plate"]
Holder = Literal["autonomy", "operator", "nobody"]

AUTONOMOUS: frozenset[LoopState] = frozenset(("SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST"))
FAILURES_IN_A_ROW = 3
NOTHING_HELD = "nothing is held: there is nothing to resume"


@dataclass(frozen=True, slots=True, kw_only=True)
class Authority:
    """State of the loop: who has control of the mount, and which tracks are followed."""

    following: Following = field(default_factory=lambda: Following(state="IDLE"))
    kept: Following | None = None
    """The track that ended by the operator's word, or with a fault: it can be followed again."""
    is_resumable: bool = False
    """True where autonomy may resume without arming, as the operator took over; not after STOP."""
    is_held: bool = False
    """True while the operator wants no slews: what is followed is coasted and measured."""
    resumes_when_clear: bool = False
    """True for a hold that ends by itself when the stars are back."""
    failures: int = 0
    """Exposures in a row that an instrument failed."""
    is_stopped: bool = False
    """True for a FAULT that a STOP led to: nothing moves the mount but by the operator's word."""
    was_autonomous: bool = False
    """True for a FAULT that took the mount from autonomy: nobody else looks after it."""

    @property
    def state(self) -> LoopState:
        """The loop's state."""
        return self.following.state

    @property
    def is_autonomous(self) -> bool:
        """True where autonomy may move the mount."""
        return self.state in AUTONOMOUS

    @property
    def is_responsible(self) -> bool:
        """True where autonomy must keep the mount safe: it has control, or a FAULT took it away.

        False in the FAULT after a STOP that the mount did not obey.
        """
        return self.is_autonomous or self.was_autonomous

    @property
    def tracked(self) -> Following | None:
        """The track that could be followed again if autonomy ended now; None without one.

        Detections of a search that are no track yet do not count: they soon leave the field.
        """
        return self.following if self.state in ("TRACK", "COAST") else self.kept

    @property
    def holder(self) -> Holder:
        """Controller of the mount: autonomy, the operator or nobody."""
        if self.is_autonomous:
            return "autonomy"
        return "operator" if self.state == "MANUAL" else "nobody"


@dataclass(frozen=True, slots=True, kw_only=True)
class Armed:
    """Trigger: the operator gives control of the mount to autonomy."""

    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Disarmed:
    """Trigger: the operator disarms without moving the mount; nobody has control after it."""

    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """Trigger: STOP was given, and ABORT has already been sent."""

    by: str
    is_obeyed: bool = True
    """The driver has taken ABORT, and the mount is not measured to move on."""
    words: str = ""
    """What was measured, where it is not obeyed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """Trigger: the operator moves the mount by hand."""

    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """Trigger: the operator forbids slews for now."""

    by: str
    until_clear: bool = False
    """Only as long as the sky is clouded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumed:
    """Trigger: the operator ends a hold, gives control back, or resumes an ended track."""

    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Sought:
    """Trigger: the operator orders a search around the last track's predicted position."""

    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """Trigger: a frame has updated the followed tracks."""

    after: Following


@dataclass(frozen=True, slots=True, kw_only=True)
class Marked:
    """Trigger: a decision on frames taken without autonomy makes or withdraws a track."""

    kept: Following | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """Trigger: an instrument has failed."""

    words: str
    is_final: bool = False
    """True when trying again is of no use."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitMet:
    """Trigger: the mount has met a limit, and its motion has already been ended."""

    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSet:
    """Trigger: this machine's or the camera's clock was set."""

    step_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NightEnded:
    """Trigger: dawn, weather or the dome ends the night."""

    words: str
    parks: bool
    is_dawn: bool = False
    """A night that has come to its end, and not one that was cut short."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotPointing:
    """Trigger: the first frame's stars disagree with the mount's reported direction."""

    words: str


Trigger = (
    Armed
    | Disarmed
    | Stopped
    | Taken
    | Held
    | Resumed
    | Sought
    | Followed
    | Marked
    | Failed
    | LimitMet
    | ClockSet
    | NightEnded
    | NotPointing
)


BY_OPERATOR = Armed | Disarmed | Stopped | Taken | Held | Resumed
"""What somebody wants, and what undoes therefore what was wanted before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """The next state after a trigger, with the actions it needs, or the refusal."""

    authority: Authority
    actions: tuple[Action, ...] = ()
    reason: Cause | None = None
    """Of the change of state, for the record."""
    refusal: str | None = None
    """Why nothing changes, where the operator asked for what cannot be."""


def step(authority: Authority, trigger: Trigger) -> Step:
    """Return the next state of the loop, and the actions that it needs."""
    return _step(trigger, authority)


@singledispatch
def _step(trigger: Any, authority: Authority) -> Step:  # noqa: ARG001
    raise TypeError(f"nothing is known of a {type(trigger).__name__}")


@_step.register
def _(trigger: Armed, authority: Authority) -> Step:
    if authority.is_autonomous:
        return Step(authority=authority, refusal="it is armed already")
    armed = Cause(kind="armed", by=trigger.by)
    return _keeping(
        _enter(authority, "SEARCH", armed, "start search", "forget plate"), authority.kept
    )


@_step.register
def _(trigger: Disarmed, authority: Authority) -> Step:
    disarmed = _enter(authority, "IDLE", Cause(kind="disarmed", by=trigger.by))
    is_resumable = authority.is_autonomous or authority.is_resumable
    return _keeping(disarmed, authority.tracked, is_resumable=is_resumable)


@_step.register
def _(trigger: Stopped, authority: Authority) -> Step:
    reason = Cause(kind="STOP", by=trigger.by)
    if trigger.is_obeyed:
        return _keeping(_enter(authority, "IDLE", reason, "abort"), authority.tracked)
    # Nobody knows whether it stands: no calm state.
    reason = replace(reason, detail="NOT OBEYED by the mount")
    unsure = _keeping(_enter(authority, "FAULT", reason, "abort"), authority.tracked)
    return replace(unsure, authority=replace(unsure.authority, is_stopped=True))


@_step.register
def _(trigger: Taken, authority: Authority) -> Step:
    is_given_back = authority.is_resumable and authority.state == "MANUAL"
    after = Authority(
        following=authority.following.without_track("MANUAL"),
        kept=authority.tracked,
        is_resumable=authority.is_autonomous or is_given_back,
    )
    return Step(
        authority=after,
        actions=("forget plate",),
        reason=Cause(kind="moved by hand", by=trigger.by),
    )


@_step.register
def _(trigger: Held, authority: Authority) -> Step:
    if not authority.is_autonomous:
        return Step(
            authority=authority, refusal="autonomy does not have the mount: nothing to hold"
        )
    held = replace(authority, is_held=True, resumes_when_clear=trigger.until_clear)
    return Step(authority=held)


@_step.register
def _(trigger: Resumed, authority: Authority) -> Step:
    if authority.is_autonomous and authority.is_held:
        return Step(authority=replace(authority, is_held=False, resumes_when_clear=False))
    refusal = _why_not_resumed(authority)
    if refusal is not None:
        return Step(authority=authority, refusal=refusal)
    reason = Cause(kind="resumed", by=trigger.by)
    if authority.kept is None:
        return _enter(authority, "SEARCH", reason, "start search", "forget plate")
    # Numbers are given once: a search may have begun other tracks meanwhile.
    last_track_id = max(authority.kept.last_track_id, authority.following.last_track_id)
    again = replace(authority.kept, state="COAST", candidates=(), last_track_id=last_track_id)
    return Step(authority=Authority(following=again), actions=("forget plate",), reason=reason)


def _why_not_resumed(authority: Authority) -> str | None:
    """Why autonomy does not go on with what was followed; None where it may."""
    if authority.is_autonomous and authority.state not in ("TRACK", "COAST"):
        return None if authority.kept is not None else NOTHING_HELD
    if authority.state == "MANUAL":
        # Else a move by hand would be a way round the checklist.
        taken = "it was not armed before you took the mount: arm it"
        return None if authority.is_resumable else taken
    if authority.kept is None or authority.is_autonomous:
        return NOTHING_HELD
    return None if authority.is_resumable else "arm it first: then what was followed can be resumed"


@_step.register
def _(trigger: Sought, authority: Authority) -> Step:
    if not authority.is_autonomous:
        return Step(
            authority=authority, refusal="autonomy does not have the mount: arm or resume first"
        )
    if authority.state == "SEARCH":
        return Step(authority=authority)
    after = replace(
        authority, following=authority.following.without_track("SEARCH"), kept=authority.tracked
    )
    return Step(authority=after, reason=Cause(kind="looked for again", by=trigger.by))


@_step.register
def _(trigger: Followed, authority: Authority) -> Step:
    if not authority.is_autonomous:
        # The mount changed hands while the frame was being reduced.
        return Step(authority=authority)
    kept = None if trigger.after.state in ("TRACK", "COAST") else authority.kept
    return Step(authority=replace(authority, following=trigger.after, kept=kept, failures=0))


@_step.register
def _(trigger: Marked, authority: Authority) -> Step:
    if authority.is_autonomous:
        return Step(authority=authority)  # the mount changed hands meanwhile
    kept, following = trigger.kept, authority.following
    if kept is not None:
        # Numbers are given once.
        last_track_id = max(kept.last_track_id, following.last_track_id)
        following = replace(following, last_track_id=last_track_id)
    return Step(authority=replace(authority, kept=kept, following=following))


@_step.register
def _(trigger: Failed, authority: Authority) -> Step:
    failures = authority.failures + 1
    if authority.state == "FAULT":
        return Step(authority=authority)
    if trigger.is_final or failures >= FAILURES_IN_A_ROW:
        fault = Cause(kind="instrument", detail=trigger.words)
        return _keeping(_fault(authority, fault, "abort"), authority.tracked)
    return Step(authority=replace(authority, failures=failures))


@_step.register
def _(trigger: LimitMet, authority: Authority) -> Step:
    if not authority.is_autonomous:
        return Step(authority=authority)
    failures = authority.failures + 1
    if failures >= FAILURES_IN_A_ROW:
        return _fault(authority, Cause(kind="too many limits", detail=trigger.words))
    # What was followed has set, or stands behind the wall: the search goes on where it began.
    # A hold stays a hold: what the operator has stopped does not go on by itself.
    after = replace(
        authority,
        following=authority.following.without_track("SEARCH"),
        kept=None,
        failures=failures,
    )
    actions: tuple[Action, ...] = ("search home", "forget plate")
    return Step(
        authority=after, actions=actions, reason=Cause(kind="limit met", detail=trigger.words)
    )


@_step.register
def _(trigger: ClockSet, authority: Authority) -> Step:
    # A track lives by its times, and those before this are wrong; what was seen is still near.
    if not authority.is_autonomous:
        return Step(authority=without_kept(authority))
    nothing = replace(authority.following.without_track("SEARCH"), dropped=())
    after = replace(authority, following=nothing, kept=None)
    actions: tuple[Action, ...] = ("start search", "forget plate")
    return Step(
        authority=after, actions=actions, reason=Cause(kind="clock set", step_s=trigger.step_s)
    )


@_step.register
def _(trigger: NightEnded, authority: Authority) -> Step:
    if not authority.is_responsible:
        return Step(authority=authority)
    actions: tuple[Action, ...] = ("abort", "park") if trigger.parks else ("abort",)
    return _enter(authority, "IDLE", Cause(kind="night ended", detail=trigger.words), *actions)


@_step.register
def _(trigger: NotPointing, authority: Authority) -> Step:
    if not authority.is_autonomous:
        return Step(authority=authority)
    reason = Cause(kind="not pointing", detail=trigger.words)
    return _keeping(_enter(authority, "IDLE", reason), authority.tracked)


def without_kept(authority: Authority) -> Authority:
    """Return the state without its kept track, once that is too old to be followed again."""
    is_resumable = authority.is_resumable and authority.state == "MANUAL"
    return replace(authority, kept=None, is_resumable=is_resumable)


def _keeping(entered: Step, kept: Following | None, *, is_resumable: bool = False) -> Step:
    after = replace(entered.authority, kept=kept, is_resumable=is_resumable and kept is not None)
    return replace(entered, authority=after)


def _fault(authority: Authority, reason: Cause, *actions: Action) -> Step:
    """A FAULT: whose affair the mount was, it remains."""
    entered = _enter(authority, "FAULT", reason, *actions)
    after = replace(entered.authority, was_autonomous=authority.is_autonomous)
    return replace(entered, authority=after)


def _enter(authority: Authority, state: LoopState, reason: Cause, *actions: Action) -> Step:
    after = Authority(following=authority.following.without_track(state))
    return Step(authority=after, actions=actions, reason=reason)
