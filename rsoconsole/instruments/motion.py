"""Motion of a mount, measured from the directions that it reports and from nothing else.

A driver's Idle, parked or tracking is a claim. What counts are the coordinates over a span of time,
as rates of the two coordinates, right ascension and declination of date: a mount that tracks keeps
both, one that stands gains 15.04 arcsec of right ascension a second, at the pole too.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

MotionKind = Literal["stands", "tracks", "moves", "unknown"]

SIDEREAL_ARCSEC_S = 15.041067
"""Rate of the right ascension of a mount that stands still."""
STEPS_ARCSEC: tuple[float, ...] = (1.5, 15.0, 90.0)
"""Steps of reported right ascensions: INDI's base class reports changes of 1.5; drivers that read
seconds, or tenths of a minute, have no finer ones."""
MIN_SPAN_S, MIN_HOST_SPAN_S = 2.0, 1.5
MIN_REPORTS = 3
MAX_WIDTH_ARCSEC_S = 10.0
"""Largest width of the interval of possible rates at which a motion is named."""
REST_TOLERANCE_ARCSEC_S = 2.5
"""Largest difference of a rate from a rest that counts as one: a lunar rate, a drift of a bad
alignment."""
REPORT_DELAY_S = 0.1
"""Largest delay of one report against another."""
HOST_DELAY_S = 1.0
"""Delay of a report on a busy machine: a change that this alone explains is no motion, and no
rest."""
UNKNOWN_PERIOD_S = 2.0
"""Polling period assumed of a driver that does not report it."""
DRIFT_SPANS = 3.0
"""Number of spans over which a slow drift is measured before it is named."""
FAST_DEG_S = 0.02
"""Rate above which a motion is a slew, below which a drift."""
_MIN_APART_S = 0.2
_ON_GRID_ARCSEC = 0.06
_MAX_REPORTS = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """The motion of a mount, by the directions that it reports."""

    kind: MotionKind = "unknown"
    ra_rate_arcsec_s: float = 0.0
    """Rate of the right ascension (not times cos declination): 0 where it tracks, 15.04 at rest."""
    dec_rate_arcsec_s: float = 0.0
    host_since_s: float = field(default=math.inf, compare=False)
    """Host's time of the first report that shows the kind "moves"."""

    @property
    def is_at_rest(self) -> bool:
        """True when the mount is measured to stand or to track."""
        return self.kind in ("stands", "tracks")

    @property
    def rate_deg_s(self) -> float:
        """Rate of the faster axis in its coordinate, degrees a second."""
        return max(abs(self.ra_rate_arcsec_s), abs(self.dec_rate_arcsec_s)) / 3600.0

    @property
    def is_fast(self) -> bool:
        """True for a slew, False for a drift."""
        return self.kind == "moves" and self.rate_deg_s > FAST_DEG_S


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionReport:
    """A direction as the mount reported it, epoch of date."""

    t_s: float
    """Time by the clock in which the mount moves."""
    host_s: float
    """Time by the host's clock, which differs where the observatory is simulated."""
    ra_deg: float
    dec_deg: float


