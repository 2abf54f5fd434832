"""Measurement of a mount's motion, only from the directions that its driver reports.

A driver may wrongly call a mount idle, parked or tracking. So the change of right ascension and
declination of date over a span of time is used: a tracking mount keeps both, a mount at rest gains
15.04 arcsec of right ascension a second, at the pole too.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

MotionKind = Literal["stands", "tracks", "moves", "unknown"]

SIDEREAL_ARCSEC_S = 15.041067
"""Rate of the right ascension of a mount that stands still, arcsec/s."""
STEPS_ARCSEC: tuple[float, ...] = (1.5, 15.0, 90.0)
"""Steps of reported right ascensions, arcsec: INDI's base class, seconds, tenths of a minute."""
MIN_SPAN_S, MIN_HOST_SPAN_S = 2.0, 1.5
MIN_REPORTS = 3
MAX_WIDTH_ARCSEC_S = 10.0
"""Largest uncertainty of a rate (width of its interval) at which a motion is named."""
REST_TOLERANCE_ARCSEC_S = 2.5
"""Largest difference of a rate from a rest that counts as one, arcsec/s."""
REPORT_DELAY_S = 0.1
"""Largest delay of one report relative to another."""
HOST_DELAY_S = 1.0
"""Delay of a report on a busy machine, s: a change that it explains is no motion, and no rest."""
UNKNOWN_PERIOD_S = 2.0
"""Polling period assumed where the driver does not report it."""
DRIFT_SPANS = 3.0
"""Number of spans over which a slow drift must last before it is named."""
FAST_DEG_S = 0.02
"""Rate above which a motion is a slew, up to which it is a drift."""
_MIN_APART_S = 0.2
_ON_GRID_ARCSEC = 0.06
_MAX_REPORTS = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion of a mount, measured from the directions that it reports."""

    kind: MotionKind = "unknown"
    ra_rate_arcsec_s: float = 0.0
    """Rate of the right ascension (not times cos Dec): 0 while tracking, 15.04 at rest."""
    dec_rate_arcsec_s: float = 0.0
    host_since_s: float = field(default=math.inf, compare=False)
    """Host's time of the first report that shows the kind "moves"."""

    @property
    def is_at_rest(self) -> bool:
        """True where the measured motion is that of a mount that stands still or tracks."""
        return self.kind in ("stands", "tracks")

    @property
    def rate_deg_s(self) -> float:
        """Rate of the faster of the two coordinates, deg/s."""
        return max(abs(self.ra_rate_arcsec_s), abs(self.dec_rate_arcsec_s)) / 3600.0

    @property
    def is_fast(self) -> bool:
        """True for a slew; False for a drift, for rest and where nothing is known."""
        return self.kind == "moves" and self.rate_deg_s > FAST_DEG_S


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionReport:
    """One direction that the mount reported, in coordinates of date."""

    t_s: float
    """Time by the clock of the mount's world: simulated time in a simulated observatory."""
    host_s: float
    """Time by the host's clock; equal to ``t_s`` unless the observatory is simulated."""
    ra_deg: float
    dec_deg: float


