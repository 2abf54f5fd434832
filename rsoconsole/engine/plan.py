"""What the next exposure is: where, when, and whether the mount must move for it."""

from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.engine.hands import NS
from rsoconsole.instruments.ports import MountReport
from rsoconsole.pipeline.aim import (
    SearchBase,
    follow_direction,
    needs_recentre,
    search_base,
    search_base_at,
    search_direction,
    slew_to,
)
from rsoconsole.records import Frame, SlewCommand, Solution
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.limits import refusal
from rsoconsole.tracking.follow import Following
from rsoconsole.tracking.pointing import PointingOffset, command_for, observed, valid_at

Direction = tuple[float, float]

SLEW_RATE_DEG_S = 2.0
SLEW_OVERHEAD_S = 3.0
"""What a slew is reckoned to take, beside settling: a slow mount is only waited for longer."""
CLOCKS_APART_NS = 10 * NS


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
        here = (report.ra_icrs_deg, report.dec_icrs_deg)
        self._base = search_base(self._config.search, self._site, *here, now_utc_ns)
        self._search_number = 0
        self._pier_side = report.pier_side
        self._commanded = None
        self._centre = here

    def plan(self, following: Following, now_utc_ns: int) -> Plan:
        """The next exposure from here; changes nothing.

        Where to look depends on when, and when on how far it is: the way is reckoned once, for
        the direction of the earliest exposure.
        """
        earliest_ns = now_utc_ns
        if self._last_start_utc_ns is not None:
            cadence_ns = round(self._config.exposure.cadence_s * NS)
            earliest_ns = max(now_utc_ns, self._last_start_utc_ns + cadence_ns)
        first_guess, _ = self._direction(following, self._t_mid_ns(earliest_ns))
        arrival_ns = now_utc_ns + round(self._slew_s(first_guess) * NS)
        t_start_ns = max(earliest_ns, arrival_ns)
        t_mid_ns = self._t_mid_ns(t_start_ns)
        direction, reason = self._direction(following, t_mid_ns)
        moves = following.track is None or needs_recentre(
            self._config.search, self._config.optics.field_deg, self._centre, direction
        )
        slew = slew_to(self._frame_id, direction, t_mid_ns, reason) if moves else None
        return Plan(t_start_utc_ns=t_start_ns, t_mid_utc_ns=t_mid_ns, slew=slew)

    def _t_mid_ns(self, t_start_ns: int) -> int:
        exposure = self._config.exposure
        return t_start_ns + round((exposure.start_latency_s + exposure.exposure_s / 2.0) * NS)

    def _slew_s(self, direction: Direction) -> float:
        way_deg = 0.0 if self._centre is None else separation_deg(*self._centre, *direction)
        return SLEW_OVERHEAD_S + way_deg / SLEW_RATE_DEG_S + self._config.mount.settle_s

    def _direction(self, following: Following, t_mid_ns: int) -> tuple[Direction, str]:
        if following.track is not None:
            direction = follow_direction(following.track, t_mid_ns, self._config.filter)
            return direction, "prediction"
        reason = "wait for a second frame" if following.state == "ACQUIRE" else "search"
        return self._search_direction(t_mid_ns), reason

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

    def arrived(self, slew: SlewCommand, report: MountReport) -> bool:
        """The mount has done the slew; True when it has changed the side of the pier."""
        self._commanded = self.command(slew)
        has_flipped = report.pier_side != self._pier_side
        self._pier_side = report.pier_side
        self._centre = (slew.ra_icrs_deg, slew.dec_icrs_deg)
        return has_flipped

    def exposed(self, frame: Frame, opened_utc_ns: int) -> str | None:
        """A frame came; returns what is wrong with its time, None when nothing is."""
        self._frame_id = frame.frame_id
        self._last_start_utc_ns = opened_utc_ns
        if frame.t_start_utc_ns is None:
            return None
        apart_ns = frame.t_start_utc_ns - opened_utc_ns
        if abs(apart_ns) > CLOCKS_APART_NS:
            return (
                f"the camera's clock is {apart_ns / NS:+.0f} s off this machine's: synchronise"
                " both, every measurement is wrong by as much"
            )
        return None

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
        if after.state == "LOST" and self._centre is not None:
            self._base = search_base_at(self._site, *self._centre, now_utc_ns)
            self._search_number = 0
        elif after.state == "SEARCH" or (before.state, after.state) == ("ACQUIRE", "ACQUIRE"):
            # A false streak in every frame must not hold the search for a night.
            self._search_number += 1