class MotionMeter:
    """Measures motion from reports; pure: its clocks are arguments. Not safe for several
    threads."""

    def __init__(self, period_s: float = UNKNOWN_PERIOD_S) -> None:
        """``period_s``: the driver's polling period."""
        self.period_s = period_s
        self._reports: deque[DirectionReport] = deque(maxlen=_MAX_REPORTS)
        self._since_s = -math.inf
        self._step_arcsec = STEPS_ARCSEC[-1]
        self._known: Motion | None = None
        """Motion by the present reports; None: not computed yet."""

    @property
    def span_s(self) -> float:
        """Span of reports, in seconds, from which a motion is named."""
        return max(MIN_SPAN_S, 3.0 * self.period_s, _min_span_s(self._step_arcsec))

    @property
    def last(self) -> DirectionReport | None:
        """Latest report."""
        return self._reports[-1] if self._reports else None

    def begin_at(self, t_s: float) -> None:
        """Note that an order goes out: earlier reports no longer show the present motion."""
        self._since_s, self._known = t_s, None

    def forget(self) -> None:
        """Drop all reports: they are no places of this mount."""
        self._reports.clear()
        self._known = None

    def add(self, report: DirectionReport) -> None:
        """Add the next report."""
        if not (math.isfinite(report.ra_deg) and math.isfinite(report.dec_deg)):
            return
        if self._reports and report.t_s <= self._reports[-1].t_s:
            if report.t_s < self._reports[-1].t_s:
                self._reports.clear()  # its clock was set
                self._since_s = -math.inf
            else:
                self._reports.pop()
        self._step_arcsec = min(self._step_arcsec, _report_step_arcsec(report.ra_deg))
        self._reports.append(report)
        self._known = None

    def hold(self, t_s: float, host_s: float) -> None:
        """Note that the driver has answered at ``t_s``, and nothing has changed since its last
        report.

        Its values may be as old as its last poll of the mount.
        """
        last, held_s = self.last, t_s - self.period_s
        if last is not None and held_s > last.t_s:
            at_host_s = max(last.host_s, host_s - self.period_s)
            same = DirectionReport(
                t_s=held_s, host_s=at_host_s, ra_deg=last.ra_deg, dec_deg=last.dec_deg
            )
            self.add(same)

    def motion(self, t_s: float) -> Motion:
        """Motion at ``t_s``; unknown where the reports since the last order do not determine it.

        A rest is named where, of all constant rates, those that pass every report of the span
        within half its step are so few that there is no room for another motion (set membership:
        Milanese and Vicino 1991, Automatica 27, 997).
        """
        if not self._reports or t_s - self._reports[-1].t_s > self.span_s + self.period_s:
            return Motion()
        if self._known is None:
            self._known = self._measure()
        return self._known

    def _measure(self) -> Motion:
        # Reports may be coarser than they look: a driver may have turned them to another epoch.
        steps = [step for step in STEPS_ARCSEC if step >= self._step_arcsec][:2]
        longest_s = DRIFT_SPANS * max(self.span_s, _min_span_s(steps[-1]))
        begins_s = self._reports[-1].t_s - longest_s - 2.0 * self.period_s
        begins_host_s = self._reports[-1].host_s - 2.0 * MIN_HOST_SPAN_S
        reports = [
            each
            for each in self._reports
            if each.t_s >= self._since_s and (each.t_s >= begins_s or each.host_s >= begins_host_s)
        ]
        if not reports:
            return Motion()
        path = _Path(reports)
        fast = path.fast(self._step_arcsec)
        if fast is not None:
            return fast
        for step in steps:
            span_s = max(self.span_s, _min_span_s(step))
            named = path.last(span_s).named(step)
            if named is None:
                continue
            if named.kind != "moves":
                return named
            # A drift that small may be a machine that is held up more and more.
            lasting = path.last(DRIFT_SPANS * span_s).named(step)
            return lasting if lasting is not None and lasting.kind == "moves" else Motion()
        wandering = path.last(self.span_s).wandering(self._step_arcsec)
        # It may have come to rest since.
        late = path.last(self.span_s / 2.0, MIN_HOST_SPAN_S / 2.0).wandering(self._step_arcsec)
        return wandering if late.kind == "moves" else Motion()


