"""STOP: to the engine at once, and past it as soon as it fails or is late; one yes is enough."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rsoconsole.control.client import Wire
from rsoconsole.control.commands import Stop as StopCommand
from rsoconsole.errors import ControlError

log = logging.getLogger(__name__)

ENGINE_S = 1.0
LATE_S = 0.3
REMEDY = "run 'rsoconsole stop' in another terminal; cut the mount's power if it moves"
PATHS = {"mount": "the mount's own process", "indi": "a second INDI connection"}

DirectStop = Callable[[], tuple[bool, str]]
"""Stops the mount without the engine: (it stands, how or what is wrong). Raises what it will."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopNews:
    """How a STOP stands."""

    phase: Literal["sent", "late", "stopped", "failed"]
    text: str


class Stop:
    """One STOP under way; ``on_news`` is called from its threads, last with its end."""

    def __init__(
        self,
        wire: Callable[[], Wire],
        directly: DirectStop | None,
        on_news: Callable[[StopNews], None],
    ) -> None:
        self._wire = wire
        self._directly = directly
        self._on_news = on_news
        self._lock = threading.RLock()
        self._ways_open = 1
        self._has_gone_past = False
        self._is_over = False
        self._reasons: list[str] = []
        self._began_s = time.monotonic()

    def begin(self) -> None:
        """Act; returns at once."""
        threading.Thread(target=self._by_engine, name="console-stop", daemon=True).start()
        late = threading.Timer(LATE_S, self._when_late)
        late.daemon = True
        late.start()

    def _by_engine(self) -> None:
        try:
            outcome = self._wire().send(StopCommand(), timeout_s=ENGINE_S)
        except ControlError as error:
            self._failed(str(error).partition(":")[0])
            return
        except Exception as error:  # nothing that is wrong with the wire may end a STOP
            log.exception("stop")
            self._failed(str(error) or type(error).__name__)
            return
        if outcome.ok and outcome.data.get("stopped") is True:
            self._stopped(PATHS.get(str(outcome.data.get("path")), "the engine"))
        else:
            self._failed(outcome.message or "the engine gave no reason")

    def _when_late(self) -> None:
        if self._directly is None:
            self._say("late", f"NO ANSWER YET: {REMEDY}")
        else:
            self._say("late", f"NO ANSWER YET, going past the engine. If in doubt {REMEDY}")
            self._go_past()

    def _go_past(self) -> None:
        with self._lock:
            if self._directly is None or self._has_gone_past or self._is_over:
                return
            self._has_gone_past = True
            self._ways_open += 1
        threading.Thread(target=self._past_engine, name="console-stop-past", daemon=True).start()

    def _past_engine(self) -> None:
        assert self._directly is not None
        try:
            stands, words = self._directly()
        except Exception as error:  # as above
            log.exception("stop past the engine")
            stands, words = False, str(error) or type(error).__name__
        if stands:
            self._stopped(f"a connection past the engine ({words})")
        else:
            self._failed(words)

    def _stopped(self, path: str) -> None:
        ms = (time.monotonic() - self._began_s) * 1e3
        self._say("stopped", f"motion ended in {ms:.0f} ms by {path}")

    def _failed(self, reason: str) -> None:
        self._go_past()
        with self._lock:
            self._ways_open -= 1
            self._reasons.append(reason)
            is_last = self._ways_open == 0
            reasons = "; ".join(self._reasons)
        if is_last:
            self._say("failed", f"NOT CONFIRMED: {REMEDY} ({reasons})")

    def _say(self, phase: Literal["late", "stopped", "failed"], text: str) -> None:
        with self._lock:
            if self._is_over:
                return
            self._is_over = phase != "late"
            self._on_news(StopNews(phase=phase, text=text))
