"""Exposures between passes: a stare for any low satellite, or where one is expected."""

from rsoconsole.engine.aim.instrument_controller import NS, AimPlan
from rsoconsole.engine.leaps._leap_camera import LeapCamera
from rsoconsole.engine.leaps._leap_times import LeapTimes
from rsoconsole.engine.leaps.awaiting import PassFinder
from rsoconsole.engine.operator.by_hand import Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.pipeline import AwaitedPass, expected_position, leap_exposure_s, open_shutter_share
from rsoconsole.sky import (
    Pose,
    hour_angle_icrs_deg,
    icrs_of_hour_angle,
    icrs_to_jnow,
    separation_deg,
)
from rsoconsole.words import text

_DRIFT = 0.1
"""Distance by which a stare may drift with the stars, in units of the field's shorter side."""
_GO_THERE_NS = 90 * NS
"""Time before a pass at which the telescope goes to where the satellite will be, ns."""
_LOOK_NS = 600 * NS
"""Greatest time between two frames before that, ns."""


class Staring:
    """Plans the exposures of a stare, which stays at one hour angle and declination."""

    def __init__(
        self,
        control: LoopControl,
        parts: Parts,
        times: LeapTimes,
        camera: LeapCamera,
        awaiting: PassFinder,
    ) -> None:
        self._control = control
        self._parts = parts
        self._times, self._camera, self._awaiting = times, camera, awaiting
        self._site = control.config.site.to_site()
        self._stare: tuple[float, float] | None = None
        """Hour angle and declination of date of the stare, deg."""

    def forget(self) -> None:
        """Forget the stare's direction; the next stare begins where the telescope then points."""
        self._stare = None

    def next_plan(self, pose: Pose, now_ns: int) -> AimPlan:
        """Plan a stare's next exposure; move the mount back once tracking has led it away.

        Raises what ``Slews.order`` raises.
        """
        awaited = self._awaiting.next_pass(now_ns)
        if awaited is not None:
            return self._waited(awaited, pose, now_ns)
        exposure = self._control.config.exposure
        stare_s = self._control.config.leap.stare_exposure_s
        self._camera.set_exposure(stare_s)
        here = (pose.ra_icrs_deg, pose.dec_icrs_deg)
        if self._stare is None:
            self._stare = self._where_to_stare(here, now_ns)
            readout_s = self._times.terms(self._camera.binning).readout_s
            share = open_shutter_share(stare_s, exposure.start_latency_s, readout_s)
            self._parts.session_log.say(
                "info", f"stares for low satellites: the shutter is open {100 * share:.0f} %"
            )
        there = icrs_of_hour_angle(self._site, *self._stare, now_ns)
        if separation_deg(*here, *there) < self._drift_deg():
            return self.plan_in_place(now_ns)
        plan = self._parts.planner.plan_exposure_at(there, now_ns, "stare", now_ns)
        refused = self._parts.slews.order(plan, t_until_utc_ns=self._parts.planner.end_utc_ns(plan))
        if refused is not None:
            self._parts.session_log.say("warning", f"stares where it stands: {text(refused)}")
            self._stare = self._of_date(here, now_ns)
            return self.plan_in_place(now_ns)
        self._note_slew(pose, there, now_ns)
        return plan

    def _waited(self, awaited: AwaitedPass, pose: Pose, now_ns: int) -> AimPlan:
        """Plan an exposure in place until shortly before the pass, then one on its path."""
        stare = awaited.stare
        until_ns = stare.from_utc_ns - _GO_THERE_NS
        if now_ns < until_ns:
            return self._parts.planner.plan_exposure_at(
                None, min(until_ns, now_ns + _LOOK_NS), "", now_ns
            )
        at_ns = max(now_ns, stare.from_utc_ns)
        place = expected_position(awaited, self._site, stare.t_through_utc_ns, 0.0)
        self._camera.set_exposure(leap_exposure_s(place, self._times.terms(self._camera.binning)))
        there = stare.direction_deg(self._site, at_ns)
        here = (pose.ra_icrs_deg, pose.dec_icrs_deg)
        if separation_deg(*here, *there) < self._drift_deg():
            return self._parts.planner.plan_exposure_at(None, at_ns, "", now_ns)
        plan = self._parts.planner.plan_exposure_at(there, at_ns, "await", now_ns)
        end_ns = max(self._parts.planner.end_utc_ns(plan), stare.until_utc_ns)
        refused = self._parts.slews.order(plan, t_until_utc_ns=end_ns)
        if refused is not None:
            self._parts.session_log.say("warning", f"cannot wait where it comes: {text(refused)}")
            self._awaiting.skip_pass()
            return self.plan_in_place(now_ns)
        self._note_slew(pose, there, now_ns)
        return plan

    def plan_in_place(self, now_ns: int) -> AimPlan:
        """Plan one more exposure where the telescope looks, without a slew."""
        return self._parts.planner.plan_exposure_at(None, now_ns, "", now_ns)

    def _note_slew(self, pose: Pose, there: tuple[float, float], now_ns: int) -> None:
        limits = self._times.telescope(self._camera.binning).limits
        self._times.ordered(limits.travel_deg(pose, *there), now_ns)

    def _drift_deg(self) -> float:
        return _DRIFT * min(self._control.config.optics.field_deg)

    def _where_to_stare(self, here: tuple[float, float], now_ns: int) -> tuple[float, float]:
        """Return the configured place of a search; without one, where the telescope points."""
        search, (hour_angle_deg, dec_deg) = self._control.config.search, self._of_date(here, now_ns)
        return (
            hour_angle_deg if search.hour_angle_deg is None else search.hour_angle_deg,
            dec_deg if search.declination_deg is None else search.declination_deg,
        )

    def _of_date(self, here: tuple[float, float], t_utc_ns: int) -> tuple[float, float]:
        hour_angle_deg = hour_angle_icrs_deg(self._site, *here, t_utc_ns)
        return hour_angle_deg, icrs_to_jnow(*here, t_utc_ns)[1]
