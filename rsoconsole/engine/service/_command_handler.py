"""Answers the operator's wire: STOP and status at once, the rest through the loop."""

import dataclasses
import itertools
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import RsoconsoleError
from rsoconsole.control import (
    ON_RECORD,
    AnswerControlRequest,
    Arm,
    AskStatus,
    BeginMark,
    Command,
    LastStop,
    Note,
    Outcome,
    PendingOutcome,
    Preview,
    Request,
    RequestControl,
    Sender,
    Shutdown,
    Status,
    Stop,
    status_json,
    to_json_types,
    to_printable,
)
from rsoconsole.engine.aim.states import Stopped
from rsoconsole.engine.doctor.mount_lacks import MissingAbility, missing_abilities
from rsoconsole.engine.loop.loop import Engine
from rsoconsole.engine.operator.arming import (
    arming_checks,
    gather_facts,
    refusal_text,
    unknown_words,
)
from rsoconsole.engine.operator.handlers import SOON, Accepted, Handler, RefusedError
from rsoconsole.engine.service.machine_watch import HealthMeter, MachineState
from rsoconsole.engine.service.stop_now import REMEDY, stop_now, stop_outcome, stop_status
from rsoconsole.engine.tasks.command_queue import (
    OVERTAKEN,
    CommandQueue,
    OvertakenError,
    action_record,
)
from rsoconsole.engine.tasks.seats import ConsoleControl, seat_name
from rsoconsole.instruments import StopResult
from rsoconsole.pipeline import HELD
from rsoconsole.records import ACCEPTED, DONE, CommandResult, OperatorAction, done_result
from rsoconsole.sky import icrs_to_altaz
from rsoconsole.words import ENGINE_ENDS, text

log = logging.getLogger(__name__)

LONGEST_NOTE = 2000
FLUSH_S = 3.0
"""How long an answer waits for the disk at most, s; usually some milliseconds."""
MOUNT_WORD_S = 2.0
"""How long an answer waits for the mount at most, from the command's arrival, s."""
SENT = "sent; the mount has not answered"
WAITS = "accepted; it is sent as soon as the loop is free"


