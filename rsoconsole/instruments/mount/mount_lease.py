"""How long a mount may go unwatched: a rule without I/O, its clocks are arguments.

Two promises: a slew that nobody watches is ended, and tracking ends at the instant at which it
would run into a limit. Both are kept by the mount's own process, whatever becomes of the engine.
"""


class Lease:
    """The watch over one mount; nothing applies before the first slew or ``keep``."""

    def __init__(self, lease_s: float) -> None:
        """``lease_s``: wall seconds without any order after which a slew counts as unwatched."""
        self.lease_s = lease_s
        self._ends_s: float | None = None
        self._limit_utc_ns: int | None = None
        self._done_utc_ns: int | None = None

    def begin(self, now_s: float, lease_s: float | None = None) -> None:
        """A slew was ordered, or an engine says that it watches; ``now_s``: monotonic time."""
        if lease_s is not None:
            self.lease_s = lease_s
        self._ends_s = now_s + self.lease_s

    def renew(self, now_s: float) -> None:
        """Any other order came: what gave it is alive."""
        if self._ends_s is not None:
            self._ends_s = now_s + self.lease_s

    def has_lapsed(self, now_s: float) -> bool:
        """Whether nobody has been heard of for too long."""
        return self._ends_s is not None and now_s >= self._ends_s

    def unwatched_s(self, now_s: float) -> float:
        """For how long nobody has been heard of; 0 before the first slew."""
        return 0.0 if self._ends_s is None else max(0.0, now_s - self._ends_s + self.lease_s)

    def set_limit(self, track_until_utc_ns: int | None) -> None:
        """The instant at which tracking is to end, in place of the one before; None: no such."""
        self._limit_utc_ns = track_until_utc_ns

    def open_limit_utc_ns(self) -> int | None:
        """The instant still to come or to be acted on; None where there is none."""
        return None if self._limit_utc_ns == self._done_utc_ns else self._limit_utc_ns

    def is_past_limit(self, now_utc_ns: int) -> bool:
        """Whether tracking is to be ended now; no longer once ``close_limit`` said it was."""
        limit_utc_ns = self.open_limit_utc_ns()
        return limit_utc_ns is not None and now_utc_ns >= limit_utc_ns

    def close_limit(self) -> None:
        """Tracking has been ended for the present limit: who then starts it again is let be."""
        self._done_utc_ns = self._limit_utc_ns
