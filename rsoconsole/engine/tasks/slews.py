"""The loop's slews: planned, checked against the limits, ordered, and finished."""

from dataclasses import replace

from rsoconsole.base import RsoconsoleError
from rsoconsole.engine.aim.instrument_controller import (
    FAR_OFF_DEG,
    POLL_NS,
    AimPlan,
    InstrumentController,
    StoppedElsewhere,
)
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.engine.tasks._observed_motion import pose_of
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import MountReport
from rsoconsole.pipeline import slew_command
from rsoconsole.records import SlewCommand, SlewRefusal
from rsoconsole.sky import LimitName, separation_deg
from rsoconsole.tracking import Following
from rsoconsole.words import text


class NowhereError(RsoconsoleError):
    """The limits allow no field of the search."""

    def __init__(self, words: str, *, is_dawn: bool) -> None:
        super().__init__(words)
        self.is_dawn = is_dawn
        """True where the Sun will be too high before the end of an exposure."""


class Slews:
    """Plans the loop's slews, checks them against the limits, orders them and waits for them."""

    def __init__(
        self,
        instrument_controller: InstrumentController,
        planner: Planner,
        watch: Watch,
        session_log: SessionLog,
    ) -> None:
        self._instrument_controller = instrument_controller
        self._planner = planner
        self._watch = watch
        self._session_log = session_log
        self._commanded: tuple[SlewCommand, tuple[float, float]] | None = None
        """The last slew ordered, and the direction commanded to the mount for it."""

    def order_next(self, following: Following, *, is_held: bool) -> AimPlan:
        """Plan the next exposure and order its slew; return while the mount is on its way.

        ``is_held``: the operator's hold is on, so that no slew is ordered. Raises NowhereError when
        no field of the search is left, StoppedElsewhere when somebody else has moved the mount,
        Interrupted instead of moving the mount.
        """
        self._expect_mount_where_left(self._instrument_controller.mount_report())
        plan = self._planner.plan(
            following, self._instrument_controller.now_utc_ns(), self._refusal_of
        )
        for _, why in plan.refused:
            self._session_log.say("warning", f"slew refused: {text(why)}")
        if plan.slew is None:
            if plan.refused and following.track is None:
                # Twilight is everywhere at once; a wall may be in the way before it is asked for.
                dawn = next((w for _, w in plan.refused if w.kind == "twilight"), None)
                raise NowhereError(text(dawn or plan.refused[0][1]), is_dawn=dawn is not None)
            return plan
        if is_held:
            return replace(plan, slew=None)
        self._order(plan.slew)
        return plan

    def order(self, plan: AimPlan, *, t_until_utc_ns: int) -> SlewRefusal | None:
        """Order a plan's slew unless a limit forbids it; return that refusal, else None.

        ``t_until_utc_ns``: end of the stay there. Raises StoppedElsewhere when somebody else has
        moved the mount, Interrupted instead of moving it.
        """
        if plan.slew is None:
            return None
        self._expect_mount_where_left(self._instrument_controller.mount_report())
        refused = self._refusal_of(plan.slew, t_until_utc_ns)
        if refused is None:
            self._order(plan.slew)
        return refused

    def _order(self, slew: SlewCommand) -> None:
        self._planner.last_report = None  # until it has arrived nobody knows where it is
        to = self._planner.command(slew)
        self._instrument_controller.order_slew(*to)
        self._commanded = slew, to
        self._session_log.append(slew)

    def forget(self) -> None:
        """Forget the slew that was ordered, because autonomy no longer has control of the mount."""
        self._commanded = None

    def wait_for_slew(
        self, plan: AimPlan, *, is_held: bool, poll_ns: int = POLL_NS, settle_s: float | None = None
    ) -> bool:
        """Wait until the plan's slew is done; return True where the last plate solution is void.

        ``is_held``: the operator's hold is on; ``settle_s``: time to settle after the arrival, s,
        None for the configured time. Raises StoppedElsewhere when somebody else has moved or
        stopped the mount, InstrumentError when it does not arrive.
        """
        if plan.slew is not None:
            # A frame that came since may have taught another pointing offset.
            slew, commanded = plan.slew, self._commanded
            to = (
                commanded[1]
                if commanded is not None and commanded[0] == slew
                else self._planner.command(slew)
            )
            report = self._instrument_controller.wait_for_arrival(
                *to, poll_ns=poll_ns, settle_s=settle_s
            )
            self._commanded = None
            return self._planner.note_arrival(slew, report, to)
        report = self._instrument_controller.mount_report()
        if report.is_slewing or self._commanded is not None:
            # A hold came while the loop's own slew was under way, or somebody set the clock. The
            # mount may have arrived since, in a place that was never taken over.
            rested = self._instrument_controller.wait_for_rest() if report.is_slewing else report
            if not is_held:
                self._expect_mount_where_left(rested)
            self._commanded = None
            self._planner.moved_by_hand(rested)
            return True
        self._expect_mount_where_left(report)
        return False

    def _expect_mount_where_left(self, report: MountReport) -> None:
        known = self._planner.last_report
        if known is None or report.is_slewing:
            return
        off_deg = separation_deg(
            report.ra_icrs_deg, report.dec_icrs_deg, known.ra_icrs_deg, known.dec_icrs_deg
        )
        if off_deg > FAR_OFF_DEG:
            raise StoppedElsewhere(f"the mount stands {off_deg:.1f} deg from where it was left")

    def direction_refusal(
        self, direction: tuple[float, float], now_utc_ns: int
    ) -> SlewRefusal | None:
        """Return why the telescope must not look at a direction now; None when it may."""
        command = self._planner.command(slew_command(0, direction, now_utc_ns, ""))
        return self.refusal(command, now_utc_ns, now_utc_ns)

    def refusal(
        self,
        to_icrs_deg: tuple[float, float],
        t_aim_utc_ns: int,
        t_until_utc_ns: int,
        lifted: frozenset[LimitName] = frozenset(),
    ) -> SlewRefusal | None:
        """Return why the mount must not go to a direction; None when it may.

        The same rule holds for the loop and the operator. ``t_aim_utc_ns``, ``t_until_utc_ns``:
        when the telescope looks there, and until when it stays; ``lifted``: limits that do not
        count.
        """
        start = self._instrument_controller.mount_report()
        refusal = self._watch.limits.refuse_slew(
            replace(pose_of(start), t_utc_ns=self._instrument_controller.now_utc_ns()),
            *to_icrs_deg,
            t_aim_utc_ns=t_aim_utc_ns,
            t_until_utc_ns=t_until_utc_ns,
            lifted=self._watch.lifted_limits() | lifted,
        )
        return None if refusal is None else refusal.reason

    def _refusal_of(self, slew: SlewCommand, t_until_utc_ns: int) -> SlewRefusal | None:
        """Return why the limits forbid a slew of the loop; None when they do not."""
        return self.refusal(self._planner.command(slew), slew.t_aim_utc_ns, t_until_utc_ns)