class CommandHandler:
    """Answers requests on the wire's threads, without waiting for the loop's cycle to end."""

    def __init__(
        self,
        engine: Engine,
        queue: CommandQueue,
        session: Path,
        record_faults: Callable[[], tuple[str, ...]] = tuple,
        flush: Callable[[float], bool] = lambda _timeout_s: True,
        *,
        machine: Callable[[], MachineState | None] = lambda: None,
        lacks: tuple[MissingAbility, ...] = (),
        mount_word_s: float = MOUNT_WORD_S,
    ) -> None:
        """``flush``: waits until the record is on the disk, that many seconds at most.

        ``machine``: returns the last reading of the machine itself; ``lacks``: what the mount's
        driver did not offer when it was connected; ``mount_word_s``: greatest wait of an answer for
        the mount, s.
        """
        self._engine = engine
        self._instruments = engine.instrument_controller.instruments
        self._queue = queue
        self._session = session
        self._record_faults = record_faults
        self._flush = flush
        self._seats = ConsoleControl()
        self._machine = machine
        self._lacks = lacks
        self._mount_word_s = mount_word_s
        self._last_stop: LastStop | None = None
        self._stop_numbers = itertools.count(1)
        self._health = HealthMeter(lambda: engine.config, self._instruments.clock, session, machine)
        self._answers: Mapping[type[Command], Callable[[Any, Sender], Outcome]] = {
            Stop: self._stop,
            AskStatus: self._status,
            Preview: self._preview,
            Note: self._note,
            BeginMark: self._begin_mark,
            RequestControl: self._ask_seat,
            AnswerControlRequest: self._answer_seat,
        }
        """Commands answered on the socket's thread."""
        self._handlers: Mapping[type[Command], Handler] = {
            **engine.handlers,
            # The checklist looks at the session's disk, too.
            Arm: dataclasses.replace(engine.handlers[Arm], check=self._check_arming),
            Shutdown: dataclasses.replace(engine.handlers[Shutdown], check=self._check_shutdown),
        }

    def handle(self, request: Request) -> Outcome:
        """Answer a request once its outcome is complete; a refusal gives the reason."""
        begun = self.begin(request)
        return begun.outcome() if isinstance(begun, PendingOutcome) else begun

    def begin(self, request: Request) -> Outcome | PendingOutcome:
        """Answer a request at once; a ``PendingOutcome`` where the answer needs the mount."""
        command = request.command
        refused = self._seats.refusal(request.sender, needs_control=command.needs_control)
        if refused is not None:
            holder = seat_name(self._seats.view().holder)
            return Outcome(ok=False, message=refused, data={"seat": holder})
        try:
            answer = self._answers.get(type(command))
            return self._accept(request) if answer is None else answer(command, request.sender)
        except RefusedError as error:
            return Outcome(ok=False, message=str(error), data=error.data)
        except (ValueError, RsoconsoleError) as error:
            return Outcome(ok=False, message=str(error))

    # -- through the loop -----------------------------------------------------------------------

    def _accept(self, request: Request) -> Outcome | PendingOutcome:
        """Check a request and queue it for the loop; what is known at once is answered at once."""
        command, by = request.command, request.by
        handler = self._handlers.get(type(command))
        if handler is None:
            raise ValueError(f"this engine has no handler of '{command.verb}'")
        try:
            if self._queue.is_settled:
                handler.expect(command, by)
            accepted = handler.check(command, by)
        except (ValueError, RsoconsoleError) as error:
            self._engine.session_log.append(action_record(request, CommandResult.refused(error)))
            data = error.data if isinstance(error, RefusedError) else {}
            raise RefusedError(str(error), {**data, ON_RECORD: True}) from error
        request = dataclasses.replace(request, command=accepted.command or command)
        append = self._engine.session_log.append
        try:
            # On record before the loop may put down what came of it.
            self._queue.put(request, lambda: append(action_record(request, ACCEPTED)))
        except OvertakenError:
            append(action_record(request, OVERTAKEN))
            raise
        # The loop has it already: nothing waits for a disk that fails.
        if command.wakes_loop:
            self._engine.wake()
        is_kept = self._flush(FLUSH_S)
        if isinstance(command, Shutdown):
            self._queue.request_shutdown()
        if not is_kept:
            return self._not_on_record("it is carried out", dict(accepted.data))
        if command.awaits_mount:
            return PendingOutcome(
                until_s=request.came_s + self._mount_word_s,
                wait=lambda wait_s: _first_word(request, accepted, wait_s),
            )
        return Outcome(ok=True, message=accepted.message, data=dict(accepted.data))

    def _not_on_record(self, what: str, data: Mapping[str, Any] | None = None) -> Outcome:
        """Return the answer for a command that no disk has recorded: it is no acknowledgement."""
        why = "; ".join(self._record_faults()) or "the disk has not taken it"
        return Outcome(ok=False, message=f"{what}, but not on record: {why}", data=data or {})

    def _check_arming(self, command: Arm, _by: str) -> Accepted:
        """Go through the checklist at once, so that the answer says what is missing."""
        names = frozenset(command.override)
        config = self._engine.config
        facts = gather_facts(self._instruments, config, self._session)
        if facts.abilities is not None:
            self._lacks = missing_abilities(facts.abilities, config.mount)
        checks = arming_checks(facts, config)
        if unknown := unknown_words(names):
            raise ValueError(unknown)
        data = {"checks": [dataclasses.asdict(check) for check in checks]}
        refused = refusal_text(checks, names)
        if refused is not None:
            raise RefusedError(refused, data)
        return Accepted(message="armed from the next cycle", data=data)

    def _check_shutdown(self, _command: Shutdown, _by: str) -> Accepted:
        return Accepted(message=ENGINE_ENDS)

    # -- past the loop --------------------------------------------------------------------------

    def _stop(self, command: Stop, sender: Sender) -> Outcome:
        # The flag and the mount first; whatever else STOP means comes after them.
        number = next(self._stop_numbers)
        self._engine.watch.abort_ordered()
        given = LastStop(
            number=number, by=sender.words, t_utc_ns=self._engine.session_log.last_utc_ns()
        )

        def put_down(result: StopResult) -> None:
            if self._last_stop is None or self._last_stop.number <= number:
                self._last_stop = stop_status(given, result)

        def known(result: StopResult) -> None:
            put_down(result)
            self._engine.wake()
            action = OperatorAction(
                verb=command.verb,
                arguments=command.arguments(),
                outcome=stop_outcome(result),
                by=sender.words,
            )
            self._engine.session_log.append(action)

        def late(result: StopResult) -> None:
            put_down(result)
            self._engine.session_log.say("alarm", f"STOP {result.detail}: {REMEDY}")

        def measured(result: StopResult) -> None:
            known(result)
            log.info("STOP: %s", text(stop_outcome(result)))
            if not (result.is_at_rest or result.is_superseded):
                words = text(stop_outcome(result))
                self._queue.interrupt(Stopped(by=sender.words, is_obeyed=False, words=words))

        result = stop_now(
            self._queue,
            self._instruments.mount,
            sender.words,
            on_known=known,
            on_late=late,
            on_measured=measured,
        )
        data: dict[str, Any] = {
            **dataclasses.asdict(stop_status(given, result)),
            "is_answered": result.is_answered,
            "ms": result.ms,
        }
        message = result.detail or "ABORT is answered: measuring"
        return Outcome(ok=result.is_answered, message=message, data=data)

    def _status(self, _command: AskStatus, _sender: Sender) -> Outcome:
        return Outcome(ok=True, data=status_json(self.status()))

    def status(self) -> Status:
        """Return the loop's status, with health, control of consoles and last STOP added."""
        status = self._engine.status()
        report = self._engine.watch.last_report
        health = self._health.read(report, self._engine.interruptions.trouble, self._lacks)
        machine, seat = self._machine(), self._seats.view()
        alt_deg, az_deg = self._horizontal(status.ra_icrs_deg, status.dec_icrs_deg, status.t_utc_ns)
        mount_alt_deg, mount_az_deg = self._horizontal(
            status.mount_ra_icrs_deg, status.mount_dec_icrs_deg, status.mount_t_utc_ns
        )
        return dataclasses.replace(
            status,
            alt_deg=alt_deg,
            az_deg=az_deg,
            mount_alt_deg=mount_alt_deg,
            mount_az_deg=mount_az_deg,
            faults=(*status.faults, *self._record_faults()),
            health=tuple(health),
            mount_lacks=tuple(lack.text for lack in self._lacks),
            machine=None if machine is None else machine.as_status(),
            seat=None if seat.holder is None else seat_name(seat.holder),
            seat_asked_by=None if seat.asked_by is None else seat_name(seat.asked_by),
            last_stop=self._stop_now_known(),
            temporary=self._engine.frames.temporary.frames_left(),
            session=self._session.absolute(),
            pid=os.getpid(),
        )

    def _stop_now_known(self) -> LastStop | None:
        last = self._last_stop
        if last is None or last.is_at_rest:
            return last
        if last.is_over or last.motion is None:
            return last
        is_open = self._engine.authority.is_stopped or self._queue.is_stopping
        return dataclasses.replace(last, is_over=not is_open)

    def _horizontal(
        self, ra_deg: float | None, dec_deg: float | None, t_utc_ns: int | None
    ) -> tuple[float | None, float | None]:
        """Return altitude and azimuth from the site, deg; None where the direction is not known."""
        if ra_deg is None or dec_deg is None or t_utc_ns is None:
            return None, None
        return icrs_to_altaz(self._engine.config.site.to_site(), ra_deg, dec_deg, t_utc_ns)

    def _preview(self, command: Preview, _sender: Sender) -> Outcome:
        """Return the target of a move by hand, its duration and the limits against it."""
        return Outcome(ok=True, data=to_json_types(self._engine.by_hand.preview(command)))

    def _ask_seat(self, _command: RequestControl, sender: Sender) -> Outcome:
        return Outcome(ok=True, message=self._seats.ask(sender))

    def _answer_seat(self, command: AnswerControlRequest, sender: Sender) -> Outcome:
        return Outcome(
            ok=True, message=self._seats.answer_request(sender, gives=command.gives, to=command.to)
        )

    def _note(self, command: Note, sender: Sender) -> Outcome:
        """Put the operator's remark on record at once."""
        said = dataclasses.replace(command, text=to_printable(command.text).strip()[:LONGEST_NOTE])
        self._engine.session_log.append(
            action_record(Request(command=said, sender=sender), done_result("noted"))
        )
        if not self._flush(FLUSH_S):
            return self._not_on_record("noted in memory")
        return Outcome(ok=True, message="noted")

    def _begin_mark(self, command: BeginMark, sender: Sender) -> Outcome:
        """Keep a frame for marking; on record, because a replay keeps it, too."""
        frame_id = self._engine.decisions.begin_mark(command)
        begun = dataclasses.replace(command, frame_id=frame_id)
        self._engine.session_log.append(action_record(Request(command=begun, sender=sender), DONE))
        what = f"frame {frame_id} is kept" if command.is_on else f"frame {frame_id} is let go"
        return Outcome(ok=True, message=what, data={"frame": frame_id, "frames": HELD})


def _first_word(request: Request, accepted: Accepted, wait_s: float) -> Outcome:
    """Return the mount's answer to a command, or the progress within that time."""
    result, data = request.course.wait(wait_s), dict(accepted.data)
    if result is None:
        return Outcome(ok=True, message=SENT if request.course.is_begun else WAITS, data=data)
    if result.kind == "done":
        # What the check has promised holds now; where it knew nothing, the doing tells.
        words = text(result) if accepted.message == SOON else accepted.message
        return Outcome(ok=True, message=words, data=data)
    if result.kind == "refused":
        data[ON_RECORD] = True
    return Outcome(ok=False, message=result.detail or text(result), data=data)
