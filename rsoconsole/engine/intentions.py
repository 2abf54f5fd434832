"""What the operator wants, on its way from the socket's threads to the loop."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from pydantic import ValidationError

from rsoconsole.config import Config
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
    "filter.r_multiplier",
    "filter.gate_nis",
    "filter.max_coast_s",
    "search.follow",
    "search.recentre",
    "exposure.exposure_s",
    "exposure.cadence_s",
}
"""What may change while the loop runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """One intention, already known to be possible."""

    verb: str
    name: str = ""
    value: float | str = ""
    by: str = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopOrder:
    """A STOP that was given, and what the mount answered."""

    by: str
    result: StopResult
    dropped: tuple[Wish, ...]
    """Wishes that waited when it came: STOP undoes them."""


class Intentions:
    """A queue of wishes, and the two flags that cut everything short.

    The flags are plain attributes: a signal handler may set one at any instant.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wishes: deque[Wish] = deque()
        self._stops: deque[StopOrder] = deque()
        self._stops_under_way = 0
        self._is_shutdown = False

    def put(self, wish: Wish) -> None:
        """Queue a wish for the next cycle (any thread)."""
        with self._lock:
            self._wishes.append(wish)

    def take_all(self) -> tuple[Wish, ...]:
        """All waiting wishes, in order."""
        with self._lock:
            wishes = tuple(self._wishes)
            self._wishes.clear()
        return wishes

    def stop(self, by: str, abort: Callable[[], StopResult]) -> StopResult:
        """Raise the flag, then stop the mount, then keep what came of it for the record.

        From the first instant on the loop gives no order to the mount any more.
        """
        with self._lock:
            self._stops_under_way += 1
            dropped = tuple(self._wishes)
            self._wishes.clear()
        try:
            result = abort()
            with self._lock:
                self._stops.append(StopOrder(by=by, result=result, dropped=dropped))
        finally:
            with self._lock:
                self._stops_under_way -= 1
        return result

    def take_stops(self) -> tuple[StopOrder, ...]:
        """STOPs that were given since last asked."""
        with self._lock:
            stops = tuple(self._stops)
            self._stops.clear()
        return stops

    @property
    def is_stopping(self) -> bool:
        """Whether a STOP is under way or has not been taken notice of."""
        return self._stops_under_way > 0 or bool(self._stops)

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
        return self._is_shutdown or self.is_stopping


def changed(config: Config, name: str, value: float | str) -> Config:
    """The configuration with one tunable set. Raises ValueError naming what is allowed."""
    if name not in TUNABLE:
        raise ValueError(f"{name} cannot be tuned; tunable are {', '.join(sorted(TUNABLE))}")
    table = config.model_dump()
    section, _, key = name.partition(".")
    table[section][key] = value
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        raise ValueError(f"{name} = {value}: {error.errors()[0]['msg']}") from error


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
    arguments = {"name": wish.name, "value": wish.value} if wish.name else {}
    return OperatorAction(verb=wish.verb, arguments=arguments, outcome=outcome, by=wish.by)
