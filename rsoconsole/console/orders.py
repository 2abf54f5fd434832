"""Intentions on their way up: each on a thread of its own, so that none waits for another."""

import logging
import threading
from collections.abc import Callable
from typing import Any

from rsoconsole.control import Outcome, Wire
from rsoconsole.control.stop import DirectStop, Stop, StopNews
from rsoconsole.errors import ControlError

log = logging.getLogger(__name__)


class Orders:
    """Sends intentions; callbacks are called on the threads that sent them."""

    def __init__(self, wire: Callable[[], Wire], stop_directly: DirectStop | None = None) -> None:
        self._wire = wire
        self._stop_directly = stop_directly

    def stop(self, on_news: Callable[[StopNews], None]) -> None:
        """STOP, now; ``on_news`` hears when it is late and how it ended."""
        Stop(self._wire, self._stop_directly, on_news).begin()

    def send(self, verb: str, on_outcome: Callable[[Outcome], None], **arguments: Any) -> None:
        """Hand over an intention; an engine out of reach is an outcome too."""

        def work() -> None:
            try:
                outcome = self._wire().send(verb, **arguments)
            except ControlError as error:
                outcome = Outcome(ok=False, message=str(error))
            except Exception as error:  # the seat must hear of it, whatever it is
                log.exception("%s", verb)
                outcome = Outcome(ok=False, message=f"{verb}: {error or type(error).__name__}")
            on_outcome(outcome)

        threading.Thread(target=work, name=f"console-{verb}", daemon=True).start()