class MotionMeter:
    """Measures motion from reports; its clocks are arguments. Not thread-safe."""

    def __init__(self, period_s: float = UNKNOWN_PERIOD_S) -> None:
        """``period_s``: the driver's polling period."""
        self.period_s = period_s
        self._reports: deque[DirectionReport] = deque(maxlen=_MAX_REPORTS)
        self._since_s = -math.inf
        self._step_arcsec = STEPS_ARCSEC[-1]
        self._known: Motion | None = None
        """Motion by the present reports; None: not computed yet."""

    @property
    def measuring_span_s(self) -> float:
        """Length of the span of reports from which the kind of motion is determined, s."""
        return max(MIN_SPAN_S, 3.0 * self.period_s, _min_span_s(self._step_arcsec))

    @property
    def last_report(self) -> DirectionReport | None:
        """The latest report; None where there is none."""
        return self._reports[-1] if self._reports else None

    def begin_at(self, t_s: float) -> None:
        """Ignore reports before ``t_s``, the time at which an order is sent to the mount."""
        self._since_s, self._known = t_s, None

    def drop_reports(self) -> None:
        """Drop all reports, because they may not be directions of this mount."""
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
        """Add a report of unchanged coordinates, with which the driver answered at ``t_s``.

        They may be as old as the driver's last poll of the mount, so the report counts as made one
        polling period before ``t_s``. ``host_s``: the instant ``t_s`` by the host's clock.
        """
        last, held_s = self.last_report, t_s - self.period_s
        if last is not None and held_s > last.t_s:
            at_host_s = max(last.host_s, host_s - self.period_s)
            same = DirectionReport(
                t_s=held_s, host_s=at_host_s, ra_deg=last.ra_deg, dec_deg=last.dec_deg
            )
            self.add(same)

    def motion(self, t_s: float) -> Motion:
        """Return the motion at ``t_s``; of kind "unknown" where the reports do not determine it.

        Only reports since the last order count. Reports are coarse, so each allows an interval of
        directions; the constant rates that pass through all intervals of the span are determined
        (set membership: Milanese and Vicino 1991, Automatica 27, 997). The result is standing or
        tracking only where these rates allow no other motion.
        """
        if not self._reports or t_s - self._reports[-1].t_s > self.measuring_span_s + self.period_s:
            return Motion()
        if self._known is None:
            self._known = self._measure()
        return self._known

    def _measure(self) -> Motion:
        # Reports may be coarser than they look: a driver may have turned them to another epoch.
        steps = [step for step in STEPS_ARCSEC if step >= self._step_arcsec][:2]
        longest_s = DRIFT_SPANS * max(self.measuring_span_s, _min_span_s(steps[-1]))
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
            span_s = max(self.measuring_span_s, _min_span_s(step))
            named = path.last(span_s).named(step)
            if named is None:
                continue
            if named.kind != "moves":
                return named
            # A drift that small may be a machine that is held up more and more.
            lasting = path.last(DRIFT_SPANS * span_s).named(step)
            return lasting if lasting is not None and lasting.kind == "moves" else Motion()
        wandering = path.last(self.measuring_span_s).wandering(self._step_arcsec)
        # It may have come to rest since.
        late = path.last(self.measuring_span_s / 2.0, MIN_HOST_SPAN_S / 2.0).wandering(
            self._step_arcsec
        )
        return wandering if late.kind == "moves" else Motion()


class _Path:
    """Reports in order: time, right ascension unwrapped at 360 deg, declination (s, arcsec)."""

    def __init__(self, reports: Sequence[DirectionReport]) -> None:
        self._reports = reports
        self._t_s = [each.t_s for each in reports]
        self._dec = [each.dec_deg * 3600.0 for each in reports]
        ra_deg, self._ra = reports[0].ra_deg if reports else 0.0, list[float]()
        for each in reports:
            ra_deg += (each.ra_deg - ra_deg + 180.0) % 360.0 - 180.0
            self._ra.append(ra_deg * 3600.0)

    def last(self, span_s: float, host_span_s: float = MIN_HOST_SPAN_S) -> "_Path":
        """Return the shortest part up to the last report that lasts so long; empty for none."""
        for index in range(len(self._t_s) - MIN_REPORTS, -1, -1):
            host_s = self._reports[-1].host_s - self._reports[index].host_s
            if self._t_s[-1] - self._t_s[index] >= span_s - 1e-6 and host_s >= host_span_s:
                return _Path(self._reports[index:])
        return _Path(())

    def fast(self, step_arcsec: float) -> Motion | None:
        """Return a slew, for which two reports suffice; None where there is none."""
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
        """Return the motion at a constant rate.

        None where no rate fits, or where very different rates do.
        """
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
        """Return a motion at no constant rate, where neither rest explains it; else unknown."""
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
    """Return whether to order tracking on or off after a STOP; None: leave it as it is.

    ``was_slewing`` counts as tracking (unless ``was_parking``), because a completed slew ends in
    tracking, although drivers report "not tracking" during a slew.
    """
    if is_parked:
        return None
    if after_stop == "stand still":
        return False
    if was_parking:
        return None
    return True if was_slewing or was_tracking else None


MOVES_AFTER_S = 4.5
"""Time after a STOP during which a motion may be the mount slowing down: no news."""
BRAKES_FOR_S = 2.5
"""Time in which a mount slows down: a motion that began in it does not count."""
UNKNOWN_AFTER_S = 10.0
REPEAT_S = 1.0
REPEATS_FOR_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StopDecision:
    """Decision on the next action during a STOP."""

    sends_abort: bool = False
    news: Motion | None = None
    """Motion to report, where its kind has changed; None: nothing to report."""
    is_over: bool = False
    """True where the mount is at rest, or ABORT has been repeated long enough; end measuring."""


class StopMeasure:
    """Decides, during one STOP, when to repeat ABORT, when to report and when to end.

    ABORT is repeated while the mount is measured to move, or while its driver has not answered and
    no motion is known.
    """

    def __init__(self, began_s: float) -> None:
        self.began_s = began_s
        self._aborted_s = began_s
        self._last: Motion | None = None
        self.is_over = False

    def step(self, now_s: float, motion: Motion, *, is_answered: bool) -> StopDecision:
        """Decide what to do next at ``motion``; ``is_answered``: the driver has accepted ABORT."""
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
        return StopDecision(sends_abort=sends, news=news, is_over=self.is_over)

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