class _Path:
    """Reports in order: seconds, arcseconds of right ascension without a jump, of declination."""

    def __init__(self, reports: Sequence[DirectionReport]) -> None:
        self._reports = reports
        self._t_s = [each.t_s for each in reports]
        self._dec = [each.dec_deg * 3600.0 for each in reports]
        ra_deg, self._ra = reports[0].ra_deg if reports else 0.0, list[float]()
        for each in reports:
            ra_deg += (each.ra_deg - ra_deg + 180.0) % 360.0 - 180.0
            self._ra.append(ra_deg * 3600.0)

    def last(self, span_s: float, host_span_s: float = MIN_HOST_SPAN_S) -> "_Path":
        """Shortest end of the path that lasts so long; empty where the path is shorter."""
        for index in range(len(self._t_s) - MIN_REPORTS, -1, -1):
            host_s = self._reports[-1].host_s - self._reports[index].host_s
            if self._t_s[-1] - self._t_s[index] >= span_s - 1e-6 and host_s >= host_span_s:
                return _Path(self._reports[index:])
        return _Path(())

    def fast(self, step_arcsec: float) -> Motion | None:
        """Slew, which shows in two reports; None for none."""
        last = len(self._t_s) - 1
        for index in range(last - 1, -1, -1):
            span_s = self._t_s[last] - self._t_s[index]
            if span_s < _MIN_APART_S:
                continue
            ra = self._ra[last] - self._ra[index]
            dec = self._dec[last] - self._dec[index]
            motion = Motion(
                kind="moves",
                ra_rate_arcsec_s=ra / span_s,
                dec_rate_arcsec_s=dec / span_s,
                host_since_s=self._reports[index].host_s,
            )
            slack = step_arcsec + HOST_DELAY_S * SIDEREAL_ARCSEC_S
            off = max(min(abs(ra), abs(ra - SIDEREAL_ARCSEC_S * span_s)), abs(dec))
            return motion if off > slack and motion.is_fast else None
        return None

    def named(self, step_arcsec: float) -> Motion | None:
        """Motion at a constant rate; None where no rate passes, or too many do."""
        if not self._t_s:
            return None
        room = step_arcsec + REPORT_DELAY_S * SIDEREAL_ARCSEC_S
        ra, dec = _rate_bounds(self._t_s, self._ra, room), _rate_bounds(self._t_s, self._dec, room)
        if max(ra[1] - ra[0], dec[1] - dec[0]) > MAX_WIDTH_ARCSEC_S or not (
            ra[0] <= ra[1] and dec[0] <= dec[1]
        ):
            return None
        kind: MotionKind = "moves"
        if _is_rate_allowed(dec, 0.0):
            if _is_rate_allowed(ra, 0.0):
                kind = "tracks"
            elif _is_rate_allowed(ra, SIDEREAL_ARCSEC_S):
                kind = "stands"
        return Motion(kind=kind, ra_rate_arcsec_s=sum(ra) / 2.0, dec_rate_arcsec_s=sum(dec) / 2.0)

    def wandering(self, step_arcsec: float) -> Motion:
        """Motion at no constant rate, where neither rest explains it; else unknown."""
        if not self._t_s:
            return Motion()
        standing = [ra - SIDEREAL_ARCSEC_S * t for t, ra in zip(self._t_s, self._ra, strict=True)]
        is_off = min(_spread(self._ra), _spread(standing)) > (
            step_arcsec + HOST_DELAY_S * SIDEREAL_ARCSEC_S
        ) or _spread(self._dec) > 2.0 * (step_arcsec + REPORT_DELAY_S * SIDEREAL_ARCSEC_S)
        if not is_off:
            return Motion()
        span_s = self._t_s[-1] - self._t_s[0]
        return Motion(
            kind="moves",
            ra_rate_arcsec_s=(self._ra[-1] - self._ra[0]) / span_s,
            dec_rate_arcsec_s=(self._dec[-1] - self._dec[0]) / span_s,
            host_since_s=self._reports[0].host_s,
        )


def _rate_bounds(t_s: Sequence[float], x: Sequence[float], room: float) -> tuple[float, float]:
    """Least and largest rate of lines that pass all places within half of ``room``."""
    low, high = -math.inf, math.inf
    for j in range(1, len(t_s)):
        for i in range(j):
            apart_s = t_s[j] - t_s[i]
            low = max(low, (x[j] - x[i] - room) / apart_s)
            high = min(high, (x[j] - x[i] + room) / apart_s)
    return low, high


