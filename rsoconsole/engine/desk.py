"""Answers the operator's wire: STOP and status at once, the rest through the loop."""

import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.control import Intention, Outcome, printable
from rsoconsole.engine import verdicts
from rsoconsole.engine.arming import arming_checks, gather_facts, refusal_text
from rsoconsole.engine.health import HealthMeter
from rsoconsole.engine.intentions import Intentions, OvertakenError, Wish, action_record, changed
from rsoconsole.engine.loop import Engine
from rsoconsole.engine.machine_watch import MachineState
from rsoconsole.engine.seats import Seats, name_of
from rsoconsole.engine.seek import check_seek
from rsoconsole.engine.states import Stopped
from rsoconsole.engine.temporary import MOST_FRAMES
from rsoconsole.engine.wishes import (
    AIMS,
    overridden,
    preview_of_move,
    refuse_by_hand,
    wanted_direction,
)
from rsoconsole.errors import RsoconsoleError
from rsoconsole.records import OperatorAction
from rsoconsole.sky.frames import icrs_to_altaz

LONGEST_NOTE = 2000
LARGEST_WHOLE = 2**53
SOON = "in force from the next cycle"
FLUSH_S = 0.5


class Desk:
    """Handles intentions on the wire's threads; the loop is never waited for."""

    def __init__(
        self,
        engine: Engine,
        intentions: Intentions,
        session: Path,
        record_faults: Callable[[], tuple[str, ...]] = tuple,
        flush: Callable[[float], bool] = lambda _timeout_s: True,
        *,
        machine: Callable[[], MachineState | None] = lambda: None,
    ) -> None:
        """``flush``: wait until the disk has what was put on record, at most so many seconds.

        ``machine``: what was last seen of the machine itself.
        """
        self._engine = engine
        self._instruments = engine.hands.instruments
        self._intentions = intentions
        self._session = session
        self._record_faults = record_faults
        self._flush = flush
        self._seats = Seats()
        self._machine = machine
        self._health = HealthMeter(lambda: engine.config, self._instruments.clock, session, machine)

    def handle(self, intention: Intention) -> Outcome:
        """What came of it; a refusal says why."""
        handlers = {
            "stop": self._stop,
            "status": self._status,
            "arm": self._arm,
            "disarm": self._queue,
            "hold": self._hold,
            "resume": self._queue,
            "goto": self._move,
            "nudge": self._move,
            "park": self._queue,
            "unpark": self._queue,
            "abort": self._queue,
            "track": self._track,
            "seek": self._seek,
            "preview": self._preview,
            "set": self._set,
            "shutdown": self._shutdown,
            "note": self._note,
            "ask_seat": self._ask_seat,
            "answer_seat": self._answer_seat,
            **dict.fromkeys(verdicts.VERBS, self._judge),
        }
        refused = self._seats.refusal(intention.by, intention.verb)
        if refused is not None:
            holder = name_of(self._seats.view().holder)
            return Outcome(ok=False, message=refused, data={"seat": holder})
        handler = handlers.get(intention.verb)
        if handler is None:
            known = ", ".join(handlers)
            return Outcome(
                ok=False, message=f"the engine knows no '{intention.verb}'; it knows {known}"
            )
        try:
            _expect_plain(intention.arguments)
            return handler(intention)
        except (ValueError, RsoconsoleError) as error:
            return Outcome(ok=False, message=str(error))

    def _stop(self, intention: Intention) -> Outcome:
        # The flag and the mount first; whatever else STOP means comes after them.
        result = self._intentions.stop(Stopped(by=intention.by), self._instruments.mount.abort)
        self._engine.wake()
        outcome = f"stopped in {result.ms:.0f} ms by {result.path}"
        self._engine.chronicle.append(
            OperatorAction(
                verb="stop",
                arguments={},
                outcome=outcome if result.stopped else f"NOT confirmed: {result.detail}",
                by=intention.by,
            )
        )
        data: dict[str, Any] = dataclasses.asdict(result)
        return Outcome(ok=result.stopped, message=result.detail or "stopped", data=data)

    def _status(self, _intention: Intention) -> Outcome:
        status = self._engine.status()
        data: dict[str, Any] = {**dataclasses.asdict(status), "target": None}
        data["faults"] = [*status.faults, *self._record_faults()]
        report = self._engine.watch.last_report
        data["health"] = [
            dataclasses.asdict(each) for each in self._health.read(report, self._engine.clock_set)
        ]
        machine = self._machine()
        data["machine"] = None if machine is None else machine.as_status()
        data["alt"] = data["az"] = None
        seat = self._seats.view()
        data["seat"] = None if seat.holder is None else name_of(seat.holder)
        data["seat_asked_by"] = None if seat.asked_by is None else name_of(seat.asked_by)
        data["temporary"] = self._engine.temporary.left()
        data["session"] = str(self._session.absolute())
        data["pid"] = os.getpid()
        if status.ra is not None and status.dec is not None and status.t_utc_ns is not None:
            site = self._engine.config.site.to_site()
            data["alt"], data["az"] = icrs_to_altaz(site, status.ra, status.dec, status.t_utc_ns)
        return Outcome(ok=True, data=data)

    def _arm(self, intention: Intention) -> Outcome:
        """The checklist is gone through at once, so that the answer says what is missing."""
        names = overridden(intention.arguments)
        if self._engine.charge.is_autonomous:
            return Outcome(ok=False, message="it is armed already")
        config = self._engine.config
        checks = arming_checks(gather_facts(self._instruments, config, self._session), config)
        unknown = names - {check.name for check in checks} - {"pointing"}
        if unknown:
            known = ", ".join([*(check.name for check in checks), "pointing"])
            return Outcome(
                ok=False, message=f"no check is called {', '.join(unknown)}; there are {known}"
            )
        data = {"checks": [dataclasses.asdict(check) for check in checks]}
        refused = refusal_text(checks, names)
        if refused is not None:
            return Outcome(ok=False, message=refused, data=data)
        return self._accept(intention, "armed from the next cycle", data)

    def _move(self, intention: Intention) -> Outcome:
        wish = Wish(verb=intention.verb, arguments=intention.arguments, by=intention.by)
        direction = wanted_direction(self._engine, wish)
        refused = refuse_by_hand(self._engine, wish, direction)
        if refused is not None:
            return Outcome(ok=False, message=refused)
        data = {"ra_icrs_deg": direction[0], "dec_icrs_deg": direction[1]}
        return self._accept(intention, "on its way; you have the mount", data)

    def _queue(self, intention: Intention) -> Outcome:
        return self._accept(intention, SOON)

    def _set(self, intention: Intention) -> Outcome:
        name, value = str(intention.arguments.get("name", "")), intention.arguments.get("value")
        if not isinstance(value, int | float | str) or isinstance(value, bool):
            return Outcome(ok=False, message="set needs a name and a value")
        changed(self._engine.config, name, value)
        frames = intention.arguments.get("frames")
        is_count = isinstance(frames, int) and not isinstance(frames, bool)
        if frames is not None and not (is_count and 1 <= frames <= MOST_FRAMES):
            return Outcome(ok=False, message=f"frames must be a number from 1 to {MOST_FRAMES}")
        return self._accept(intention, SOON)

    def _hold(self, intention: Intention) -> Outcome:
        until = intention.arguments.get("until")
        if until not in {None, "clear"}:
            return Outcome(ok=False, message="a hold is until 'clear', or until you resume")
        return self._accept(intention, SOON)

    def _preview(self, intention: Intention) -> Outcome:
        """Where a move by hand would lead, how long it takes and what stands against it."""
        names = set(intention.arguments)
        verb = "nudge" if "east_arcmin" in names else "aim" if names & set(AIMS) else "goto"
        wish = Wish(verb=verb, arguments=intention.arguments, by=intention.by)
        return Outcome(ok=True, data=preview_of_move(self._engine, wish))

    def _judge(self, intention: Intention) -> Outcome:
        """A word on a frame's streaks: refused at once where it can be seen that it must be."""
        ruling = verdicts.check(self._engine, intention.verb, intention.arguments, intention.by)
        # The frame it was said of: another may be there before the loop comes to it.
        said = {**intention.arguments, "frame": ruling.frame_id}
        pinned = dataclasses.replace(intention, arguments=said)
        return self._accept(pinned, "taken up with the next frame")

    def _track(self, intention: Intention) -> Outcome:
        if not isinstance(intention.arguments.get("on", True), bool):
            return Outcome(ok=False, message="track: on is true or false")
        return self._accept(intention, SOON)

    def _seek(self, intention: Intention) -> Outcome:
        check_seek(self._engine)
        return self._accept(intention, SOON)

    def _ask_seat(self, intention: Intention) -> Outcome:
        return Outcome(ok=True, message=self._seats.ask(intention.by))

    def _answer_seat(self, intention: Intention) -> Outcome:
        gives = intention.arguments.get("gives") is True
        to = intention.arguments.get("to")
        named = to if isinstance(to, str) else None
        return Outcome(ok=True, message=self._seats.answer(intention.by, gives=gives, to=named))

    def _note(self, intention: Intention) -> Outcome:
        """The operator's remark, on record at once."""
        text = intention.arguments.get("text")
        if not isinstance(text, str) or not text.strip():
            return Outcome(ok=False, message="a note needs words")
        said = {"text": printable(text).strip()[:LONGEST_NOTE]}
        self._engine.chronicle.append(
            OperatorAction(verb="note", arguments=said, outcome="noted", by=intention.by)
        )
        self._flush(FLUSH_S)
        return Outcome(ok=True, message="noted")

    def _shutdown(self, intention: Intention) -> Outcome:
        outcome = self._accept(intention, "the engine stops the mount and ends")
        self._intentions.request_shutdown()
        self._engine.wake()
        return outcome

    def _accept(
        self, intention: Intention, message: str, data: dict[str, Any] | None = None
    ) -> Outcome:
        wish = Wish(verb=intention.verb, arguments=intention.arguments, by=intention.by)
        try:
            self._intentions.put(wish, intention.stamp)
        except OvertakenError as overtaken:
            self._engine.chronicle.append(action_record(wish, str(overtaken)))
            raise
        # What has been acknowledged is on record, unless the disk does not take it.
        self._engine.chronicle.append(action_record(wish, "accepted"))
        self._flush(FLUSH_S)
        if intention.verb != "set":
            self._engine.wake()
        return Outcome(ok=True, message=message, data=data or {})


def _expect_plain(arguments: Mapping[str, Any]) -> None:
    """Raises ValueError for numbers that cannot be kept on record."""
    for name, value in arguments.items():
        is_whole = isinstance(value, int) and abs(value) > LARGEST_WHOLE
        if is_whole or (isinstance(value, float) and not math.isfinite(value)):
            raise ValueError(f"{name} must be a number that can be worked with, not {value}")
