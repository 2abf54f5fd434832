"""Which of several consoles may act: the first that does, until it gives that away or is gone.

Every console sees; STOP is everybody's. Commands from a shell are not asked.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.control import Sender
from rsoconsole.engine.aim.states import Authority, Stopped
from rsoconsole.engine.tasks.watch import Watch

GONE_S = 10.0
"""A console that has not been heard of for so long has left its seat."""
ASKED_S = 30.0
"""Who is asked and says nothing for so long gives the seat up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatView:
    """Who may act, and who wants to."""

    holder: Sender | None
    """None while nobody has acted, or who did has left."""
    asked_by: Sender | None


class Seats:
    """Heard on the wire's threads."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._holder: Sender | None = None
        self._asked_by: Sender | None = None
        self._asked_s = 0.0
        self._seen_s: dict[Sender, float] = {}

    def refusal(self, who: Sender, *, needs_control: bool) -> str | None:
        """Why this one may not do that now; None where it may. Anyone who may and acts takes it."""
        if who.kind != "console":
            return None
        with self._lock:
            self._receive(who)
            if not needs_control:
                return None
            if self._holder in {None, who}:
                self._holder = who
                return None
            return f"{seat_name(self._holder)} has control: ask for it"

    def ask(self, who: Sender) -> str:
        """Somebody wants the seat; says how that stands."""
        with self._lock:
            self._receive(who)
            if self._holder in {None, who}:
                self._holder = who
                return "you have control"
            if self._asked_by not in {None, who}:
                return f"{seat_name(self._asked_by)} has asked already"
            if self._asked_by is None:
                self._asked_by, self._asked_s = who, self._now_s()
            return f"{seat_name(self._holder)} is asked; yours in {ASKED_S:.0f} s at the latest"

    def answer(self, who: Sender, *, gives: bool, to: str | None = None) -> str:
        """The holder gives the seat, or keeps it; ``to``: who is meant, None: who asks.

        Raises ValueError where nobody asks for it, or somebody else does by now.
        """
        with self._lock:
            self._receive(who)
            if who != self._holder or self._asked_by is None:
                raise ValueError("nobody asks you for control")
            if to is not None and to != seat_name(self._asked_by):
                raise ValueError(f"{seat_name(self._asked_by)} asks by now: answer that")
            asked_by, self._asked_by = self._asked_by, None
            if gives:
                self._holder = asked_by
                return f"{seat_name(asked_by)} has control now"
            return "you keep control"

    def view(self) -> SeatView:
        """How it stands."""
        with self._lock:
            self._tidy()
            return SeatView(holder=self._holder, asked_by=self._asked_by)

    def _receive(self, who: Sender) -> None:
        self._seen_s[who] = self._now_s()
        self._tidy()

    def _tidy(self) -> None:
        """Who has gone has no seat and no wish; who was asked and was silent gives it up."""
        now_s = self._now_s()
        self._seen_s = {w: s for w, s in self._seen_s.items() if now_s - s < GONE_S}
        if self._asked_by is not None and self._asked_by not in self._seen_s:
            self._asked_by = None
        is_silent = self._asked_by is not None and now_s - self._asked_s >= ASKED_S
        if (self._holder is not None and self._holder not in self._seen_s) or is_silent:
            self._holder, self._asked_by = self._asked_by, None


def seat_name(who: Sender | None) -> str:
    """A console's name."""
    return "nobody" if who is None else who.name


class Faults:
    """The words of what is broken, and what ends them."""

    def __init__(self) -> None:
        self._words: list[str] = []
        self._was_blind = False
        """The mount has been silent since the fault."""
        self._stop: tuple[Stopped, int] | None = None
        """A STOP that the mount did not obey, and when that was known."""

    @property
    def words(self) -> tuple[str, ...]:
        """Of everything that is broken."""
        return tuple(self._words)

    def add(self, words: str) -> bool:
        """Something has failed; False where that is known already."""
        if words in self._words:
            return False
        self._words.append(words)
        return True

    def clear(self) -> None:
        """Nothing is broken any more, as far as is known."""
        self._words.clear()
        self._was_blind, self._stop = False, None

    def expect_stop(self, stopped: Stopped, words: str, now_utc_ns: int) -> None:
        """A STOP was not obeyed: that is broken until the mount is measured to be at rest."""
        self._words, self._stop = [words], (stopped, now_utc_ns)

    def take_stop(self, watch: Watch) -> Stopped | None:
        """The STOP that was not obeyed, once the mount is measured to be at rest; else None."""
        report = watch.last_report
        if self._stop is None or watch.is_blind or report is None:
            return None
        stopped, since_ns = self._stop
        if report.t_utc_ns <= since_ns or report.is_slewing or not report.motion.is_at_rest:
            return None
        self._stop = None
        return stopped

    def is_over(self, authority: Authority, watch: Watch) -> bool:
        """Whether the mount, whose silence was the cause of a FAULT, answers again: once."""
        if authority.state != "FAULT" or authority.is_stopped or not self._words:
            self._was_blind = False
            return False
        if watch.is_blind:
            self._was_blind = True
            return False
        was_blind, self._was_blind = self._was_blind, False
        return was_blind
