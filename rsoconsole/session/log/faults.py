"""What is wrong with the record at this moment, in words."""

import threading
from collections.abc import Callable

_GIVEN_UP = ("frame", "closeup", "preview")
"""Places of what is lost without harm to the night, the gravest first."""


class Faults:
    """Faults by their place; each is announced once, when it appears."""

    def __init__(self, on_fault: Callable[[str], None] | None) -> None:
        self._on_fault = on_fault
        self._texts: dict[str, str] = {}
        self._lock = threading.Lock()

    def report(self, place: str, text: str) -> None:
        """There is a fault at ``place``; the alarm sounds when there was none before."""
        with self._lock:
            is_new = place not in self._texts
            self._texts[place] = text
        if is_new and self._on_fault is not None:
            try:
                self._on_fault(text)
            except Exception as error:  # an alarm that fails must not end the record's thread
                with self._lock:
                    self._texts["alarm"] = f"the alarm could not be given: {error}"

    def clear(self, place: str) -> None:
        """All is well at ``place`` again."""
        with self._lock:
            self._texts.pop(place, None)

    def texts(self) -> tuple[str, ...]:
        """Every present fault; pictures that are given up come after what harms the night."""
        with self._lock:
            present = dict(self._texts)
        return tuple(present[place] for place in sorted(present, key=_rank))


def _rank(place: str) -> int:
    return _GIVEN_UP.index(place) if place in _GIVEN_UP else -1
