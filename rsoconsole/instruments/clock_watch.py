"""Finds faults of a machine's clocks by comparing them; readings are arguments, none is taken here.

UTC can be set, monotonic time cannot, and time since boot continues while the machine sleeps. Their
differences distinguish a clock that was set, a clock that runs wrong and a machine that slept. A
long pause between two looks shows a process that stood still.
"""

import datetime
from dataclasses import dataclass

from rsoconsole.instruments.ports import ClockFault

_NS = 1_000_000_000
MIN_STEP_S = 0.1
"""Smallest step of UTC that counts; a geostationary satellite moves 1.5 arcsec in it."""
MAX_DRIFT = 1e-3
"""Largest drift of a sound clock, seconds per second: time services slew by half of that."""
DRIFT_WINDOW_S = 60.0
"""Time over which drift accumulates before the reference readings are renewed."""
REPEAT_WITHIN_S = 2.0
"""Longest time between steps of equal size that count as a clock that runs wrong."""
MIN_APART_S = 0.02
"""Shortest time between two looks that is used to compute a clock's rate."""
MAX_PACE = 10.0
"""Largest drift, s/s, of a clock that runs wrong; beyond it the clock counts as set."""
STEADY_S = 10.0
"""Time that a clock must run right before it is trusted again."""
MIN_SLEEP_S = 0.5
MIN_PAUSE_S = 5.0
"""Shortest pause between two looks that counts as a process that stood still."""
_READ_S = 0.01
"""Longest time between reading one clock and reading another."""
_MIDNIGHT_S = 5.0
_LEAP_S = 1.0
_LEAP_MONTHS = (1, 7)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockReadings:
    """One machine's clocks, read at the same instant."""

    utc_ns: int
    monotonic_ns: int
    boottime_ns: int
    """Time since boot, which continues while the machine sleeps."""


class ClockWatch:
    """Finds clock faults in successive readings, a few a second."""

    def __init__(self, first: ClockReadings) -> None:
        self._last = self._reference = first
        self._paced: tuple[ClockReadings, float] | None = None
        """Readings when the clock was last found to be off, and its drift then, s/s; else None."""
        self._unsteady_since: ClockReadings | None = None
        self._steady_since = first

    @property
    def is_steady(self) -> bool:
        """True while the clock runs at the right rate; False while it runs wrong."""
        return self._unsteady_since is None

    def find_faults(self, now: ClockReadings) -> tuple[ClockFault, ...]:
        """Return the faults between the last readings and ``now``, in order."""
        last, self._last = self._last, now
        found = [self._time_fault(last, now)]
        stood_s = (now.monotonic_ns - last.monotonic_ns) / _NS
        slept_s = _since_s(last, now) - stood_s
        if slept_s > MIN_SLEEP_S:
            found.append(ClockFault(kind="slept", seconds=slept_s))
        if stood_s > MIN_PAUSE_S:
            found.append(ClockFault(kind="stood still", seconds=stood_s))
        return tuple(each for each in found if each is not None)

    def _time_fault(self, last: ClockReadings, now: ClockReadings) -> ClockFault | None:
        if self._unsteady_since is not None:
            return self._while_unsteady(self._unsteady_since, now)
        off_s = _offset_s(now) - _offset_s(self._reference)
        since_s = _since_s(self._reference, now)
        if abs(off_s) > MIN_STEP_S + MAX_DRIFT * since_s:
            return self._moved(last, now, off_s)
        if since_s > DRIFT_WINDOW_S:
            self._reference = now
        return None

    def _moved(self, last: ClockReadings, now: ClockReadings, off_s: float) -> ClockFault:
        """Classify an offset: by one step, or little by little."""
        start, self._reference = self._reference, now
        step_s = _offset_s(now) - _offset_s(last)
        pace = step_s / max(_since_s(last, now), MIN_APART_S)
        before, self._paced = self._paced, (now, pace)
        is_again = (
            before is not None
            and _since_s(before[0], now) <= REPEAT_WITHIN_S
            and abs(pace - before[1]) < 0.5 * abs(pace)
            and abs(pace) < MAX_PACE
        )
        if is_again or abs(step_s) < 0.5 * abs(off_s):
            self._unsteady_since, self._steady_since = start, now
            return ClockFault(kind="runs wrong", seconds=off_s, rate=1.0 + pace)
        is_leap = abs(abs(off_s) - _LEAP_S) < MIN_STEP_S and _is_leap_instant(last, now)
        return ClockFault(kind="leap second" if is_leap else "set", seconds=off_s)

    def _while_unsteady(self, begun: ClockReadings, now: ClockReadings) -> ClockFault | None:
        steady_s = _since_s(self._steady_since, now)
        moved_s = _offset_s(now) - _offset_s(self._steady_since)
        if abs(moved_s) > MAX_DRIFT * steady_s + _READ_S:
            self._steady_since = now
            return None
        if steady_s < STEADY_S:
            return None
        self._unsteady_since = self._paced = None
        self._reference = now
        return ClockFault(kind="runs right", seconds=_offset_s(now) - _offset_s(begun))


def _offset_s(at: ClockReadings) -> float:
    return (at.utc_ns - at.boottime_ns) / _NS


def _since_s(before: ClockReadings, now: ClockReadings) -> float:
    return (now.boottime_ns - before.boottime_ns) / _NS


def _is_leap_instant(last: ClockReadings, now: ClockReadings) -> bool:
    """True where one of the two is just beside the first midnight of a half year."""
    for utc_ns in (last.utc_ns, now.utc_ns):
        near = datetime.datetime.fromtimestamp(utc_ns / _NS + _MIDNIGHT_S, datetime.UTC)
        seconds = near.hour * 3600 + near.minute * 60 + near.second
        if near.day == 1 and near.month in _LEAP_MONTHS and seconds <= 2 * _MIDNIGHT_S:
            return True
    return False
