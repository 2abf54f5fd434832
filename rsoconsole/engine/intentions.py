"""What the operator wants, on its way from the socket's threads to the loop."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rsoconsole.config import Config, with_setting
from rsoconsole.engine.states import Happening, LimitMet, NightEnded, Stopped
from rsoconsole.errors import ConfigError
from rsoconsole.instruments.ports import StopResult
from rsoconsole.records import OperatorAction, ParameterChange

TUNABLE = {
    "detector.tau",
    "detector.centroid",
    "detector.map_mode",
    "filter.preset",
    "filter.sigma_arcsec",
    "filter.q_arcsec2_s3",
    "filter.q_multiplier",
    "filter.q_ra_multiplier",
    "filter.q_ra_rate_multiplier",
    "filter.q_dec_multiplier",
    "filter.q_dec_rate_multiplier",
    "filter.r_multiplier",
    "filter.r_ra_multiplier",
    "filter.r_dec_multiplier",
    "filter.max_3sigma_arcmin",
    "filter.gate_nis",
    "filter.max_coast_s",
    "search.follow",
    "search.recentre",
    "search.pattern",
    "orbit.guide",
    "orbit.prior",
    "orbit.wait_min",
    "mount.meridian",
    "mount.after_stop",
    "aim.lead_s",
    "aim.along_arcmin",
    "aim.across_arcmin",
    "exposure.exposure_s",
    "exposure.cadence_s",
}
"""What may change while the loop runs."""


URGENT = frozenset(("abort", "track", "disarm", "goto", "nudge", "park", "unpark", "hold"))
"""Wishes that do not wait for the end of an exposure."""


OUTLIVES_STOP = frozenset(("disarm", "shutdown"))
"""Wishes that STOP does not undo: they move nothing."""
MOVING = frozenset(("goto", "nudge", "arm", "resume", "seek"))
"""Wishes that a limit and the end of the night undo: they may move the mount."""
OVERTAKEN = "dropped by STOP"


class OvertakenError(ValueError):
    """STOP came between a wish and its being heard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """One intention, already known to be possible."""

    verb: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    by: str = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """Something that cut the loop short: an operator's STOP, a limit, the end of the night."""

    happening: Happening
    result: StopResult | None = None
    """What the mount answered, where its motion was ended before the loop was told; None where
    it was not, or where that broke."""
    dropped: tuple[Wish, ...] = ()
    """Wishes that waited when it came: STOP undoes them."""