def _is_rate_allowed(rates: tuple[float, float], rate: float) -> bool:
    """True where a rate passes, or lies beside the middle of the rates that do."""
    is_within = rates[0] <= rate <= rates[1]
    return is_within or abs(sum(rates) / 2.0 - rate) <= REST_TOLERANCE_ARCSEC_S


def _spread(x: Sequence[float]) -> float:
    return max(x) - min(x)


def _min_span_s(step_arcsec: float) -> float:
    """Least span of reports in such steps, seconds."""
    return 2.0 * step_arcsec / (MAX_WIDTH_ARCSEC_S / 2.0)


def _report_step_arcsec(ra_deg: float) -> float:
    """Coarsest step of which this right ascension is a multiple."""
    arcsec = ra_deg * 3600.0
    for step in reversed(STEPS_ARCSEC[1:]):
        if abs(arcsec - round(arcsec / step) * step) < _ON_GRID_ARCSEC:
            return step
    return STEPS_ARCSEC[0]


AfterStop = Literal["track", "stand still"]


def tracking_after_stop(
    after_stop: AfterStop,
    *,
    was_slewing: bool,
    was_parking: bool,
    was_tracking: bool,
    is_parked: bool,
) -> bool | None:
    """Tracking state to order; None: leave it as it is.

    A slew ends in tracking, so that one that was cut short counts as tracking, though drivers
    report "not tracking" meanwhile. A slew to the park position does not.
    """
    if is_parked:
        return None
    if after_stop == "stand still":
        return False
    if was_parking:
        return None
    return True if was_slewing or was_tracking else None


MOVES_AFTER_S = 4.5
"""Time after a STOP before which a motion that goes on may be the mount's braking."""
BRAKES_FOR_S = 2.5
"""Time in which a mount slows down: reports of it do not show the present motion."""
UNKNOWN_AFTER_S = 10.0
REPEAT_S = 1.0
REPEATS_FOR_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StopStep:
    """Result of one look at a STOP: send ABORT again, report news, or end."""

    sends_abort: bool = False
    news: Motion | None = None
    """Motion to report, when its kind has changed."""
    is_over: bool = False
    """True at rest, or when ABORT has been repeated long enough: the alarm stays."""


class StopMeasure:
    """One STOP from its first ABORT on; ABORT is repeated while the mount is measured to move, or
    while its driver has not answered and nothing is known."""

    def __init__(self, began_s: float) -> None:
        self.began_s = began_s
        self._aborted_s = began_s
        self._last: Motion | None = None
        self.is_over = False

    def step(self, now_s: float, motion: Motion, *, is_answered: bool) -> StopStep:
        """Look once; ``is_answered``: the driver has accepted ABORT."""
        since_s = now_s - self.began_s
        is_braking = motion.kind == "moves" and motion.host_since_s < self.began_s + BRAKES_FOR_S
        news = self._news(since_s, Motion() if is_braking else motion)
        if news is not None:
            self._last = news
        self.is_over = motion.is_at_rest or since_s >= REPEATS_FOR_S
        must_repeat = motion.kind == "moves" or (motion.kind == "unknown" and not is_answered)
        sends = must_repeat and not self.is_over and now_s - self._aborted_s >= REPEAT_S
        if sends:
            self._aborted_s = now_s
        return StopStep(sends_abort=sends, news=news, is_over=self.is_over)

    def _news(self, since_s: float, motion: Motion) -> Motion | None:
        last = None if self._last is None else self._last.kind
        if motion.kind == last:
            return None
        if motion.kind == "moves" and since_s < MOVES_AFTER_S:
            return None
        # Once it was seen to move, a moment of doubt is no news.
        if motion.kind == "unknown" and (since_s < UNKNOWN_AFTER_S or last is not None):
            return None
        return motion
