"""Executes the commands and alarms that came in since the last frame.

An alarm interrupts the loop: STOP, a limit, or the end of the night.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.base import InstrumentError
from rsoconsole.control import Request
from rsoconsole.engine.aim.instrument_controller import (
    InstrumentController,
    Interrupted,
    StoppedElsewhere,
)
from rsoconsole.engine.aim.states import LimitMet, Stopped
from rsoconsole.engine.operator.handlers import Handlers, LoopControl
from rsoconsole.engine.tasks.command_queue import (
    Alarm,
    CommandQueue,
    action_record,
    alarm_words,
    cancelled_result,
)
from rsoconsole.engine.tasks.faults import Faults
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.records import DONE, CommandResult, Topic

log = logging.getLogger(__name__)

STOP_POLL_S = 0.02


class CommandTurn:
    """Executes alarms, then commands in their order, and records each command's outcome."""

    def __init__(
        self,
        control: LoopControl,
        instrument_controller: InstrumentController,
        queue: CommandQueue,
        session_log: SessionLog,
        faults: Faults,
        *,
        handlers: Handlers,
        on_executed: Callable[[], None],
    ) -> None:
        """``on_executed``: called after commands that may have changed the next aim."""
        self._control = control
        self._instrument_controller = instrument_controller
        self._queue = queue
        self._session_log, self._faults = session_log, faults
        self._handlers, self._on_executed = handlers, on_executed

    def execute_waiting(self) -> None:
        """Execute the waiting commands in their order, and record each one's result."""
        requests = self._queue.take_all()
        for number, request in enumerate(requests):
            outcome = DONE
            request.course.is_begun = True
            try:
                with self._queue.while_executing():
                    handler = self._handlers[type(request.command)]
                    outcome = handler.execute(request.command, request.by)
            except (ValueError, InstrumentError, StoppedElsewhere) as error:
                outcome = CommandResult.refused(error)
                log.warning("%s refused: %s", request.command.verb, error)
            except Interrupted:
                self._put_back(requests[number:])
                raise
            except Exception as error:  # a fault of ours: it goes up, and no command with it
                failed = CommandResult(kind="failed", detail=f"{type(error).__name__}: {error}")
                self._settle(request, failed)
                self._put_back(requests[number + 1 :])
                raise
            self._settle(request, outcome)
        self._queue.mark_finished()
        if requests:
            self._on_executed()

    def _put_back(self, requests: tuple[Request, ...]) -> None:
        """Put requests back into the queue; those undone meanwhile are settled as undone."""
        undone, result = self._queue.put_back(requests)
        for each in undone:
            self._settle(each, result)

    def _settle(self, request: Request, result: CommandResult) -> None:
        """Record a command's result, and pass it to the thread that waits for it."""
        self._session_log.append(action_record(request, result))
        request.course.settle(result)

    def heed_alarms(self) -> None:
        """Act on the alarms that came in: log each, then pass its trigger to the state machine.

        Raises Interrupted while a STOP is still talking to the mount on its own thread: nothing may
        be executed until that is over.
        """
        if not self._queue.is_stopping:
            return
        alarms = self._queue.take_alarms()
        if not alarms:
            time.sleep(STOP_POLL_S)
            raise Interrupted
        # An order may have been on its way when the flag went up: stop the mount once more.
        again = self._instrument_controller.instruments.mount.abort()
        for alarm in alarms:
            for request in alarm.dropped:
                self._session_log.append(action_record(request, cancelled_result(alarm.trigger)))
            self._heed(alarm, again.is_answered)

    def _heed(self, alarm: Alarm, is_stopped_again: bool) -> None:
        # The words first: what has to be done may fail.
        topic: Topic = "limit" if isinstance(alarm.trigger, LimitMet) else ""
        words = alarm_words(alarm, is_stopped_again)
        self._session_log.say("alarm", words, topic)
        trigger = alarm.trigger
        if not isinstance(trigger, Stopped):
            self._control.handle(trigger)
            return
        is_answered = is_stopped_again or (alarm.result is not None and alarm.result.is_answered)
        stopped = replace(trigger, is_obeyed=trigger.is_obeyed and is_answered)
        self._control.handle(stopped)
        if not stopped.is_obeyed:
            self._faults.add_disobeyed_stop(
                stopped, words, self._instrument_controller.now_utc_ns()
            )