class Intentions:
    """A queue of wishes, and the flags that cut everything short.

    The flags are plain attributes: a signal handler may set one at any instant.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wishes: deque[Wish] = deque()
        self._alarms: deque[Alarm] = deque()
        self._stops_under_way = 0
        self._stops = 0
        self._is_granting = False
        self._cut_by: Happening | None = None
        """What cut the loop short last."""
        self._is_shutdown = False

    def put(self, wish: Wish, stamp: int | None = None) -> None:
        """Queue a wish for the loop (any thread).

        Raises OvertakenError where STOP has come since it was given: with ``stamp`` before it.
        """
        with self._lock:
            if stamp is not None and stamp < self._stops and wish.verb not in OUTLIVES_STOP:
                raise OvertakenError(OVERTAKEN)
            self._wishes.append(wish)

    @property
    def stops(self) -> int:
        """How many STOPs there have been; limits and the end of the night do not count."""
        return self._stops

    def take_all(self) -> tuple[Wish, ...]:
        """All waiting wishes, in order."""
        with self._lock:
            wishes = tuple(self._wishes)
            self._wishes.clear()
        return wishes

    def stop(self, happening: Happening, abort: Callable[[], StopResult]) -> StopResult:
        """Raise the flag, then stop the mount, then keep what came of it for the record.

        From the first instant on the loop gives no order to the mount any more.
        """
        with self._lock:
            self._stops_under_way += 1
            self._stops += isinstance(happening, Stopped)
            self._cut_by = happening
            dropped = tuple(wish for wish in self._wishes if is_undone(wish, happening))
            self._wishes = deque(wish for wish in self._wishes if wish not in dropped)
        result: StopResult | None = None
        try:
            result = abort()
        finally:
            # Also where the abort broke: the loop must hear what happened.
            with self._lock:
                self._alarms.append(Alarm(happening=happening, result=result, dropped=dropped))
                self._stops_under_way -= 1
        return result

    def interrupt(self, happening: Happening) -> None:
        """Cut the loop short for something that it must act on itself (any thread)."""
        with self._lock:
            self._cut_by = happening
            self._alarms.append(Alarm(happening=happening))

    def put_back(self, wishes: tuple[Wish, ...]) -> tuple[tuple[Wish, ...], str]:
        """These were taken and not granted: they wait again, before all others.

        Gives those that do not, since what cut in undoes them, and why in words.
        """
        with self._lock:
            cut_by = self._cut_by if self.is_stopping else None
            dropped = tuple(w for w in wishes if cut_by is not None and is_undone(w, cut_by))
            self._wishes.extendleft(wish for wish in reversed(wishes) if wish not in dropped)
        return dropped, "" if cut_by is None else dropped_words(cut_by)

    @contextlib.contextmanager
    def granting(self) -> Iterator[None]:
        """While a wish is granted no other one cuts it short; STOP and alarms do."""
        self._is_granting = True
        try:
            yield
        finally:
            self._is_granting = False

    def take_alarms(self) -> tuple[Alarm, ...]:
        """What has cut the loop short since last asked, in order."""
        with self._lock:
            alarms = tuple(self._alarms)
            self._alarms.clear()
        return alarms

    @property
    def is_stopping(self) -> bool:
        """Whether a stop is under way, or an alarm has not been taken notice of."""
        return self._stops_under_way > 0 or bool(self._alarms)

    def request_shutdown(self) -> None:
        """The engine is to end after a safe stop."""
        self._is_shutdown = True

    @property
    def is_shutdown(self) -> bool:
        """Whether the engine is to end."""
        return self._is_shutdown

    @property
    def is_wanted(self) -> bool:
        """Whether the loop is to drop what it does and look here."""
        if self._is_shutdown or self.is_stopping:
            return True
        if self._is_granting:
            return False
        with self._lock:
            return any(wish.verb in URGENT for wish in self._wishes)


def changed(config: Config, name: str, value: float | str) -> Config:
    """The configuration with one tunable set. Raises ValueError naming what is allowed."""
    if name not in TUNABLE:
        raise ValueError(f"{name} cannot be tuned; tunable are {', '.join(sorted(TUNABLE))}")
    try:
        return with_setting(config, name, value)
    except ConfigError as error:
        raise ValueError(str(error)) from error


def change_record(before: Config, after: Config, name: str, by: str) -> ParameterChange:
    """The change for the record."""
    section, _, key = name.partition(".")
    return ParameterChange(
        name=name,
        before=getattr(getattr(before, section), key),
        after=getattr(getattr(after, section), key),
        by=by,
    )


def action_record(wish: Wish, outcome: str) -> OperatorAction:
    """The intention and its outcome for the record."""
    return OperatorAction(
        verb=wish.verb, arguments=dict(wish.arguments), outcome=outcome, by=wish.by
    )


def is_undone(wish: Wish, happening: Happening) -> bool:
    """Whether what cuts the loop short undoes a wish that has not been granted."""
    if isinstance(happening, Stopped):
        return wish.verb not in OUTLIVES_STOP
    return wish.verb in MOVING


def dropped_words(happening: Happening) -> str:
    """Why a wish that waited was not granted."""
    if isinstance(happening, Stopped):
        return OVERTAKEN
    return (
        "dropped: a limit was met" if isinstance(happening, LimitMet) else "dropped: the night ends"
    )


def alarm_words(alarm: Alarm, is_stopped_again: bool, config: Config) -> str:
    """What cut the loop short, in the operator's words.

    ``is_stopped_again``: the loop's own stop, which follows every alarm, was confirmed.
    """
    happening = alarm.happening
    if isinstance(happening, LimitMet):
        return f"limit: {happening.words}; motion and tracking ended"
    if isinstance(happening, NightEnded):
        return f"the night ends: {happening.words}; armed again only when asked"
    if not (is_stopped_again or (alarm.result is not None and alarm.result.stopped)):
        return "STOP was not confirmed by the mount: cut its power"
    after = {"track": "the mount tracks on", "stand still": "the mount stands still"}
    return f"STOP: motion ended, disarmed; {after[config.mount.after_stop]}"
