"""STOP: to the engine at once, and past it as soon as it fails or is late; one yes is enough.

The one procedure of every seat: the console's key, the panel's button and the shell's verb.
"""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rsoconsole.control.client import Wire
from rsoconsole.control.commands import Stop
from rsoconsole.errors import RsoconsoleError
from rsoconsole.reason_text import STOP_PATHS, stopped_text

log = logging.getLogger(__name__)

ENGINE_S = 1.0
"""How long the engine's answer is waited for."""
LATE_S = 0.3
"""How long it is waited for before the mount itself is told."""
REMEDY = "run 'rsoconsole stop' in another terminal; cut the mount's power if it moves"

FROM_PRESS, IN_ENGINE = "counted from the key", "counted in the engine"
"""From when the times of a STOP count: where it was given, and where it was carried out."""

DirectStop = Callable[[], tuple[bool, str]]
"""Stops the mount without the engine: (it stands, how or what is wrong). Raises what it will."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopNews:
    """How a STOP stands."""

    phase: Literal["sent", "late", "stopped", "failed"]
    text: str
    path: str = ""
    """Through what motion was ended, or was tried to be last: mount, indi, engine."""
    ms: float | None = None
    """From the beginning to the end of the procedure: until it was confirmed, or given up."""
    ordered_ms: float | None = None
    """Until ABORT was on its way to the mount; None: not yet, or nobody has told."""
    reason: str = ""
    """What is wrong where it failed."""


def counted(said: str, ordered_ms: float | None, since: str) -> str:
    """The words of a STOP, with from when both of its times count, where there are two."""
    return said if ordered_ms is None else f"{said} ({since})"


def unheard(_news: StopNews) -> None:
    """For who waits for the end only."""


class Stopping:
    """One STOP under way; ``on_news`` is called from its threads, last with its end."""

    def __init__(
        self,
        wire: Callable[[], Wire],
        directly: DirectStop | None,
        on_news: Callable[[StopNews], None] = unheard,
    ) -> None:
        self._wire = wire
        self._directly = directly
        self._on_news = on_news
        self._lock = threading.RLock()
        self._reporting = threading.Lock()
        """News go out one after the other; nothing that ends motion waits for them."""
        self._ways_open = 1
        self._has_gone_past = False
        self._is_over = False
        self._reasons: list[str] = []
        self._ordered_ms: float | None = None
        self._began_s = time.monotonic()
        self._ended: StopNews | None = None
        self._end = threading.Event()
        self._past: threading.Thread | None = None

    def begin(self) -> None:
        """Act; returns at once."""
        threading.Thread(target=self._by_engine, name="stop", daemon=True).start()
        late = threading.Timer(LATE_S, self._when_late)
        late.daemon = True
        late.start()

    def wait(self) -> StopNews:
        """How it ended, once every way has said no or one has said yes.

        A way past the engine that has begun is waited for all the same: it may still set tracking
        as configured after its own ABORT.
        """
        self._end.wait()
        if self._past is not None:
            self._past.join()
        assert self._ended is not None
        return self._ended

    def _by_engine(self) -> None:
        try:
            outcome = self._wire().send(Stop(), timeout_s=ENGINE_S)
        except RsoconsoleError as error:
            self._failed(str(error).partition(":")[0])
            return
        except Exception as error:  # nothing that is wrong with the wire may end a STOP
            log.exception("stop")
            self._failed(str(error) or type(error).__name__)
            return
        path = outcome.data.get("path")
        self._note_order_time(outcome.data)
        if outcome.ok and outcome.data.get("stopped") is True and isinstance(path, str):
            self._stopped(STOP_PATHS.get(path, "the engine"), path)
        else:
            self._failed(outcome.message or "the engine gave no reason")

    def _when_late(self) -> None:
        if self._directly is None:
            self._say(StopNews(phase="late", text=f"NO ANSWER YET: {REMEDY}"))
        else:
            self._go_past()
            text = f"NO ANSWER YET, going past the engine. If in doubt {REMEDY}"
            self._say(StopNews(phase="late", text=text))

    def _go_past(self) -> None:
        with self._lock:
            if self._directly is None or self._has_gone_past or self._is_over:
                return
            self._has_gone_past = True
            self._ways_open += 1
            self._past = threading.Thread(
                target=self._past_engine, name="stop-past-engine", daemon=True
            )
            self._past.start()

    def _past_engine(self) -> None:
        assert self._directly is not None
        try:
            stands, words = self._directly()
        except Exception as error:  # as above
            log.exception("stop past the engine")
            stands, words = False, str(error) or type(error).__name__
        if stands:
            self._stopped(f"a connection past the engine ({STOP_PATHS.get(words, words)})", words)
        else:
            self._failed(words, is_past=True)

    def _note_order_time(self, data: Mapping[str, Any]) -> None:
        """When the engine had ordered it; its own clock began when it heard of the STOP."""
        ordered, ms = data.get("ordered_ms"), data.get("ms")
        if isinstance(ordered, int | float) and isinstance(ms, int | float):
            self._ordered_ms = max(0.0, self._ms() - max(0.0, ms - ordered))

    def _stopped(self, way: str, path: str) -> None:
        ms = self._ms()
        text = counted(stopped_text(ms, way, self._ordered_ms), self._ordered_ms, FROM_PRESS)
        news = StopNews(phase="stopped", text=text, path=path, ms=ms, ordered_ms=self._ordered_ms)
        self._say(news)

    def _failed(self, reason: str, *, is_past: bool = False) -> None:
        self._go_past()
        with self._lock:
            self._ways_open -= 1
            # The engine's first, whichever way has given up first.
            self._reasons.insert(1 if is_past else 0, reason)
            is_last = self._ways_open == 0
            reasons = "; ".join(self._reasons)
        if is_last:
            ordered = self._ordered_ms
            ordered_text = "" if ordered is None else f"ordered in {ordered:.0f} ms, "
            news = StopNews(
                phase="failed",
                text=f"{ordered_text}NOT CONFIRMED: {REMEDY} ({reasons})",
                path="engine" if self._directly is None else "indi",
                ms=self._ms(),
                ordered_ms=ordered,
                reason=reasons,
            )
            self._say(news)

    def _ms(self) -> float:
        return (time.monotonic() - self._began_s) * 1e3

    def _say(self, news: StopNews) -> None:
        is_end = news.phase != "late"
        with self._lock:
            if self._is_over:
                return
            if is_end:
                self._is_over = True
                self._ended = news
        try:
            with self._reporting:
                if is_end or not self._is_over:
                    self._on_news(news)
        except Exception:  # who only hears of a STOP may not end it
            log.exception("news of a STOP")
        finally:
            if is_end:
                self._end.set()
