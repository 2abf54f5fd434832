"""What mount and camera take for a leap: learned from the night's own slews and frames."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.config import Config
from rsoconsole.engine.aim import NS, InstrumentController
from rsoconsole.engine.leaps.settle_trials import SettleTrials
from rsoconsole.engine.tasks import Watch
from rsoconsole.pipeline.frame import shutter_mid_utc_ns, shutter_time
from rsoconsole.pipeline.leaps import (
    LAST_SLEWS,
    Leap,
    LeapTerms,
    MountMotion,
    SlewSeen,
    Telescope,
    learned,
    terms_of,
)
from rsoconsole.records import Frame

_FRAMES = 12
_LONGEST_READOUT_S = 20.0
_SUBFRAME = 0.5
"""Of each side, where nothing else is set: a quarter of the pixels."""
_LATE_S = (-0.05, 3.0)
"""From an order to the shutter, at the least and at most: beyond, the camera's clock is off."""
_LEAST_FRAMES = 3
_CLOSED_SIGMAS = 4.0
_LEAST_SCATTER_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapParts:
    """What one leap took, in seconds."""

    total_s: float
    """From the order of its slew until the next could be ordered."""
    slew_s: float
    settle_s: float
    shutter_s: float
    """Until it opens, beyond what of that the mount settles in."""
    exposure_s: float
    readout_s: float
    """With what came of the frame; 0 where the next slew was ordered as the shutter closed."""

    @property
    def wait_s(self) -> float:
        """For the satellite to come, and all that has no name."""
        named_s = self.slew_s + self.settle_s + self.shutter_s + self.exposure_s + self.readout_s
        return self.total_s - named_s


