"""Rule for how long a mount may go unwatched; without I/O, its clocks are arguments.

A slew that no engine watches is ended, and tracking ends at the instant at which it would run into
a limit. The mount's own process does both, even where the engine has died or hangs.
"""


class Lease:
    """Lease of one mount; nothing applies before the first slew or ``MountWatch.keep``."""

    def __init__(self, lease_s: float) -> None:
        """``lease_s``: wall seconds without any order after which a slew counts as unwatched."""
        self.lease_s = lease_s
        self._ends_s: float | None = None
        self._limit_utc_ns: int | None = None
        self._done_utc_ns: int | None = None

    def begin(self, now_s: float, lease_s: float | None = None) -> None:
        """Begin the lease at ``now_s`` (monotonic); ``lease_s``: its new length; None: as
        before.
        """
        if lease_s is not None:
            self.lease_s = lease_s
        self._ends_s = now_s + self.lease_s

    def renew(self, now_s: float) -> None:
        """Extend a lease that has begun, because any other order shows that the engine is alive."""
        if self._ends_s is not None:
            self._ends_s = now_s + self.lease_s

    def has_lapsed(self, now_s: float) -> bool:
        """Return True where no order has come for the length of a lease that has begun."""
        return self._ends_s is not None and now_s >= self._ends_s

    def unwatched_s(self, now_s: float) -> float:
        """Return the time since the last order, s; 0 before the first slew."""
        return 0.0 if self._ends_s is None else max(0.0, now_s - self._ends_s + self.lease_s)

    def set_limit(self, track_until_utc_ns: int | None) -> None:
        """Set the instant at which tracking must end, in place of the present one; None: no
        limit.
        """
        self._limit_utc_ns = track_until_utc_ns

    def open_limit_utc_ns(self) -> int | None:
        """Return the instant at which tracking must end; None without one, or once it is closed."""
        return None if self._limit_utc_ns == self._done_utc_ns else self._limit_utc_ns

    def is_past_limit(self, now_utc_ns: int) -> bool:
        """Return True where tracking must be ended now: the limit is past and not yet closed."""
        limit_utc_ns = self.open_limit_utc_ns()
        return limit_utc_ns is not None and now_utc_ns >= limit_utc_ns

    def close_limit(self) -> None:
        """Note that tracking was ended for the present limit, which then no longer applies."""
        self._done_utc_ns = self._limit_utc_ns
