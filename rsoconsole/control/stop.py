"""STOP: sent to the engine at once, and to the mount directly when the engine fails or is late.

Either answer is enough. The console's key, the panel's button and the shell's verb share this
procedure. It has two stages: ABORT is sent and the driver answers, which is known at once; the
mount's motion is then measured, which takes some seconds and alone shows whether it has stopped.
"""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from rsoconsole.base import RsoconsoleError
from rsoconsole.control.client import ControlClient
from rsoconsole.control.commands import AskStatus, Stop
from rsoconsole.records import StopOutcome
from rsoconsole.words import (
    CUT_POWER,
    STOP_PATHS,
    measured_text,
    stop_answer_text,
    stop_order_text,
    unmeasured_text,
)

log = logging.getLogger(__name__)

ENGINE_S = 1.0
LATE_S = 0.3
"""Wait for the engine's answer before ABORT is also sent directly to the mount, s."""
MEASURED_S = 12.0
_ASK_EVERY_S = 0.25
REMEDY = f"run 'rsoconsole stop' in another terminal; {CUT_POWER} if it moves"
SUPERSEDED = "another order came before STOP was measured to its end"

FROM_PRESS, IN_ENGINE = "counted from the key", "counted in the engine"
"""From when a STOP's times count: from its sending, or from its arrival in the engine."""

Found = Mapping[str, Any]
"""Result of a STOP so far: is_answered, path, ms, ordered_ms, detail; then motion, rate_deg_s."""
DirectStop = Callable[[Callable[[Found], None]], None]
"""Function that stops the mount without the engine and reports each new result; may raise."""


