"""Control among several consoles: the first to act has it until it gives it up or is gone.

Every console sees everything, and may give STOP. Commands from a shell need no control.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.control import Sender

GONE_S = 10.0
"""Time without a request after which a console counts as gone, s."""
ASKED_S = 30.0
"""Time after which a request for control succeeds without an answer, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatView:
    """The console in control, and a console that requests control."""

    holder: Sender | None
    """Console in control; None while no console has acted, or after it has left."""
    asked_by: Sender | None


class ConsoleControl:
    """The console in control, and requests for control; used from the wire's threads."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._holder: Sender | None = None
        self._asked_by: Sender | None = None
        self._asked_s = 0.0
        self._seen_s: dict[Sender, float] = {}

    def refusal(self, who: Sender, *, needs_control: bool) -> str | None:
        """Return why a sender may not act now; None where it may.

        A console whose command needs control is given control, where no other console has it.
        """
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
        """Request control for a console; return the answer in words."""
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

    def answer_request(self, who: Sender, *, gives: bool, to: str | None = None) -> str:
        """Give control to the console that requests it, or refuse; return the outcome in words.

        ``to``: the console that is meant; None: any that requests control. Raises ValueError where
        no console requests it, or another one than ``to``.
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
        """Return which console has control, and which requests it."""
        with self._lock:
            self._tidy()
            return SeatView(holder=self._holder, asked_by=self._asked_by)

    def _receive(self, who: Sender) -> None:
        self._seen_s[who] = self._now_s()
        self._tidy()

    def _tidy(self) -> None:
        """Drop consoles that have left; a holder that did not answer a request loses control."""
        now_s = self._now_s()
        self._seen_s = {w: s for w, s in self._seen_s.items() if now_s - s < GONE_S}
        if self._asked_by is not None and self._asked_by not in self._seen_s:
            self._asked_by = None
        is_silent = self._asked_by is not None and now_s - self._asked_s >= ASKED_S
        if (self._holder is not None and self._holder not in self._seen_s) or is_silent:
            self._holder, self._asked_by = self._asked_by, None


def seat_name(who: Sender | None) -> str:
    """Return a console's name; "nobody" for None."""
    return "nobody" if who is None else who.name
