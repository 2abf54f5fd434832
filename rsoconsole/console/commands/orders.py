"""Commands on their way up: each on a thread of its own, so that none waits for another."""

import logging
import threading
from collections.abc import Callable

from rsoconsole.control import Command, DirectStop, Outcome, StopNews, Stopping, Wire
from rsoconsole.errors import ControlError

log = logging.getLogger(__name__)


class Orders:
    """Sends commands; callbacks are called on the threads that sent them."""

    def __init__(self, wire: Callable[[], Wire], stop_directly: DirectStop | None = None) -> None:
        self._wire = wire
        self._stop_directly = stop_directly

    def stop(self, on_news: Callable[[StopNews], None]) -> None:
        """STOP, now; ``on_news`` hears when it is late and how it ended."""
        Stopping(self._wire, self._stop_directly, on_news).begin()

    def send(self, command: Command, on_outcome: Callable[[Outcome], None]) -> None:
        """Hand over a command; an engine out of reach is an outcome too."""

        def work() -> None:
            try:
                outcome = self._wire().send(command, timeout_s=command.answer_s)
            except ControlError as error:
                outcome = Outcome(ok=False, message=str(error))
            except Exception as error:  # the seat must hear of it, whatever it is
                log.exception("%s", command.verb)
                words = f"{command.verb}: {error or type(error).__name__}"
                outcome = Outcome(ok=False, message=words)
            on_outcome(outcome)

        threading.Thread(target=work, name=f"console-{command.verb}", daemon=True).start()
