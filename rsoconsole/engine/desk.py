"""Answers the operator's wire: STOP and status at once, the rest through the loop."""

import dataclasses
from collections.abc import Callable
from typing import Any

from rsoconsole.control import Intention, Outcome
from rsoconsole.engine.intentions import Intentions, Wish, changed
from rsoconsole.engine.loop import Engine
from rsoconsole.instruments.ports import MountPort
from rsoconsole.sky.frames import icrs_to_altaz


class Desk:
    """Handles intentions on the wire's threads; the loop is never waited for."""

    def __init__(
        self,
        engine: Engine,
        mount: MountPort,
        intentions: Intentions,
        record_faults: Callable[[], tuple[str, ...]] = tuple,
    ) -> None:
        self._engine = engine
        self._mount = mount
        self._intentions = intentions
        self._record_faults = record_faults

    def handle(self, intention: Intention) -> Outcome:
        """What came of it; a refusal says why."""
        handlers = {
            "stop": self._stop,
            "status": self._status,
            "arm": self._queue,
            "disarm": self._queue,
            "set": self._set,
            "shutdown": self._shutdown,
        }
        handler = handlers.get(intention.verb)
        if handler is None:
            known = ", ".join(handlers)
            return Outcome(
                ok=False, message=f"the engine knows no '{intention.verb}'; it knows {known}"
            )
        return handler(intention)

    def _stop(self, intention: Intention) -> Outcome:
        # The flag and the mount first; whatever else STOP means comes after them.
        result = self._intentions.stop(intention.by, self._mount.abort)
        self._engine.wake()
        data: dict[str, Any] = dataclasses.asdict(result)
        return Outcome(ok=result.stopped, message=result.detail or "stopped", data=data)

    def _status(self, _intention: Intention) -> Outcome:
        status = self._engine.status()
        data: dict[str, Any] = {**dataclasses.asdict(status), "target": None}
        data["faults"] = [*status.faults, *self._record_faults()]
        data["alt"] = data["az"] = None
        if status.ra is not None and status.dec is not None and status.t_utc_ns is not None:
            site = self._engine.config.site.to_site()
            data["alt"], data["az"] = icrs_to_altaz(site, status.ra, status.dec, status.t_utc_ns)
        return Outcome(ok=True, data=data)

    def _queue(self, intention: Intention) -> Outcome:
        self._intentions.put(Wish(verb=intention.verb, by=intention.by))
        return Outcome(ok=True, message="in force from the next cycle")

    def _set(self, intention: Intention) -> Outcome:
        name, value = str(intention.arguments.get("name", "")), intention.arguments.get("value")
        if not isinstance(value, int | float | str) or isinstance(value, bool):
            return Outcome(ok=False, message="set needs a name and a value")
        try:
            changed(self._engine.config, name, value)
        except ValueError as error:
            return Outcome(ok=False, message=str(error))
        self._intentions.put(Wish(verb="set", name=name, value=value, by=intention.by))
        return Outcome(ok=True, message="in force from the next cycle")

    def _shutdown(self, intention: Intention) -> Outcome:
        self._intentions.put(Wish(verb="shutdown", by=intention.by))
        self._intentions.request_shutdown()
        self._engine.wake()
        return Outcome(ok=True, message="the engine stops the mount and ends")