Phase = Literal["sent", "late", "answered", "stopped", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StopNews:
    """The state of a STOP, as it is passed to ``on_news``."""

    phase: Phase
    """Phase; answered: by the driver; stopped: measured at rest; failed: moves on or not known."""
    text: str
    path: str = ""
    """Connection of the answer, or of the last attempt: mount, indi or engine."""
    ms: float | None = None
    """Time from the start of the STOP until this state was known, ms."""
    ordered_ms: float | None = None
    """Time from the start until ABORT was on its way, ms; None: not yet, or not reported."""
    answered_ms: float | None = None
    """Time from the start until the driver accepted ABORT, ms; None: not yet, or not reported."""
    motion: StopOutcome | None = None
    """Measured motion of the mount; None: not yet measured."""
    rate_deg_s: float | None = None
    """Rate of the faster axis, deg/s, where the mount moves."""
    reason: str = ""
    """Reason why the STOP failed; empty where it has not."""
    is_superseded: bool = False
    """True where another order came before it was measured: no alarm, but nothing is known."""


def add_time_origin(said: str, ordered_ms: float | None, since: str) -> str:
    """Return a STOP's words; where ``ordered_ms`` is known, with what its times count from
    (``since``).
    """
    return said if ordered_ms is None else f"{said} ({since})"


class Stopping:
    """One STOP under way; ``on_news`` is called with each new state, from threads of the STOP."""

    def __init__(
        self,
        wire: Callable[[], ControlClient],
        directly: DirectStop | None,
        on_news: Callable[[StopNews], None] = lambda _news: None,
    ) -> None:
        self._wire = wire
        self._directly = directly
        self._on_news = on_news
        self._lock = threading.RLock()
        self._reporting = threading.Lock()
        """Lock that keeps news in order; nothing that ends motion waits for it."""
        self._ways_open = 1
        self._has_gone_past = False
        self._is_answered = False
        self._reasons: list[str] = []
        self._ordered_ms: float | None = None
        self._answered_ms: float | None = None
        self._began_s = time.monotonic()
        self._ended: StopNews | None = None
        self._end = threading.Event()
        self._past: threading.Thread | None = None

    def begin(self) -> None:
        """Start the STOP on a thread of its own, and return at once."""
        threading.Thread(target=self._by_engine, name="stop", daemon=True).start()
        late = threading.Timer(LATE_S, self._when_late)
        late.daemon = True
        late.start()

    def wait(self) -> StopNews:
        """Wait until the motion is measured, or both the engine and the direct connection failed.

        A direct connection that has begun is waited for in any case: after its ABORT it may still
        set tracking as configured, and it sends ABORT again while the mount moves.
        """
        self._end.wait()
        if self._past is not None:
            self._past.join()
        assert self._ended is not None
        return self._ended

    # -- the ways -------------------------------------------------------------------------------

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
        found = outcome.data
        path = found.get("path")
        if not isinstance(path, str):
            self._failed(outcome.message or "the engine gave no reason")
            return
        self._note_order_time(found)
        if outcome.ok and found.get("is_answered") is True:
            self._answered(STOP_PATHS.get(path, "the engine"), path)
        else:
            self._go_past()
            self._note_reason(outcome.message or "the engine gave no reason")
        if not self._take_motion(found, path):
            self._follow_engine(found.get("number"), path)

    def _follow_engine(self, number: Any, path: str) -> None:
        """Poll until the engine has measured the mount's motion."""
        reason = "the engine has not told how it moves"
        while time.monotonic() < self._began_s + MEASURED_S:
            time.sleep(_ASK_EVERY_S)
            try:
                status = self._wire().send(AskStatus(), timeout_s=ENGINE_S)
            except Exception as error:  # as above
                reason = str(error).partition(":")[0] or type(error).__name__
                break
            last = status.data.get("last_stop")
            if not isinstance(last, Mapping):
                continue
            is_ours = not isinstance(number, int) or last.get("number", number) >= number
            if is_ours and self._take_motion(last, path):
                return
        self._failed(reason)

    def _when_late(self) -> None:
        if self._is_answered:
            return
        if self._directly is None:
            self._say(StopNews(phase="late", text=f"NO ANSWER YET: {REMEDY}"))
        else:
            self._go_past()
            text = f"NO ANSWER YET, going past the engine. If in doubt {REMEDY}"
            self._say(StopNews(phase="late", text=text))

    def _go_past(self) -> None:
        with self._lock:
            if self._directly is None or self._has_gone_past or self._ended is not None:
                return
            self._has_gone_past = True
            self._ways_open += 1
            self._past = threading.Thread(
                target=self._past_engine, name="stop-past-engine", daemon=True
            )
            self._past.start()

    def _past_engine(self) -> None:
        assert self._directly is not None
        has_ended: list[bool] = []
        reasons: list[str] = []

        def take(found: Found) -> None:
            path = str(found.get("path") or "indi")
            if self._take_motion(found, path):
                has_ended.append(True)
            elif found.get("is_answered") is True:
                way = f"a connection past the engine ({STOP_PATHS.get(path, path)})"
                self._answered(way, path)
            elif found.get("detail"):
                reasons.append(str(found["detail"]))

        try:
            self._directly(take)
        except Exception as error:  # as above
            log.exception("stop past the engine")
            reasons.append(str(error) or type(error).__name__)
        if not has_ended:
            self._failed(reasons[-1] if reasons else "no reason given", is_past=True)

    # -- what they find -------------------------------------------------------------------------

    def _note_order_time(self, data: Mapping[str, Any]) -> None:
        """Note when ABORT was on its way; the engine's own times count from the STOP's arrival."""
        ordered, ms = data.get("ordered_ms"), data.get("ms")
        if isinstance(ordered, int | float) and isinstance(ms, int | float):
            self._ordered_ms = max(0.0, self._ms() - max(0.0, ms - ordered))

    def _answered(self, way: str, path: str) -> None:
        with self._lock:
            if self._is_answered:
                return
            self._is_answered, self._answered_ms = True, self._ms()
        said = stop_answer_text(self._answered_ms, way, self._ordered_ms)
        text = add_time_origin(f"{said}: measuring", self._ordered_ms, FROM_PRESS)
        self._say(self._news("answered", text, path))

    def _take_motion(self, found: Found, path: str) -> bool:
        """True where a result has the measured motion, or says that this is not known."""
        motion, rate = found.get("motion"), found.get("rate_deg_s")
        if motion is None or motion not in get_args(StopOutcome):
            return False
        rate_deg_s = float(rate) if isinstance(rate, int | float) else None
        detail = str(found.get("detail") or "")
        text = measured_text(motion, rate_deg_s, self._ms() / 1e3, why=detail, remedy=REMEDY)
        phase: Phase = "stopped" if motion in ("stands", "tracks") else "failed"
        news = self._news(phase, text, path)
        reason = "" if phase == "stopped" else detail or text
        is_superseded = found.get("is_superseded") is True
        news = replace(news, motion=motion, rate_deg_s=rate_deg_s, reason=reason)
        self._say(replace(news, is_superseded=is_superseded))
        return True

    def _note_reason(self, reason: str, *, is_past: bool = False) -> None:
        with self._lock:
            # The engine's first, whichever way has given up first.
            self._reasons.insert(1 if is_past else 0, reason)

    def _failed(self, reason: str, *, is_past: bool = False) -> None:
        self._go_past()
        self._note_reason(reason, is_past=is_past)
        with self._lock:
            self._ways_open -= 1
            is_last = self._ways_open == 0 and self._ended is None
            reasons = "; ".join(dict.fromkeys(self._reasons))
        if is_last:
            path = "engine" if self._directly is None else "indi"
            ordered = stop_order_text(self._ordered_ms, "{}, ")
            state = "answered, but " if self._is_answered else "NOT ANSWERED: "
            news = self._news("failed", f"{ordered}{state}{unmeasured_text(reasons, REMEDY)}", path)
            self._say(replace(news, motion="unknown", reason=reasons))

    def _ms(self) -> float:
        return (time.monotonic() - self._began_s) * 1e3

    def _news(self, phase: Phase, text: str, path: str) -> StopNews:
        return StopNews(
            phase=phase,
            text=text,
            path=path,
            ms=self._ms(),
            ordered_ms=self._ordered_ms,
            answered_ms=self._answered_ms,
        )

    def _say(self, news: StopNews) -> None:
        is_end = news.phase in ("stopped", "failed")
        with self._lock:
            before = self._ended
            if before is not None and (not is_end or before.phase == "stopped"):
                return
            if is_end:
                self._ended = news
        try:
            with self._reporting:
                is_old = news.phase == "late" and self._is_answered
                if is_end or (self._ended is None and not is_old):
                    self._on_news(news)
        except Exception:  # who only hears of a STOP may not end it
            log.exception("news of a STOP")
        finally:
            if is_end:
                self._end.set()