class LeapTimes:
    """Learns from slew to slew and from frame to frame."""

    def __init__(
        self,
        config: Callable[[], Config],
        instrument_controller: InstrumentController,
        watch: Watch,
    ) -> None:
        """``config``: the one in force."""
        self._config = config
        self._instrument_controller = instrument_controller
        self._watch = watch
        self._seen: deque[SlewSeen] = deque(maxlen=LAST_SLEWS)
        self._motion: MountMotion | None = None
        """By the slews seen so far; None: to be found again."""
        self._readouts_s: deque[float] = deque(maxlen=_FRAMES)
        self._whole_s: deque[float] = deque(maxlen=_FRAMES)
        """From the end of an exposure until the next could be ordered, the whole sensor read."""
        self._closed_utc_ns: int | None = None
        """When the shutter of the last frame closed, by its header."""
        self._rows_s = 0.0
        """With a rolling shutter: by how much the last row closes later than the first."""
        self._latencies_s: deque[float] = deque(maxlen=_FRAMES)
        self._settle = SettleTrials(config().mount.settle_s)
        self._given_last_s = config().mount.settle_s
        """What the mount was given to settle before the last leap."""
        self._ordered: tuple[tuple[float, float], int] | None = None
        """Travel of the slew under way, and when it was ordered."""

    def forget_slew(self) -> None:
        """The one under way is no longer its own."""
        self._ordered = None
        self._settle.lost()

    def ordered(self, travel_deg: tuple[float, float], t_utc_ns: int) -> None:
        """A slew of its own is under way."""
        self._ordered = travel_deg, t_utc_ns

    def arrived(self) -> None:
        """A slew of its own has ended: what it took is learned."""
        if self._ordered is None:
            self._settle.lost()
            return
        travel, since_ns = self._ordered
        self._ordered = None
        self._given_last_s = self._given_s()
        if self._config().leap.learns_settle:
            self._settle.begun()
        took_s = (self._instrument_controller.arrived_utc_ns - since_ns) / NS
        if took_s > 0.0:  # a hold may have come before the arrival
            self._seen.append(SlewSeen(travel_deg=travel, seconds=took_s))
            self._motion = None

    def read_out(self, frame: Frame, opened_utc_ns: int) -> None:
        """A frame has come whose exposure was ordered at an instant: its shutter is learned."""
        self._closed_utc_ns = None
        t_mid_ns = shutter_mid_utc_ns(frame, self._config().exposure)
        if t_mid_ns is None or frame.exposure_s is None:
            return
        t_close_ns = self._closed_utc_ns = t_mid_ns + round(frame.exposure_s / 2.0 * NS)
        shutter = shutter_time(frame, self._config().exposure)
        rows_s = abs(shutter.line_time_us) * 1e-6 * frame.height_px
        latency_s = (t_close_ns - opened_utc_ns) / NS - frame.exposure_s
        self._latencies_s.append(latency_s)
        self._rows_s = rows_s

    def examined(self, now_utc_ns: int) -> None:
        """By the last frame the next slew can be ordered: what that took since its end."""
        took_s = self._since_closed_s(now_utc_ns)
        if took_s is not None:
            self._readouts_s.append(took_s)

    def forget_camera(self) -> None:
        """Its clock was set, or it reads out in another mode."""
        self._readouts_s.clear()
        self._whole_s.clear()
        self._latencies_s.clear()
        self._settle.forget_widths()

    def forget_readouts(self) -> None:
        """It reads out more or less of its sensor: the shutter is the same."""
        self._readouts_s.clear()

    def subframe_for(self, leap: Leap) -> float:
        """Share of each side of the sensor that is worth reading for a leap that is sure."""
        share = self._config().leap.subframe or self._worth_reading()
        return share if leap.fits_in(share, self.terms(leap.binning)) else 1.0

    def _worth_reading(self) -> float:
        ways_s = [each.seconds + self.settle_s() for each in self._seen]
        if len(self._whole_s) < _LEAST_FRAMES or not ways_s:
            return 1.0
        is_slow = float(np.median(self._whole_s)) > float(np.median(ways_s))
        return _SUBFRAME if is_slow else 1.0

    def whole_seen(self, now_utc_ns: int) -> None:
        """A whole frame is done with: the next exposure could be ordered now."""
        took_s = self._since_closed_s(now_utc_ns)
        if took_s is not None:
            self._whole_s.append(took_s)

    def _since_closed_s(self, now_utc_ns: int) -> float | None:
        """Since the shutter closed; None where that is not known, or is no time of a read-out."""
        if self._closed_utc_ns is None:
            return None
        took_s = (now_utc_ns - self._closed_utc_ns) / NS
        return took_s if 0.0 <= took_s < _LONGEST_READOUT_S else None

    def stars_seen(self, width_px: float | None) -> str | None:
        """How wide the stars of the last leap's frame are; words where the mount is given another
        time to settle from now on."""
        return self._settle.seen(width_px) if self._config().leap.learns_settle else None

    def closed_after_s(self, exposure_s: float, scatter_s: float = 0.0) -> float | None:
        """Seconds from the order of an exposure until its shutter has surely closed.

        ``scatter_s``: what streaks have told of the shutter beside its headers. None where frames
        have not told it (too few of them, or the camera's clock is off), and where the frame
        itself comes sooner.
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
        """From an order to the opening, surely at the least and at the most; None: not known."""
        seen, (low_s, high_s) = self._latencies_s, _LATE_S
        if len(seen) < _LEAST_FRAMES or min(seen) < low_s or max(seen) > high_s:
            return None
        stated_s = max(self._config().exposure.timing_sigma_s, scatter_s, _LEAST_SCATTER_S)
        sigma_s = max(stated_s, float(np.std(seen)))
        middle_s, spread_s = float(np.median(seen)), _CLOSED_SIGMAS * sigma_s
        return min(middle_s - spread_s, *seen), max(middle_s + spread_s, *seen)

    def settle_s(self) -> float:
        """From a mount's arrival until an exposure may be ordered.

        The shutter opens later: an exposure that is ordered while the mount still settles finds it
        settled. By no more than ``exposure.start_latency_s``: a camera's clock that is ahead looks
        like a late shutter.
        """
        return max(self._given_s() - self._opens_s(), 0.0)

    def _given_s(self) -> float:
        """What the mount is given to settle before the next exposure."""
        config = self._config()
        return self._settle.seconds if config.leap.learns_settle else config.mount.settle_s

    def _opens_s(self) -> float:
        """From the order of an exposure until the shutter opens, at the least."""
        latency = self._shutter_s()
        if latency is None:
            return 0.0
        return min(max(latency[0], 0.0), self._config().exposure.start_latency_s)

    def terms(self, binning: int) -> LeapTerms:
        """What a leap needs beside its slew, as learned so far."""
        terms = replace(terms_of(self._config(), binning), settle_s=self.settle_s())
        if self._readouts_s:
            terms = replace(terms, readout_s=float(np.median(self._readouts_s)))
        return terms

    def telescope(self, binning: int) -> Telescope:
        """What it can do, as learned so far."""
        if self._motion is None:
            self._motion = learned(self._config().mount, list(self._seen))
        return Telescope(
            motion=self._motion,
            terms=self.terms(binning),
            limits=self._watch.limits,
            lifted=self._watch.lifted_limits(),
        )

    def configured(self, before: Config) -> None:
        """Other settings hold."""
        mount = self._config().mount
        if before.mount != mount:
            self._motion = None
        is_other = before.leap.learns_settle != self._config().leap.learns_settle
        if is_other or before.mount.settle_s != mount.settle_s:
            self._settle = SettleTrials(mount.settle_s)

    def parts_of(self, leap: Leap, now_utc_ns: int, *, waited_for_frame: bool) -> LeapParts:
        """From the order of its slew until now, when the next could be ordered."""
        terms = self.terms(leap.binning)
        readout_s = self._readouts_s[-1] if self._readouts_s else terms.readout_s
        while_settling_s = min(self._opens_s(), self._given_last_s)
        return LeapParts(
            total_s=(now_utc_ns - leap.t_order_utc_ns) / NS,
            slew_s=self._seen[-1].seconds if self._seen else leap.slew_s,
            settle_s=self._given_last_s,
            shutter_s=max(terms.latency_s - while_settling_s, 0.0),
            exposure_s=leap.exposure_s,
            readout_s=readout_s if waited_for_frame else 0.0,
        )
