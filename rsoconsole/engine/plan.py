"""What the next exposure is: where, when, and whether the mount must move for it."""

from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.engine.hands import NS, SLEW_OVERHEAD_S, SLEW_RATE_DEG_S
from rsoconsole.instruments.ports import MountReport
from rsoconsole.pipeline.aim import (
    SearchBase,
    follow_direction,
    needs_recentre,
    search_base,
    search_direction,
    slew_to,
)
from rsoconsole.records import Frame, SlewCommand, Solution
from rsoconsole.sky.limits import refusal
from rsoconsole.tracking.follow import Following
from rsoconsole.tracking.pointing import PointingOffset, command_for, observed, valid_at

Direction = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The next exposure."""

    t_start_utc_ns: int
    t_mid_utc_ns: int
    slew: SlewCommand | None


class Planner:
    """Keeps what planning needs from one exposure to the next: cadence, centre, offset."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._site = config.site.to_site()
        self._base: SearchBase | None = None
        self._search_number = 0
        self._last_start_utc_ns: int | None = None
        self._frame_id = 0
        self._commanded: Direction | None = None
        self._centre: Direction | None = None
        self._pier_side: str | None = None
        self._offset = PointingOffset()

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        self._config = config

    def start_search(self, report: MountReport, now_utc_ns: int) -> None:
        """Search around where the mount points, or where the configuration says."""
        self._begin_search((report.ra_icrs_deg, report.dec_icrs_deg), now_utc_ns)
        self._pier_side = report.pier_side
        self._commanded = None
        self._centre = None

    def _begin_search(self, direction: Direction, now_utc_ns: int) -> None:
        self._base = search_base(self._config.search, self._site, *direction, now_utc_ns)
        self._search_number = 0

    def plan(self, following: Following, now_utc_ns: int) -> Plan:
        """The next exposure from here; changes nothing."""
        exposure = self._config.exposure
        move_s = SLEW_OVERHEAD_S + 1.0 / SLEW_RATE_DEG_S + self._config.mount.settle_s
        t_start_ns = now_utc_ns + round(move_s * NS)
        if self._last_start_utc_ns is not None:
            t_start_ns = max(t_start_ns, self._last_start_utc_ns + round(exposure.cadence_s * NS))
        to_middle_s = exposure.start_latency_s + exposure.exposure_s / 2.0
        t_mid_ns = t_start_ns + round(to_middle_s * NS)
        if following.track is not None:
            direction = follow_direction(following.track, t_mid_ns, self._config.filter)
            moves = needs_recentre(
                self._config.search, self._config.optics.field_deg, self._centre, direction
            )
            reason = "prediction"
        else:
            direction = self._search_direction(t_mid_ns)
            moves = True
            reason = "search" if following.state != "ACQUIRE" else "wait for a second frame"
        slew = slew_to(self._frame_id, direction, t_mid_ns, reason) if moves else None
        return Plan(t_start_utc_ns=t_start_ns, t_mid_utc_ns=t_mid_ns, slew=slew)

    def _search_direction(self, t_mid_ns: int) -> Direction:
        if self._base is None:
            raise RuntimeError("a search is planned before it was started")
        return search_direction(
            self._base,
            self._config.search,
            self._site,
            field_width_deg=self._config.optics.field_deg[0],
            exposure_number=self._search_number,
            t_utc_ns=t_mid_ns,
        )

    def refusal(self, plan: Plan) -> str | None:
        """Why the plan's slew must not be done; None when it may."""
        if plan.slew is None:
            return None
        return refusal(
            plan.slew.ra_icrs_deg,
            plan.slew.dec_icrs_deg,
            plan.t_mid_utc_ns,
            self._site,
            self._config.mount,
        )

    def command(self, slew: SlewCommand) -> Direction:
        """What to tell the mount so that it looks where the slew wants."""
        offset = valid_at(self._offset, slew.ra_icrs_deg, slew.dec_icrs_deg, self._pier_side)
        return command_for(offset, slew.ra_icrs_deg, slew.dec_icrs_deg)

    def arrived(self, slew: SlewCommand, report: MountReport) -> None:
        """The mount has done the slew."""
        self._commanded = self.command(slew)
        self._pier_side = report.pier_side
        self._centre = (slew.ra_icrs_deg, slew.dec_icrs_deg)

    def exposed(self, frame: Frame, now_utc_ns: int) -> None:
        """A frame came."""
        self._frame_id = frame.frame_id
        self._last_start_utc_ns = frame.t_start_utc_ns or now_utc_ns

    def solved(self, solution: Solution) -> None:
        """The telescope's true direction became known."""
        self._centre = (solution.ra_icrs_deg, solution.dec_icrs_deg)
        if self._commanded is not None:
            self._offset = observed(
                self._offset,
                commanded_ra_deg=self._commanded[0],
                commanded_dec_deg=self._commanded[1],
                solved_ra_deg=solution.ra_icrs_deg,
                solved_dec_deg=solution.dec_icrs_deg,
                pier_side=self._pier_side,
            )

    def followed(self, before: Following, after: Following, now_utc_ns: int) -> None:
        """One exposure of a search is done, or a track was lost and is to be looked for here."""
        if after.state == "SEARCH":
            self._search_number += 1
        elif after.state == "LOST" and before.track is not None and self._centre is not None:
            self._begin_search(self._centre, now_utc_ns)
