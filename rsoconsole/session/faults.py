"""What is wrong with the record at this moment, in words."""

import threading
from collections.abc import Callable


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
        """Every present fault."""
        with self._lock:
            return tuple(self._texts.values())
