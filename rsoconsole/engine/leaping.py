"""Stares where low satellites come by, and leaps ahead of one until it sets.

The telescope exposes where it looks, one frame after another. A streak fast enough to be of a low
orbit begins a track (`orbit.leap_track`); from then on each exposure is where and when that says.
What the frames show is measured and recorded as ever; here is only where the next one is.
"""

from collections import deque
from dataclasses import replace

import numpy as np

from rsoconsole.config import Config
from rsoconsole.engine.awaiting import Awaiting, LeapControl
from rsoconsole.engine.by_hand import Parts
from rsoconsole.engine.hands import NS
from rsoconsole.engine.leap_words import (
    LeapParts,
    begun_words,
    last_words,
    leap_words,
    orbit_words,
    pass_words,
)
from rsoconsole.engine.plan import Plan
from rsoconsole.engine.tunables import change_record, changed
from rsoconsole.orbit.known import KnownOrbit
from rsoconsole.orbit.leap_track import LeapTrack, begin, path_of_orbit, unseen, updated
from rsoconsole.orbit.low_fit import Timing
from rsoconsole.orbit.point_mass import PointMass
from rsoconsole.pipeline.awaited import (
    Awaited,
    came,
    expected_at,
    is_dark,
)
from rsoconsole.pipeline.leap_pass import duty, plan_pass
from rsoconsole.pipeline.leap_streaks import FrameStreak, streaks_of, timing_of
from rsoconsole.pipeline.leaps import (
    Leap,
    NoLeap,
    Telescope,
    exposure_for,
    next_leap,
    terms_of,
)
from rsoconsole.pipeline.measure import shutter_mid_utc_ns
from rsoconsole.pipeline.mount_motion import LAST_SLEWS, SlewSeen, learned
from rsoconsole.pipeline.reduce import Reduction
from rsoconsole.reason_text import text
from rsoconsole.records import Frame, Solution
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.frames import hour_angle_icrs_deg, icrs_of_hour_angle, icrs_to_jnow
from rsoconsole.sky.limits import Pose

LEAP_POLL_NS = NS // 10
"""How often a mount that leaps is asked whether it has arrived."""
_EXPOSURE = "exposure.exposure_s"
_WORTH_CHANGING = 0.15
_DRIFT = 0.1
"""Share of the field's short side by which a stare may drift with the stars."""
_AHEAD_S, _STEP_S = 150.0, 3.0
"""How far a track's path is looked at for the next leap: a flip of the mount fits in."""
_PASS_S, _PASS_STEP_S = 1_200.0, 10.0
_GO_THERE_NS = 90 * NS
"""Before a pass may begin the telescope goes to where it will be."""
_LOOK_NS = 600 * NS
"""Between two frames until then."""
_READOUTS = 12
_LONGEST_READOUT_S = 20.0


