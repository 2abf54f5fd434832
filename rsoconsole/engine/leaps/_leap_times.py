"""Times of mount and camera for a leap, learned from the night's own slews and frames."""

import math
import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import NS, InstrumentController
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.pipeline import (
    LAST_SLEWS,
    Leap,
    LeapParameters,
    MeasuredSlew,
    MountMotion,
    Telescope,
    frame_timing,
    leap_parameters,
    learned_motion,
    mid_exposure_utc_ns,
)
from rsoconsole.records import Frame

STEP = 0.8
"""Shorter settling time to be tested, in units of the settling time in use."""
TURNS = 4
"""Number of leaps with each of the two settling times before they are compared."""
AS_SHARP, SHARPER = 1.05, 0.94
"""Ratio of star widths, tested time to time in use, that counts as no worse, and as better."""
SHORTEST_S, LONGEST = 0.3, 2.5
"""Bounds of the settling time: least, in s, and greatest, in units of the configured time."""
_SURE_SIGMAS = 1.5
_MEDIAN = 1.25
"""Error of a median, in units of the error of a mean."""
_RESTS = 2
"""Number of comparisons without a test once neither a shorter nor a longer time is better."""


@dataclass(frozen=True, slots=True)
class _Turn:
    """Settling time of one leap."""

    seconds: float
    is_trial: bool
    comparison: int


@dataclass(slots=True)
class SettleTrials:
    """Learns the mount's settling time, by comparing the time in use with other times.

    The width of the stars shows whether the mount had settled.
    """

    configured_s: float
    """Configured settling time, s; the time in use at the beginning."""
    _factor: float = 1.0
    """Settling time in use, in units of the configured time."""
    _is_shorter: bool = True
    """True where a shorter time is tested; else a longer one."""
    _next: _Turn | None = None
    """Settling time of the next leap, which is already planned with it."""
    _used: _Turn | None = None
    """Settling time of the leap under way; None: not known."""
    _comparison: int = 0
    _refused: int = 0
    """Number of tested times in a row that were not adopted."""
    _rests: int = 0
    _widths: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    """Widths of the stars, px, with the time in use (False) and with the tested time (True)."""

    @property
    def next_settle_s(self) -> float:
        """Settling time for the next leap, s: the one in use, or one under test."""
        return self.settle_in_use_s if self._next is None else self._next.seconds

    @property
    def settle_in_use_s(self) -> float:
        """Settling time in use, as learned until now, s."""
        return self.configured_s * self._factor

    @property
    def _trial_s(self) -> float:
        """Time in trial, s: shorter than the kept one; or longer, at least the configured one."""
        if self._is_shorter:
            return max(self.settle_in_use_s * STEP, min(SHORTEST_S, self.configured_s))
        return max(self._step_back_s, self.configured_s)

    @property
    def _step_back_s(self) -> float:
        return min(self.settle_in_use_s / STEP, LONGEST * self.configured_s)

    def begin_next_leap(self) -> None:
        """Note that the mount has settled for a leap, and choose the settling time of the next."""
        self._used = self._next or _Turn(self.settle_in_use_s, False, self._comparison)
        is_trial = not self._used.is_trial and self._rests == 0
        seconds = self._trial_s if is_trial else self.settle_in_use_s
        self._next = _Turn(seconds, is_trial, self._comparison)

    def forget_leap(self) -> None:
        """Forget the leap under way, because no frame will belong to it."""
        self._used = None

    def forget_star_widths(self) -> None:
        """Begin the comparison again, because another camera mode changes the width of stars."""
        self._begin_comparison()
        self._used = None

    def _begin_comparison(self) -> None:
        self._widths = {False: [], True: []}
        self._comparison += 1

    def add_star_width(self, width_px: float | None) -> str | None:
        """Add the width of the stars in a leap's frame, px; None: too wide to be measured.

        Returns words for the log where the settling time in use changes, else None.
        """
        used, self._used = self._used, None
        if used is None or used.comparison != self._comparison:
            return None
        is_known = width_px is not None and 0.0 < width_px < math.inf
        self._widths[used.is_trial].append(width_px if is_known and width_px else math.inf)
        if self._rests:
            self._rest()
            return None
        if min(map(len, self._widths.values())) < TURNS:
            return None
        return self._compared()

    def _rest(self) -> None:
        if sum(map(len, self._widths.values())) >= 2 * TURNS:
            self._rests -= 1
            self._begin_comparison()

    def _compared(self) -> str | None:
        kept, trial = (statistics.median(self._widths[each]) for each in (False, True))
        is_clear = math.isfinite(kept)  # else what is kept is no better than a trial may be
        ratio = trial / kept if is_clear else (0.0 if math.isfinite(trial) else 1.0)
        error = self._error_of_ratio()
        self._begin_comparison()
        before_s, trial_s = self.settle_in_use_s, self._trial_s
        was_shorter, self._is_shorter = self._is_shorter, not self._is_shorter
        after_s = before_s
        if was_shorter and ratio <= AS_SHARP and is_clear:
            after_s = trial_s
        elif not was_shorter and ratio <= min(SHARPER, 1.0 - _SURE_SIGMAS * error):
            after_s = self._step_back_s
        if after_s == before_s:
            self._refused += 1
            # More is no better as a rule: only where less is not, either, is there nothing to gain.
            if was_shorter and self._refused >= 2:
                self._refused, self._rests = 0, _RESTS
            return None
        self._refused = 0
        self._factor = after_s / self.configured_s
        if was_shorter:
            than = f"stars are as sharp as after {before_s:.1f} s"
        else:
            than = f"stars are sharper after {trial_s:.1f} s than after {before_s:.1f} s"
        seen = ", ".join(f"{w:.1f} px" if math.isfinite(w) else "none seen" for w in (trial, kept))
        return f"the mount is given {after_s:.1f} s to settle: {than} ({seen})"

    def _error_of_ratio(self) -> float:
        """One sigma of the ratio of both medians, by the scatter of the widths."""
        known = [[w for w in widths if math.isfinite(w)] for widths in self._widths.values()]
        relative = [statistics.stdev(w) / statistics.mean(w) for w in known if len(w) > 1]
        return _MEDIAN * math.hypot(*relative) / math.sqrt(TURNS)


