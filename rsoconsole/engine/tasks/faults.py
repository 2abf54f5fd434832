"""Present faults in words, and their end: by an order, or by the mount's own answer."""

from rsoconsole.engine.aim.states import Authority, Stopped
from rsoconsole.engine.tasks.watch import Watch


class Faults:
    """Present faults, and a STOP that was not obeyed."""

    def __init__(self) -> None:
        self._words: list[str] = []
        self._was_blind = False
        """True where the mount has been silent since the fault."""
        self._stop: tuple[Stopped, int] | None = None
        """A STOP that the mount did not obey, and when that was known, UTC ns."""

    @property
    def words(self) -> tuple[str, ...]:
        """Return the words of all present faults."""
        return tuple(self._words)

    def add(self, words: str) -> bool:
        """Add a fault; False where it is known already."""
        if words in self._words:
            return False
        self._words.append(words)
        return True

    def clear(self) -> None:
        """Forget all faults."""
        self._words.clear()
        self._was_blind, self._stop = False, None

    def add_disobeyed_stop(self, stopped: Stopped, words: str, now_utc_ns: int) -> None:
        """Note that a STOP was not obeyed: a fault until the mount is measured to be at rest."""
        self._words, self._stop = [words], (stopped, now_utc_ns)

    def take_stop(self, watch: Watch) -> Stopped | None:
        """Return the STOP that was not obeyed, once the mount is measured to be at rest; else
        None."""
        report = watch.last_report
        if self._stop is None or watch.is_blind or report is None:
            return None
        stopped, since_ns = self._stop
        if report.t_utc_ns <= since_ns or report.is_slewing or not report.motion.is_at_rest:
            return None
        self._stop = None
        return stopped

    def is_over(self, authority: Authority, watch: Watch) -> bool:
        """True once, when the mount whose silence was the cause of a FAULT answers again."""
        if authority.state != "FAULT" or authority.is_stopped or not self._words:
            self._was_blind = False
            return False
        if watch.is_blind:
            self._was_blind = True
            return False
        was_blind, self._was_blind = self._was_blind, False
        return was_blind
