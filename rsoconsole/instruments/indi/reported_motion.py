"""Measurement of a mount's motion from its driver's reports, by a plain connection.

INDI's base class reports coordinates only when they change: the driver of a tracking mount is
silent. So coordinates are requested during the silence; unchanged coordinates count as measured
only where the driver answers and does not report the state Alert.
"""

import math
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rsoconsole.instruments.indi.indi_wire import OF_DATE
from rsoconsole.instruments.motion import DirectionReport, Motion, MotionMeter
from rsoconsole.sky import hours_to_deg

if TYPE_CHECKING:
    from rsoconsole.instruments.indi.indi_client import Vector
    from rsoconsole.instruments.indi.indi_wire import IndiVector

COORDINATES = OF_DATE
ABORT = "TELESCOPE_ABORT_MOTION"
PARK = "TELESCOPE_PARK"
TRACKING = "TELESCOPE_TRACK_STATE"
POLLING = "POLLING_PERIOD"
SIM_TIME = "SIM_TIME"
POLLING_MS = 500.0
"""Polling period while a mount's motion is measured, ms, where its driver accepts it."""
_ASK_EVERY_S = 0.5
_HUNG_S = 1.0
"""Longest delay of an answer, s; a slower driver has not polled its mount meanwhile."""
_PERIODS_S = (0.05, 30.0)
_INTERVALS = 9
_INTERVAL_S = (0.2, 10.0)
_NS = 1e9