_FRAMES = 12
_LONGEST_READOUT_S = 20.0
_SUBFRAME = 0.5
"""Part of each side that is read where no other is configured: a quarter of the pixels."""
_LATE_S = (-0.05, 3.0)
"""Least and greatest believable delay from order to shutter, s; else the camera's clock is off."""
_MIN_FRAMES = 3
_CLOSED_SIGMAS = 4.0
_MIN_SCATTER_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapDurations:
    """The durations of one leap's parts, in seconds."""

    total_s: float
    """Time from the order of this leap's slew until the next slew could be ordered."""
    slew_s: float
    settle_s: float
    shutter_s: float
    """Time until the shutter opens, without the part of it in which the mount still settles."""
    open_s: float
    readout_s: float
    """Time of read-out and processing; 0 where the next slew was ordered as the shutter closed."""

    @property
    def wait_s(self) -> float:
        """Rest of the total time, mostly spent waiting for the satellite, s."""
        named_s = self.slew_s + self.settle_s + self.shutter_s + self.open_s + self.readout_s
        return self.total_s - named_s


class LeapTimes:
    """Learns the times of slew, shutter, read-out and settling from each slew and frame."""

    def __init__(
        self,
        config: Callable[[], Config],
        instrument_controller: InstrumentController,
        watch: Watch,
    ) -> None:
        """``config``: returns the configuration in force."""
        self._config = config
        self._instrument_controller = instrument_controller
        self._watch = watch
        self._seen: deque[MeasuredSlew] = deque(maxlen=LAST_SLEWS)
        self._motion: MountMotion | None = None
        """Motion fitted to the slews seen so far; None: to be fitted again."""
        self._readouts_s: deque[float] = deque(maxlen=_FRAMES)
        self._whole_s: deque[float] = deque(maxlen=_FRAMES)
        """Time from an exposure's end until the next could be ordered, the whole sensor read, s."""
        self._closed_utc_ns: int | None = None
        """Time at which the last frame's shutter closed, by its header, UTC ns; None: not known."""
        self._rows_s = 0.0
        """Delay of the last row's closing after the first's, with a rolling shutter, s."""
        self._latencies_s: deque[float] = deque(maxlen=_FRAMES)
        self._settle = SettleTrials(config().mount.settle_s)
        self._given_last_s = config().mount.settle_s
        """Settling time before the last leap, s."""
        self._ordered: tuple[tuple[float, float], int] | None = None
        """Travel of the slew under way on both axes, deg, and the time of its order, UTC ns."""

    def forget_slew(self) -> None:
        """Forget the slew under way, because it no longer belongs to a leap."""
        self._ordered = None
        self._settle.forget_leap()

    def ordered(self, travel_deg: tuple[float, float], t_utc_ns: int) -> None:
        """Note a leap's slew: the travel of both axes, deg, and the time of its order, UTC ns."""
        self._ordered = travel_deg, t_utc_ns

    def learn_slew_time(self) -> None:
        """Learn how long a leap's slew took; called when the mount has arrived."""
        if self._ordered is None:
            self._settle.forget_leap()
            return
        travel, since_ns = self._ordered
        self._ordered = None
        self._given_last_s = self._given_s()
        if self._config().leap.learns_settle:
            self._settle.begin_next_leap()
        took_s = (self._instrument_controller.arrived_utc_ns - since_ns) / NS
        if took_s > 0.0:  # a hold may have come before the arrival
            self._seen.append(MeasuredSlew(travel_deg=travel, seconds=took_s))
            self._motion = None

    def learn_shutter_delay(self, frame: Frame, opened_utc_ns: int) -> None:
        """Learn the shutter's delay from a frame; its exposure was ordered at ``opened_utc_ns``."""
        self._closed_utc_ns = None
        t_mid_ns = mid_exposure_utc_ns(frame, self._config().exposure)
        if t_mid_ns is None or frame.exposure_s is None:
            return
        t_close_ns = self._closed_utc_ns = t_mid_ns + round(frame.exposure_s / 2.0 * NS)
        shutter = frame_timing(frame, self._config().exposure)
        rows_s = abs(shutter.line_time_us) * 1e-6 * frame.height_px
        latency_s = (t_close_ns - opened_utc_ns) / NS - frame.exposure_s
        self._latencies_s.append(latency_s)
        self._rows_s = rows_s

    def learn_processing_time(self, now_utc_ns: int) -> None:
        """Learn how long read-out and processing took; called when the next slew can be ordered."""
        took_s = self._since_closed_s(now_utc_ns)
        if took_s is not None:
            self._readouts_s.append(took_s)

    def forget_camera_times(self) -> None:
        """Forget the camera's times, because its clock was set or its read-out mode has changed."""
        self._readouts_s.clear()
        self._whole_s.clear()
        self._latencies_s.clear()
        self._settle.forget_star_widths()

    def forget_readouts(self) -> None:
        """Forget the read-out times, not the shutter's: another part of the sensor is read."""
        self._readouts_s.clear()

    def subframe_for(self, leap: Leap) -> float:
        """Return the part of each sensor side to read in a well-predicted leap; 1: all of it."""
        share = self._config().leap.subframe or self._worth_reading()
        return share if leap.fits_in(share, self.terms(leap.binning)) else 1.0

    def _worth_reading(self) -> float:
        ways_s = [each.seconds + self.settle_s() for each in self._seen]
        if len(self._whole_s) < _MIN_FRAMES or not ways_s:
            return 1.0
        is_slow = float(np.median(self._whole_s)) > float(np.median(ways_s))
        return _SUBFRAME if is_slow else 1.0

    def learn_whole_readout_time(self, now_utc_ns: int) -> None:
        """Learn the time from a whole-sensor frame until the next exposure can be ordered."""
        took_s = self._since_closed_s(now_utc_ns)
        if took_s is not None:
            self._whole_s.append(took_s)

    def _since_closed_s(self, now_utc_ns: int) -> float | None:
        """Time since the shutter closed, s; None where not known, or too long for a read-out."""
        if self._closed_utc_ns is None:
            return None
        took_s = (now_utc_ns - self._closed_utc_ns) / NS
        return took_s if 0.0 <= took_s < _LONGEST_READOUT_S else None

    def add_star_width(self, width_px: float | None) -> str | None:
        """Learn from the width of the stars in the last leap's frame, px; None: not measured.

        Returns words for the log where another settling time is used from now on, else None.
        """
        return self._settle.add_star_width(width_px) if self._config().leap.learns_settle else None

    def shutter_closed_after_s(self, exposure_s: float, scatter_s: float = 0.0) -> float | None:
        """Return the time from the order of an exposure until its shutter has surely closed, s.

        ``scatter_s``: scatter of the shutter's delay as streaks show it, s; frame headers show
        another. None where too few frames are known, where the camera's clock is off, and where the
        frame itself comes sooner.
        """
        latency = self._shutter_s(scatter_s)
        if latency is None:
            return None
        latest_s = max(latency[1], self._config().exposure.start_latency_s)
        usual_s = float(np.median(self._latencies_s))
        if self._readouts_s and latest_s - usual_s > float(np.median(self._readouts_s)):
            return None
        return latest_s + exposure_s + self._rows_s

    def _shutter_s(self, scatter_s: float = 0.0) -> tuple[float, float] | None:
        """Least and greatest time from an order to the opening, s; None: not known."""
        seen, (low_s, high_s) = self._latencies_s, _LATE_S
        if len(seen) < _MIN_FRAMES or min(seen) < low_s or max(seen) > high_s:
            return None
        stated_s = max(self._config().exposure.timing_sigma_s, scatter_s, _MIN_SCATTER_S)
        sigma_s = max(stated_s, float(np.std(seen)))
        middle_s, spread_s = float(np.median(seen)), _CLOSED_SIGMAS * sigma_s
        return min(middle_s - spread_s, *seen), max(middle_s + spread_s, *seen)

    def settle_s(self) -> float:
        """Return the time from the mount's arrival until an exposure may be ordered, s.

        It is the settling time less the shutter's latency, at least 0; at most
        ``exposure.start_latency_s`` is taken off, because a camera clock that runs
        ahead makes the measured latency too long.
        """
        return max(self._given_s() - self._opens_s(), 0.0)

    def _given_s(self) -> float:
        """Time for the mount to settle before the next exposure, s."""
        config = self._config()
        return self._settle.next_settle_s if config.leap.learns_settle else config.mount.settle_s

    def _opens_s(self) -> float:
        """Least time from the order of an exposure until the shutter opens, s."""
        latency = self._shutter_s()
        if latency is None:
            return 0.0
        return min(max(latency[0], 0.0), self._config().exposure.start_latency_s)

    def terms(self, binning: int) -> LeapParameters:
        """Return a leap's times other than its slew, as learned so far, for a binning."""
        terms = replace(leap_parameters(self._config(), binning), settle_s=self.settle_s())
        if self._readouts_s:
            terms = replace(terms, readout_s=float(np.median(self._readouts_s)))
        return terms

    def telescope(self, binning: int) -> Telescope:
        """Return the telescope's motion, times and limits, as learned so far, at a binning."""
        if self._motion is None:
            self._motion = learned_motion(self._config().mount, list(self._seen))
        return Telescope(
            motion=self._motion,
            terms=self.terms(binning),
            limits=self._watch.limits,
            lifted=self._watch.lifted_limits(),
        )

    def apply_new_settings(self, before: Config) -> None:
        """Note new settings; ``before``: the configuration until now."""
        mount = self._config().mount
        if before.mount != mount:
            self._motion = None
        is_other = before.leap.learns_settle != self._config().leap.learns_settle
        if is_other or before.mount.settle_s != mount.settle_s:
            self._settle = SettleTrials(mount.settle_s)

    def leap_durations(
        self, leap: Leap, now_utc_ns: int, *, waited_for_frame: bool
    ) -> LeapDurations:
        """Return the durations of a leap, from the order of its slew until now.

        To be called when the next slew can be ordered. ``waited_for_frame``: that had to wait for
        the leap's frame.
        """
        terms = self.terms(leap.binning)
        readout_s = self._readouts_s[-1] if self._readouts_s else terms.readout_s
        while_settling_s = min(self._opens_s(), self._given_last_s)
        return LeapDurations(
            total_s=(now_utc_ns - leap.t_order_utc_ns) / NS,
            slew_s=self._seen[-1].seconds if self._seen else leap.slew_s,
            settle_s=self._given_last_s,
            shutter_s=max(terms.latency_s - while_settling_s, 0.0),
            open_s=leap.exposure_s,
            readout_s=readout_s if waited_for_frame else 0.0,
        )
