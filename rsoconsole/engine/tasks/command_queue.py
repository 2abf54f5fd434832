"""Queue of commands from the wire's threads to the loop, with the alarms that interrupt it."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rsoconsole.control import IN_ENGINE, Request
from rsoconsole.engine.aim.states import LimitMet, NightEnded, Stopped, Trigger
from rsoconsole.instruments import StopResult
from rsoconsole.records import CommandResult, OperatorAction
from rsoconsole.words import stop_order_text, text

OVERTAKEN = CommandResult(kind="dropped", dropped_by="STOP")


class OvertakenError(ValueError):
    """A refusal of a command, because STOP was given before it could be queued."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """An event that interrupts the loop: a STOP, a limit, or the end of the night."""

    trigger: Trigger
    result: StopResult | None = None
    """Mount's answer, if its motion was ended before the loop took notice; None: not, or failed."""
    dropped: tuple[Request, ...] = ()
    """Commands that were waiting when the alarm came, and that it cancels."""


class CommandQueue:
    """Queue of commands for the loop, and flags that interrupt the loop.

    Some flags are plain attributes, because a signal handler may set them at any instant.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: deque[Request] = deque()
        self._alarms: deque[Alarm] = deque()
        self._stops_under_way = 0
        self.stops = 0
        """Number of STOPs so far; limits and the end of the night do not count."""
        self._are_under_way = False
        self._is_executing = False
        self._cut_by: Trigger | None = None
        self._is_shutdown = False

    def put(self, request: Request, on_taken: Callable[[], None] = lambda: None) -> None:
        """Queue a command for the loop; may be called from any thread.

        ``on_taken`` is called before the loop can see the command. Raises OvertakenError where a
        STOP was given after the command was read.
        """
        with self._lock:
            is_late = request.stamp is not None and request.stamp < self.stops
            if is_late and not request.command.survives_stop:
                raise OvertakenError(text(OVERTAKEN))
            on_taken()
            self._waiting.append(request)

    def take_all(self) -> tuple[Request, ...]:
        """Return all waiting requests in order, and empty the queue.

        They count as under way until ``mark_finished`` or ``put_back`` is called.
        """
        with self._lock:
            requests = tuple(self._waiting)
            self._waiting.clear()
            self._are_under_way = bool(requests)
        return requests

    def mark_finished(self) -> None:
        """Note that all requests from the last ``take_all`` have their results."""
        self._are_under_way = False

    @property
    def is_settled(self) -> bool:
        """True while no command waits or is under way, and no alarm waits or is being raised."""
        with self._lock:
            return not (self._waiting or self._are_under_way or self.is_stopping)

    def stop(self, trigger: Trigger, abort: Callable[[], StopResult]) -> StopResult:
        """Raise an alarm, stop the mount by ``abort``, and keep its result for the record.

        From the first instant on the loop gives no order to the mount any more. Commands that the
        alarm cancels are taken from the queue.
        """
        with self._lock:
            self._stops_under_way += 1
            self.stops += isinstance(trigger, Stopped)
            self._cut_by = trigger
            dropped = self._undo_waiting(trigger)
        # Their records come with the alarm; who waits for them hears it now.
        for request in dropped:
            request.course.settle(cancelled_result(trigger))
        result: StopResult | None = None
        try:
            result = abort()
        finally:
            # Also where the abort broke: the loop must hear what happened.
            with self._lock:
                self._alarms.append(Alarm(trigger=trigger, result=result, dropped=dropped))
                self._stops_under_way -= 1
        return result

    def interrupt(self, trigger: Trigger) -> None:
        """Raise an alarm for the loop without stopping the mount; from any thread."""
        with self._lock:
            self._cut_by = trigger
            # What came of a STOP undoes nothing that was given after it.
            dropped = () if isinstance(trigger, Stopped) else self._undo_waiting(trigger)
            self._alarms.append(Alarm(trigger=trigger, dropped=dropped))
        for request in dropped:
            request.course.settle(cancelled_result(trigger))

    def _undo_waiting(self, trigger: Trigger) -> tuple[Request, ...]:
        """Remove and return the waiting requests that a trigger cancels; call it under the lock."""
        undone = tuple(r for r in self._waiting if is_cancelled_by(r, trigger))
        self._waiting = deque(r for r in self._waiting if r not in undone)
        return undone

    def put_back(self, requests: tuple[Request, ...]) -> tuple[tuple[Request, ...], CommandResult]:
        """Put requests that were not executed back at the head of the queue.

        Returns those that an alarm cancels instead, and the result that they get.
        """
        with self._lock:
            cut_by = self._cut_by if self.is_stopping else None
            dropped = tuple(
                r for r in requests if cut_by is not None and is_cancelled_by(r, cut_by)
            )
            again = [r for r in requests if r not in dropped]
            for request in again:
                request.course.is_begun = False
            self._waiting.extendleft(reversed(again))
            self._are_under_way = False
        return dropped, OVERTAKEN if cut_by is None else cancelled_result(cut_by)

    @contextlib.contextmanager
    def while_executing(self) -> Iterator[None]:
        """Keep urgent commands from interrupting the loop while entered; STOP and alarms still
        do.
        """
        self._is_executing = True
        try:
            yield
        finally:
            self._is_executing = False

    def take_alarms(self) -> tuple[Alarm, ...]:
        """Return the alarms since the last call, in order, and remove them."""
        with self._lock:
            alarms = tuple(self._alarms)
            self._alarms.clear()
        return alarms

    @property
    def is_stopping(self) -> bool:
        """True while the mount is being stopped, or an alarm waits for the loop."""
        return self._stops_under_way > 0 or bool(self._alarms)

    def request_shutdown(self) -> None:
        """Ask the engine to end, after a safe stop."""
        self._is_shutdown = True

    @property
    def is_shutdown(self) -> bool:
        """True once the engine has been asked to end."""
        return self._is_shutdown

    @property
    def is_interrupt_wanted(self) -> bool:
        """True where the loop is to interrupt its work and look at the queue."""
        if self._is_shutdown or self.is_stopping:
            return True
        if self._is_executing:
            return False
        with self._lock:
            return any(request.command.is_urgent for request in self._waiting)


def action_record(request: Request, outcome: CommandResult) -> OperatorAction:
    """Return the record of a command and its result."""
    command = request.command
    return OperatorAction(
        verb=command.verb, arguments=command.arguments(), outcome=outcome, by=request.by
    )


def is_cancelled_by(request: Request, trigger: Trigger) -> bool:
    """Return True where an alarm with this trigger cancels a waiting command."""
    if isinstance(trigger, Stopped):
        return not request.command.survives_stop
    return request.command.moves_mount


def cancelled_result(trigger: Trigger) -> CommandResult:
    """Return the result of a waiting command that an alarm with this trigger has cancelled."""
    if isinstance(trigger, Stopped):
        return OVERTAKEN
    is_limit = isinstance(trigger, LimitMet)
    return CommandResult(kind="dropped", dropped_by="limit met" if is_limit else "night ended")


def alarm_words(alarm: Alarm, is_answered_again: bool) -> str:
    """Return an alarm in words for the operator.

    ``is_answered_again``: True where the mount answered the ABORT that the loop itself sends after
    every alarm.
    """
    trigger = alarm.trigger
    if isinstance(trigger, LimitMet):
        return f"limit: {trigger.words}"
    if isinstance(trigger, NightEnded):
        return f"the night ends: {trigger.words}; armed again only when asked"
    result = alarm.result
    times = stop_order_text(None if result is None else result.ordered_ms, ", {}")
    if isinstance(trigger, Stopped) and not trigger.is_obeyed:
        return f"STOP: {trigger.words}"
    if not (is_answered_again or (result is not None and result.is_answered)):
        return f"STOP was not answered by the mount's driver{times}: cut its power if it moves"
    if result is not None and result.is_answered:
        times += f", answered in {result.ms:.0f} ms"
        times += "" if result.ordered_ms is None else f" ({IN_ENGINE})"
    return f"STOP: ABORT sent{times}; disarmed, how the mount moves is being measured"