class Leaping:
    """Knows what is leapt after, and what mount and camera take for it."""

    def __init__(self, control: LeapControl, parts: Parts) -> None:
        self._control = control
        self._hands, self._planner = parts.hands, parts.planner
        self._slews, self._watch = parts.slews, parts.watch
        self._chronicle = parts.chronicle
        self._site = control.config.site.to_site()
        self.track: LeapTrack | None = None
        """What is leapt after; None while it stares."""
        self._leap: Leap | None = None
        """The one under way."""
        self._misses = 0
        self._stare: tuple[float, float] | None = None
        """Hour angle and declination of date."""
        self._seen: deque[SlewSeen] = deque(maxlen=LAST_SLEWS)
        self._readouts_s: deque[float] = deque(maxlen=_READOUTS)
        self._ordered: tuple[tuple[float, float], int] | None = None
        """Travel of the slew under way, and when it was ordered."""
        self._awaiting = Awaiting(control, parts)
        self._before_s: float | None = None
        """The night's own exposure, where the leaps have set another."""
        self._set_s = 0.0
        """That one."""
        self._parts: list[LeapParts] = []
        """Of each leap after the present track, what it took."""

    @property
    def is_on(self) -> bool:
        """Whether the telescope stares and leaps at all."""
        return self._control.config.leap.enabled

    def forget(self) -> None:
        """Autonomy has lost the mount: it stares where it then points, with its own exposure."""
        self.track = self._leap = self._stare = self._ordered = None
        self._awaiting.forget()
        self._misses = 0
        self._parts = []
        own_s, self._before_s = self._before_s, None
        if own_s is not None:
            self._set_exposure(own_s, "the end of the leaps")

    def forget_times(self) -> None:
        """Time has lost its meaning, and with it every orbit."""
        self.forget()
        self._awaiting.forget_orbit()

    def configure(self, before: Config) -> None:
        """Take new tunables: ended leaps leave the night its own exposure, and forget."""
        after = self._control.config
        if before.leap.pass_norad != after.leap.pass_norad:
            self._awaiting.forget_elements()
        wanted_s = after.exposure.exposure_s
        if self._before_s is not None and wanted_s not in (before.exposure.exposure_s, self._set_s):
            self._before_s = wanted_s  # what the operator sets holds where the leaps end
        if before.leap.enabled and not after.leap.enabled:
            self.forget()

    def arrived(self) -> None:
        """A slew of its own has ended: what it took is learned."""
        if self._ordered is None:
            return
        travel, since_ns = self._ordered
        self._ordered = None
        took_s = (self._hands.arrived_utc_ns - since_ns) / NS
        if took_s > 0.0:  # a hold may have come before the arrival
            self._seen.append(SlewSeen(travel_deg=travel, seconds=took_s))

    def read_out(self, frame: Frame, now_utc_ns: int) -> None:
        """A frame can be used from now on: what read-out and transfer took is learned."""
        if frame.t_start_utc_ns is None or frame.exposure_s is None:
            return
        took_s = (now_utc_ns - frame.t_start_utc_ns) / NS - frame.exposure_s
        if 0.0 <= took_s < _LONGEST_READOUT_S:
            self._readouts_s.append(took_s)

    def telescope(self) -> Telescope:
        """What it can do, as learned so far."""
        config = self._control.config
        terms = terms_of(config)
        if self._readouts_s:
            terms = replace(terms, readout_s=float(np.median(self._readouts_s)))
        return Telescope(
            motion=learned(config.mount, list(self._seen)),
            terms=terms,
            limits=self._watch.limits,
            lifted=self._watch.lifted_limits(),
        )

    # --- what a frame shows

    def saw(self, frame: Frame, reduction: Reduction) -> None:
        """Follow what is leapt after through one more frame, or begin with what it shows."""
        if not self.is_on:
            return
        leap, self._leap = self._leap, None
        if leap is not None:
            self._note_parts(leap)
        solution = reduction.solution
        if not isinstance(solution, Solution):
            if self.track is not None:
                self._miss("the frame is not solved")
            return
        exposure = self._control.config.exposure
        found = streaks_of(reduction.detections, solution, frame, exposure)
        if self.track is None:
            self._begin(found, timing_of(frame, exposure))
            return
        for each in found:
            after = updated(self.track, each.ends)
            if after is not None:
                self.track, self._misses = after, 0
                self._chronicle.say("info", leap_words(after, each, leap))
                return
        centre, orbit = (solution.ra_icrs_deg, solution.dec_icrs_deg), self.track.best.orbit
        t_mid_ns = shutter_mid_utc_ns(frame, exposure)
        if t_mid_ns is not None:
            if orbit is not None and is_dark(orbit, t_mid_ns):
                self._end("it has gone into the Earth's shadow")
                return
            radius_deg = min(self._control.config.optics.field_deg) / 2.0
            self.track = unseen(self.track, t_mid_ns, centre, radius_deg)
        self._miss("it is not in the frame" if not found else "no streak of the frame is its")

    def _note_parts(self, leap: Leap) -> None:
        """From the order of its slew until now, when the next could be ordered."""
        config, terms = self._control.config, self.telescope().terms
        total_s = (self._hands.now_utc_ns() - leap.t_order_utc_ns) / NS
        slew_s = self._seen[-1].seconds if self._seen else leap.slew_s
        self._parts.append(
            LeapParts(
                total_s=total_s,
                slew_s=slew_s,
                settle_s=config.mount.settle_s,
                shutter_s=terms.latency_s,
                exposure_s=config.exposure.exposure_s,
                readout_s=terms.readout_s,
            )
        )

    def _begin(self, found: tuple[FrameStreak, ...], timing: Timing) -> None:
        config = self._control.config
        for each in found:
            ends = each.ends
            if not ends.is_whole or ends.speed_arcsec_s < config.leap.least_rate_arcsec_s:
                continue
            awaited = self._awaiting.awaited
            known = None if awaited is None else came(awaited, self._site, ends)
            if awaited is not None and known is None:
                self._chronicle.say("info", f"a low satellite that is not {awaited.name}")
                continue
            ends = ends if known is None else known[1]
            track = begin(self._site, ends, timing, is_turned=known is not None)
            if track is None:
                continue
            self.track, self._misses = track, 0
            self._chronicle.say("info", begun_words(track, awaited, known and known[0]))
            self._plan_pass()
            return

    def _plan_pass(self) -> None:
        """The whole of it before the first leap, by the likeliest orbit."""
        assert self.track is not None
        now_ns = self._hands.now_utc_ns()
        pose = self._planner.pose(now_ns)
        best = self.track.best
        heaviest = int(np.argmax(best.cloud.weight))
        orbit = KnownOrbit(
            epoch_utc_ns=best.cloud.epoch_utc_ns,
            r_km=best.cloud.r_km[heaviest],
            v_km_s=best.cloud.v_km_s[heaviest],
            covariance=np.eye(6) * 1e-6,
            forces=PointMass(),
        )
        t = now_ns + (np.arange(0.0, _PASS_S, _PASS_STEP_S) * NS).astype(np.int64)
        path = path_of_orbit(orbit, self._site, t)
        if path is not None and pose is not None:
            plan = plan_pass(path, pose, now_ns, self.telescope())
            self._chronicle.say("info", pass_words(plan))

    def _miss(self, why: str) -> None:
        self._misses += 1
        most = self._control.config.leap.most_misses
        self._chronicle.say("info", f"leap missed ({self._misses} of {most}): {why}")
        if self._misses >= most:
            self._end("given up")

    def _end(self, why: str) -> None:
        """What was leapt after is done with: what is known of it goes into the log."""
        track, self.track, self._misses = self.track, None, 0
        if track is None:
            return
        orbit = track.best.orbit
        self._chronicle.say("info", f"{why}: {last_words(track, self._parts)}")
        self._parts = []
        self._awaiting.over(orbit)
        if orbit is not None:
            config = self._control.config
            now_ns = self._hands.now_utc_ns()
            least_deg = config.limits.min_altitude_deg
            for line in orbit_words(orbit, self._site, now_ns, least_deg):
                self._chronicle.say("info", line)

    # --- where the next one is

    def order_next(self, *, is_held: bool) -> Plan:
        """The next exposure; the mount is on its way when this returns.

        Raises what ``Slews.order`` does.
        """
        now_ns = self._hands.now_utc_ns()
        pose = self._planner.pose(now_ns)
        if is_held or pose is None:
            return self._in_place(now_ns)
        if self.track is not None:
            plan = self._leap_from(pose, now_ns)
            if plan is not None:
                return plan
        return self._stared(pose, now_ns)

    def _leap_from(self, pose: Pose, now_ns: int) -> Plan | None:
        """A leap; None where there is none any more."""
        assert self.track is not None
        telescope = self.telescope()
        found = self._likeliest_leap(pose, now_ns, telescope)
        if isinstance(found, NoLeap):
            words = found.kind if found.refusal is None else found.refusal.text
            self._end(words)
            return None
        self._expose_for(found.exposure_s)
        direction = found.place.direction_deg
        plan = self._planner.to_place(direction, found.t_expose_utc_ns, "leap", now_ns)
        travel = telescope.limits.travel_deg(pose, *direction)
        refused = self._slews.order(plan, t_until_utc_ns=found.t_close_utc_ns)
        if refused is not None:
            self._end(text(refused))
            return None
        self._ordered = travel, now_ns
        self._leap = found
        return plan

    def _likeliest_leap(self, pose: Pose, now_ns: int, telescope: Telescope) -> Leap | NoLeap:
        """After the likeliest sense that can be met; where none can, why not the likeliest."""
        assert self.track is not None
        why: NoLeap | None = None
        for number in range(len(self.track.hypotheses)):
            path = self.track.path(now_ns, _AHEAD_S, number, step_s=_STEP_S)
            found: Leap | NoLeap = NoLeap(kind="it sets")
            if path is not None:
                found = next_leap(path, pose, now_ns, telescope)
            if isinstance(found, Leap):
                return found
            why = why or found
        return why or NoLeap(kind="it sets")

    def _stared(self, pose: Pose, now_ns: int) -> Plan:
        """One more exposure where it stares; the mount moves where that has drifted away."""
        self._leap = None
        awaited = self._awaiting.next_one(now_ns)
        if awaited is not None:
            return self._waited(awaited, pose, now_ns)
        exposure = self._control.config.exposure
        stare_s = self._control.config.leap.stare_exposure_s
        self._expose_for(stare_s)
        here = (pose.ra_icrs_deg, pose.dec_icrs_deg)
        if self._stare is None:
            self._stare = self._where_to_stare(here, now_ns)
            share = duty(stare_s, exposure.start_latency_s, self.telescope().terms.readout_s)
            self._chronicle.say(
                "info", f"stares for low satellites: the shutter is open {100 * share:.0f} %"
            )
        there = icrs_of_hour_angle(self._site, *self._stare, now_ns)
        drift_deg = _DRIFT * min(self._control.config.optics.field_deg)
        if separation_deg(*here, *there) < drift_deg:
            return self._in_place(now_ns)
        plan = self._planner.to_place(there, now_ns, "stare", now_ns)
        refused = self._slews.order(plan, t_until_utc_ns=self._planner.end_utc_ns(plan))
        if refused is not None:
            self._chronicle.say("warning", f"stares where it stands: {text(refused)}")
            self._stare = self._of_date(here, now_ns)
            return self._in_place(now_ns)
        self._ordered = self.telescope().limits.travel_deg(pose, *there), now_ns
        return plan

    # --- a pass that is waited for

    def _waited(self, awaited: Awaited, pose: Pose, now_ns: int) -> Plan:
        """In place until shortly before; then at the point of its orbit, until it has come."""
        stare = awaited.stare
        until_ns = stare.from_utc_ns - _GO_THERE_NS
        if now_ns < until_ns:
            return self._planner.to_place(None, min(until_ns, now_ns + _LOOK_NS), "", now_ns)
        at_ns = max(now_ns, stare.from_utc_ns)
        place = expected_at(awaited, self._site, stare.t_through_utc_ns, 0.0)
        self._expose_for(exposure_for(place, self.telescope().terms))
        there = stare.direction_deg(self._site, at_ns)
        drift_deg = _DRIFT * min(self._control.config.optics.field_deg)
        here = (pose.ra_icrs_deg, pose.dec_icrs_deg)
        if separation_deg(*here, *there) < drift_deg:
            return self._planner.to_place(None, at_ns, "", now_ns)
        plan = self._planner.to_place(there, at_ns, "await", now_ns)
        travel = self.telescope().limits.travel_deg(pose, *there)
        end_ns = max(self._planner.end_utc_ns(plan), stare.until_utc_ns)
        refused = self._slews.order(plan, t_until_utc_ns=end_ns)
        if refused is not None:
            self._chronicle.say("warning", f"cannot wait where it comes: {text(refused)}")
            self._awaiting.passed_over()
            return self._in_place(now_ns)
        self._ordered = travel, now_ns
        return plan

    def _where_to_stare(self, here: tuple[float, float], now_ns: int) -> tuple[float, float]:
        """As configured for a search; where that is silent, where the telescope points."""
        search, (hour_angle_deg, dec_deg) = self._control.config.search, self._of_date(here, now_ns)
        return (
            hour_angle_deg if search.hour_angle_deg is None else search.hour_angle_deg,
            dec_deg if search.declination_deg is None else search.declination_deg,
        )

    def _of_date(self, here: tuple[float, float], t_utc_ns: int) -> tuple[float, float]:
        hour_angle_deg = hour_angle_icrs_deg(self._site, *here, t_utc_ns)
        return hour_angle_deg, icrs_to_jnow(*here, t_utc_ns)[1]

    def _in_place(self, now_ns: int) -> Plan:
        return self._planner.to_place(None, now_ns, "", now_ns)

    def _expose_for(self, exposure_s: float) -> None:
        """Set the exposure, on record, where another one is wanted."""
        config = self._control.config
        wanted_s = float(np.format_float_positional(exposure_s, precision=2, fractional=False))
        if abs(wanted_s / config.exposure.exposure_s - 1.0) <= _WORTH_CHANGING:
            return
        if self._before_s is None:
            self._before_s = config.exposure.exposure_s
        self._set_exposure(wanted_s, "the leaps")

    def _set_exposure(self, exposure_s: float, by: str) -> None:
        config = self._control.config
        self._set_s = exposure_s
        after = changed(config, _EXPOSURE, exposure_s)
        self._chronicle.append(change_record(config, after, _EXPOSURE, by))
        self._control.configure(after)