class ReportedMotion:
    """Meter of one mount's motion, which reads the mount's INDI vectors.

    Thread-safe. Times are those of the observatory where vectors SIM_TIME come (a simulated
    observatory, which reports its time before the coordinates), else those of the monotonic
    clock.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._meter = MotionMeter()
        self._lock = threading.Lock()
        self._sim_s: float | None = None
        self._last_message_s = self._asked_s = self._reported_s = self._changed_s = -math.inf
        self._apart_s: deque[float] = deque(maxlen=_INTERVALS)
        """Intervals between changes that the driver reported by itself."""
        self._is_base_defined = False
        """True while the only report is the first definition."""
        self._unanswered_s: float | None = None
        """Time since which a request is unanswered; None: none is."""
        self._knows_period = False
        """True once the polling period is known; until then silence proves nothing."""
        self.state = ""
        self.polling_ms: float | None = None
        """Polling period that the driver reports; None where it reports none."""

    def take(self, vector: "Vector | IndiVector") -> None:
        """Add one vector of the mount's driver; ignore it where it is not needed."""
        with self._lock:
            now_s = self._now_s()
            if vector.name == POLLING:
                self._take_polling(vector.values)
            elif vector.name == SIM_TIME:
                self._take_sim_time(vector.values)
            elif vector.name == COORDINATES:
                self._take_coordinates(vector, now_s)

    def begin(self) -> None:
        """Ignore the reports before this instant, because an order is sent to the mount now."""
        with self._lock:
            self._meter.begin_at(self._now_s() if self._sim_s is None else self._sim_s)

    def reset_after_delay(self) -> None:
        """Ignore earlier reports, because this program has paused reading.

        The next reports may have been sent long ago. Does nothing in a simulated observatory.
        """
        if self._sim_s is None:
            self.begin()

    def motion(self) -> Motion:
        """Return the motion as measured up to now."""
        with self._lock:
            if self.state == "Alert":
                return Motion()
            return self._meter.motion(self._now_s() if self._sim_s is None else self._sim_s)

    @property
    def has_recent_report(self) -> bool:
        """True where the driver has sent coordinates without a request during the measured span."""
        with self._lock:
            return (
                self._now_s() - self._reported_s
                <= self._meter.measuring_span_s + self._meter.period_s
            )

    def wants_word(self) -> bool:
        """Return True when the caller must now request coordinates, because the driver is silent.

        A call that returns True counts as the request.
        """
        with self._lock:
            now_s = self._now_s()
            if (
                self._sim_s is not None
                or now_s - max(self._last_message_s, self._asked_s) < _ASK_EVERY_S
            ):
                return False
            self._asked_s = now_s
            if self._unanswered_s is None:
                self._unanswered_s = now_s
            return True

    def _take_sim_time(self, values: Mapping[str, Any]) -> None:
        value = _number(values.get("UTC_NS", ""))
        if value is None:
            return
        if self._sim_s is None:
            self._meter = MotionMeter(0.0)
        self._sim_s = value / _NS

    def _take_polling(self, values: Mapping[str, Any]) -> None:
        value = _number(values.get("PERIOD_MS", ""))
        if value is not None and value > 0.0 and self._sim_s is None:
            self.polling_ms, self._knows_period = value, True
            self._meter.period_s = min(max(value / 1e3, _PERIODS_S[0]), _PERIODS_S[1])

    def _estimate_period(self, now_s: float) -> None:
        """Estimate a driver's polling period, where it reports none, from a mount that moves."""
        apart_s, self._changed_s = now_s - self._changed_s, now_s
        if self.polling_ms is not None or self._sim_s is not None:
            return
        if not _INTERVAL_S[0] <= apart_s <= _INTERVAL_S[1]:
            return  # told with an order's answer, or after a long rest
        self._apart_s.append(apart_s)
        if len(self._apart_s) >= _INTERVALS // 2:
            self._knows_period = True
            self._meter.period_s = max(_PERIODS_S[0], statistics.median(self._apart_s))

    def _take_coordinates(self, vector: "Vector | IndiVector", now_s: float) -> None:
        was_busy, self._last_message_s = self.state == "Busy", now_s
        if was_busy is not (vector.state == "Busy"):
            # Where it was on its way here tells nothing of how it moves from now on.
            self._meter.begin_at(now_s if self._sim_s is None else self._sim_s)
        self.state = vector.state
        asked_s, self._unanswered_s = self._unanswered_s, None
        has_hung = asked_s is not None and now_s - asked_s > _HUNG_S
        if has_hung:
            # It may answer before it has looked again: what it knows is of long ago.
            self._meter.begin_at(now_s)
            if vector.is_definition:
                return
        ra_hours, dec_deg = (_number(vector.values.get(name, "")) for name in ("RA", "DEC"))
        if ra_hours is None or dec_deg is None or vector.state == "Alert":
            return
        if self._sim_s is not None and vector.is_definition:
            return
        t_s = now_s if self._sim_s is None else self._sim_s
        ra_deg, last = hours_to_deg(ra_hours), self._meter.last_report
        is_same = last is not None and (last.ra_deg, last.dec_deg) == (ra_deg, dec_deg)
        if not vector.is_definition:
            self._reported_s = now_s
            if not is_same:
                self._estimate_period(now_s)
        if is_same:
            # Said again, because it was asked for or with another state: of its last look.
            self._is_base_defined = False
            if not vector.is_definition or self._knows_period:
                self._meter.hold(t_s, now_s)
            return
        if self._is_base_defined:
            self._meter.drop_reports()  # a driver that has just connected may not have looked yet
        self._is_base_defined = last is None and vector.is_definition
        if self._is_base_defined:
            t_s -= self._meter.period_s
        report = DirectionReport(t_s=t_s, host_s=now_s, ra_deg=ra_deg, dec_deg=dec_deg)
        self._meter.add(report)


def _number(text: Any) -> float | None:
    """Number in INDI's notation, decimal or sexagesimal; None where it is none."""
    try:
        return float(text)
    except (TypeError, ValueError):
        pass
    parts = str(text).replace(":", " ").replace(";", " ").split()
    try:
        figures = [abs(float(part)) for part in parts]
    except ValueError:
        return None
    if not 2 <= len(figures) <= 3:
        return None
    size = sum(figure / 60.0**place for place, figure in enumerate(figures))
    return -size if parts[0].startswith("-") else size
