"""The present faults in words; an order, a finished frame or the mount's answer ends them."""

from rsoconsole.engine.aim.states import Authority, Stopped
from rsoconsole.engine.tasks.watch import Watch


class Faults:
    """The present faults, and a STOP that the mount did not obey."""

    def __init__(self) -> None:
        self._words: list[str] = []
        self._was_blind = False
        """True where the mount has been silent since the fault."""
        self._stop: tuple[Stopped, int] | None = None
        """A STOP that the mount did not obey, and when that was known, UTC ns."""

    @property
    def words(self) -> tuple[str, ...]:
        """The present faults, each in words."""
        return tuple(self._words)

    def add(self, words: str) -> bool:
        """Add a fault; return False where it is present already."""
        if words in self._words:
            return False
        self._words.append(words)
        return True

    def clear(self) -> None:
        """Forget all faults."""
        self._words.clear()
        self._was_blind, self._stop = False, None

    def add_disobeyed_stop(self, stopped: Stopped, words: str, now_utc_ns: int) -> None:
        """Add a disobeyed STOP; it stays a fault until the mount is measured to be at rest.

        ``words``: the fault, which replaces all others.
        """
        self._words, self._stop = [words], (stopped, now_utc_ns)

    def take_stop(self, watch: Watch) -> Stopped | None:
        """Return a disobeyed STOP once the mount is measured at rest, and drop it; else None."""
        report = watch.last_report
        if self._stop is None or watch.is_blind or report is None:
            return None
        stopped, since_ns = self._stop
        if report.t_utc_ns <= since_ns or report.is_slewing or not report.motion.is_at_rest:
            return None
        self._stop = None
        return stopped

    def is_over(self, authority: Authority, watch: Watch) -> bool:
        """True once, when a mount that was silent during a FAULT answers again."""
        if authority.state != "FAULT" or authority.is_stopped or not self._words:
            self._was_blind = False
            return False
        if watch.is_blind:
            self._was_blind = True
            return False
        was_blind, self._was_blind = self._was_blind, False
        return was_blind
