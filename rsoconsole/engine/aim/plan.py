"""Plans the next exposure: where, when, and whether the mount must move for it."""

from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.control import NextAim
from rsoconsole.engine.aim._search import Direction, SearchSequence
from rsoconsole.engine.aim.guide import Guide
from rsoconsole.engine.aim.instrument_controller import (
    FLIP_WAY_DEG,
    NS,
    SLEW_OVERHEAD_S,
    AimPlan,
    IsRefused,
)
from rsoconsole.engine.aim.star_drift import StarDrift
from rsoconsole.instruments import MountReport, PierSide
from rsoconsole.pipeline import (
    flip_refusal,
    follow_direction,
    group_direction,
    needs_recentre,
    pier_side_after_slew,
    slew_command,
)
from rsoconsole.records import Frame, SlewCommand, SlewRefusal, Solution, TrackState
from rsoconsole.sky import Pose, hour_angle_jnow_deg, icrs_to_jnow, separation_deg, wrap_180
from rsoconsole.tracking import Following, PointingModel, pointing_command, with_solved_frame


class Planner:
    """Plans exposures; keeps the cadence, the telescope's direction and its pointing offset."""

    def __init__(self, config: Config, guide: Guide | None = None) -> None:
        """``guide``: predicts directions by the orbit of the lead track, or of a lost track."""
        self._config = config
        self._guide = guide
        self._site = config.site.to_site()
        self._search = SearchSequence(config)
        self._is_block_reported = False
        self._is_waiting = False
        """True while a lost track is waited for where its orbit predicts it."""
        self._last_start_utc_ns: int | None = None
        self._last_mid_utc_ns = 0
        self._frame_id = 0
        self._commanded: Direction | None = None
        self._centre: Direction | None = None
        self._pier_side: PierSide | None = None
        self._pointing = PointingModel()
        self.drift = StarDrift()
        self._planned: tuple[SlewCommand | None, int] = (None, 0)
        self.last_report: MountReport | None = None
        """The mount's last report while it was at rest; None while it moves, or none came."""

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config
        self._search.configure(config)

    def start_search(self, report: MountReport, now_utc_ns: int) -> None:
        """Start a search at the configured place, completed by where the mount points.

        The mount's direction gives a missing hour angle and, with pattern ``stay``, a missing
        declination; with other patterns a missing declination is that of the geostationary belt.
        """
        self._search.start(self.looking_at(report), now_utc_ns)
        self._is_block_reported = self._is_waiting = False
        self._stands_at(report)

    def search_about(self, direction: Direction, t_utc_ns: int) -> None:
        """Search around a direction in a widening spiral."""
        self._search.start_spiral(direction, t_utc_ns)
        self._is_block_reported = self._is_waiting = False

    def leave_spiral(self) -> bool:
        """Leave a spiral search for the search's first field; False where there was no spiral."""
        if not self._search.is_spiral:
            return False
        self._search.return_to_first_field()
        return True

    def go_home(self) -> None:
        """Start the search again at its first field."""
        self._is_waiting = False
        self._search.return_to_first_field()

    def moved_by_hand(self, report: MountReport) -> None:
        """Note the mount's report after a move by hand as the telescope's direction.

        The pointing offsets learned for each side of the pier and each part of the sky are kept.
        """
        self._is_waiting = False
        self._search.return_to_round()
        self._stands_at(report)

    def looking_at(self, report: MountReport) -> Direction:
        """Return where the telescope looks, ICRS degrees: the report and its pointing offset."""
        here = (report.ra_icrs_deg, report.dec_icrs_deg)
        known = self._pointing.at(*self._axes(here, report.t_utc_ns), report.pier_side)
        back = replace(known, east_arcsec=-known.east_arcsec, north_arcsec=-known.north_arcsec)
        return pointing_command(back, *here)

    def _stands_at(self, report: MountReport) -> None:
        self.drift.note_move()
        # On its way nobody knows where it will be.
        self.last_report = None if report.is_slewing else report
        self._pier_side = report.pier_side
        self._centre = self.looking_at(report)
        # A mount that stands still loses its place among the stars before the next frame.
        is_kept = report.is_tracking and not report.is_slewing
        self._commanded = (report.ra_icrs_deg, report.dec_icrs_deg) if is_kept else None

    def plan_exposure_here(self, now_utc_ns: int) -> AimPlan:
        """Plan an exposure where the telescope points, without a slew.

        The search waits there for what the exposure shows. In the search's first field, the
        exposure counts as that field's first.
        """
        plan = self._in_place(now_utc_ns)
        if self._centre is not None:
            self._search.stay_for_next_exposure(self._centre, plan.t_mid_utc_ns)
        return plan

    def pose(self, now_utc_ns: int) -> Pose | None:
        """Return the telescope's direction and side of the pier now; None where not known."""
        if self._centre is None:
            return None
        ra_deg, dec_deg = self._centre
        return Pose(
            t_utc_ns=now_utc_ns, ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg, pier_side=self._pier_side
        )

    def plan_exposure_at(
        self,
        direction: Direction | None,
        t_start_utc_ns: int,
        reason: str,
        now_utc_ns: int,
        *,
        t_mid_utc_ns: int | None = None,
        frame_id: int | None = None,
    ) -> AimPlan:
        """Plan an exposure at an instant and a direction; None: where the telescope looks already.

        ``t_mid_utc_ns``: mid-exposure; None: by the configured exposure. ``frame_id``: the frame
        after which the exposure is planned; None: the last frame that has come.
        """
        t_mid_ns = self._t_mid_ns(t_start_utc_ns) if t_mid_utc_ns is None else t_mid_utc_ns
        slew = None
        if direction is not None:
            after = self._frame_id if frame_id is None else frame_id
            slew = slew_command(after, direction, t_mid_ns, reason, None)
            self._planned = (slew, now_utc_ns)
        return AimPlan(t_start_utc_ns=t_start_utc_ns, t_mid_utc_ns=t_mid_ns, slew=slew)

    def plan(
        self, following: Following, now_utc_ns: int, is_refused: IsRefused | None = None
    ) -> AimPlan:
        """Plan the next exposure, from the telescope's present position.

        A search field that is refused is passed over for the next one. Where a track's direction is
        refused, the telescope stays where it is.
        """
        if following.track is not None:
            return self._plan_track(following, now_utc_ns, is_refused)
        if (plan := self._plan_lost(following, now_utc_ns, is_refused)) is not None:
            return plan
        refused: list[tuple[SlewCommand, SlewRefusal]] = []
        news: list[tuple[SlewCommand, SlewRefusal]] = []
        for number in self._search.exposure_numbers_to_try():
            plan = self._plan_at(following, number, now_utc_ns)
            assert plan.slew is not None, "a search goes somewhere"
            why = None if is_refused is None else is_refused(plan.slew, self.end_utc_ns(plan))
            if why is None:
                self._search.take(number)
                return replace(plan, refused=tuple(news))
            refused.append((plan.slew, why))
            if self._search.is_first_refusal(number):
                news.append((plan.slew, why))
        if self._search.return_to_round():
            return self.plan(following, now_utc_ns, is_refused)
        return self._in_place(now_utc_ns, tuple(refused))

    def _plan_track(
        self, following: Following, now_utc_ns: int, is_refused: IsRefused | None
    ) -> AimPlan:
        plan = self._plan_at(following, self._search.number, now_utc_ns)
        if plan.slew is None:
            return plan
        to = (plan.slew.ra_icrs_deg, plan.slew.dec_icrs_deg)
        mount = self._config.mount
        why = flip_refusal(self._site, mount, to, now_utc_ns, self._pier_side)
        if why is None and is_refused is not None:
            why = is_refused(plan.slew, self.end_utc_ns(plan))
        if why is None:
            self._is_block_reported = False
            return plan
        refused = () if self._is_block_reported else ((plan.slew, why),)
        self._is_block_reported = True
        return self._in_place(now_utc_ns, refused, why)

    def _plan_lost(
        self, following: Following, now_utc_ns: int, is_refused: IsRefused | None
    ) -> AimPlan | None:
        """Plan an exposure where a lost track's orbit predicts it; None where none is awaited."""
        if not self._is_waiting or self._guide is None:
            return None
        if self._guide.lost_track_direction(self._t_mid_ns(self._earliest_ns(now_utc_ns))) is None:
            self._is_waiting = False
            return None
        if following.candidates and not any(
            map(self._guide.may_be_lost_object, following.candidates)
        ):
            # A stranger is waited for where it was seen.
            if self._centre is not None:
                self._search.stay_for_next_exposure(self._centre, self._last_mid_utc_ns)
            return None
        plan = self._plan_at(following, self._search.number, now_utc_ns)
        if plan.slew is None or is_refused is None:
            return plan
        self._is_waiting = is_refused(plan.slew, self.end_utc_ns(plan)) is None
        return plan if self._is_waiting else None

    def _in_place(
        self,
        now_utc_ns: int,
        refused: tuple[tuple[SlewCommand, SlewRefusal], ...] = (),
        blocked: SlewRefusal | None = None,
    ) -> AimPlan:
        t_start_ns = self._earliest_ns(now_utc_ns)
        return AimPlan(
            t_start_utc_ns=t_start_ns,
            t_mid_utc_ns=self._t_mid_ns(t_start_ns),
            slew=None,
            refused=refused,
            blocked=blocked,
        )

    def _plan_at(self, following: Following, search_number: int, now_utc_ns: int) -> AimPlan:
        """Plan the exposure of a track, or of the n-th place of a search.

        Direction and start depend on each other: the slew is computed once, for the direction of
        the earliest exposure.
        """
        earliest_ns = self._earliest_ns(now_utc_ns)
        first_mid_ns = self._t_mid_ns(earliest_ns)
        direction, reason = self._direction(following, search_number, first_mid_ns)
        arrival_ns = now_utc_ns + round(self.slew_s(direction, now_utc_ns) * NS)
        t_start_ns = max(earliest_ns, arrival_ns)
        t_mid_ns = self._t_mid_ns(t_start_ns)
        if t_start_ns > earliest_ns:
            direction, reason = self._direction(following, search_number, t_mid_ns)
        moves = following.track is None or needs_recentre(
            self._config.search, self._config.optics.field_deg, self._centre, direction
        )
        to = following.track_id
        slew = slew_command(self._frame_id, direction, t_mid_ns, reason, to) if moves else None
        self._planned = (slew, now_utc_ns)
        return AimPlan(t_start_utc_ns=t_start_ns, t_mid_utc_ns=t_mid_ns, slew=slew)

    def _earliest_ns(self, now_utc_ns: int) -> int:
        last = self._last_start_utc_ns
        if last is None or last > now_utc_ns:
            return now_utc_ns  # the first one, or somebody has set the clock back
        cadence_ns = round(self._config.exposure.cadence_s * NS)
        return max(now_utc_ns, last + cadence_ns)

    def _t_mid_ns(self, t_start_ns: int) -> int:
        exposure = self._config.exposure
        return t_start_ns + round((exposure.start_latency_s + exposure.exposure_s / 2.0) * NS)

    def end_utc_ns(self, plan: AimPlan) -> int:
        """Return the instant at which the shutter closes, UTC ns."""
        return plan.t_mid_utc_ns + round(self._config.exposure.exposure_s / 2.0 * NS)

    def slew_s(self, direction: Direction, t_utc_ns: int) -> float:
        """Return the duration of a slew from where the telescope looks, settling included, s."""
        mount = self._config.mount
        way_deg = 0.0
        if self._centre is not None:
            ra_way_deg = abs(wrap_180(direction[0] - self._centre[0]))
            way_deg = max(ra_way_deg, abs(direction[1] - self._centre[1]))
        if self.pier_side_after_slew(direction, t_utc_ns) != self._pier_side:
            way_deg = FLIP_WAY_DEG
        return SLEW_OVERHEAD_S + way_deg / mount.slew_rate_deg_s + mount.settle_s

    def slew_left_s(self, report: MountReport, to: Direction, sent_utc_ns: int) -> float | None:
        """Return the time left of a slew under way, s; None for a mount that does not slew.

        ``to``: the slew's target in the mount's own coordinates; ``sent_utc_ns``: when it was
        ordered.
        """
        if not report.is_slewing:
            return None
        rate_deg_s = self._config.mount.slew_rate_deg_s
        way_deg = max(abs(wrap_180(to[0] - report.ra_icrs_deg)), abs(to[1] - report.dec_icrs_deg))
        if self.pier_side_after_slew(to, report.t_utc_ns) != report.pier_side:
            gone_s = max((report.t_utc_ns - sent_utc_ns) / NS, 0.0)
            way_deg = max(way_deg, FLIP_WAY_DEG - rate_deg_s * gone_s)
        return way_deg / rate_deg_s

    def pier_side_after_slew(self, direction: Direction, t_utc_ns: int) -> PierSide | None:
        """Return the side of the pier after a slew to a direction; None where not known."""
        mount = self._config.mount
        return pier_side_after_slew(self._site, mount, direction, t_utc_ns, self._pier_side)

    def _direction(
        self, following: Following, search_number: int, t_mid_ns: int
    ) -> tuple[Direction, str]:
        config = self._config
        if following.track is not None:
            direction, reason = self._of_lead(following.track, t_mid_ns)
            if config.aim.is_offset:
                return direction, f"{reason}, offset by hand"
            return self._among(following, direction, t_mid_ns, reason)
        if self._is_waiting and not self._search.is_outside_round and self._guide is not None:
            by_orbit = self._guide.lost_track_direction(t_mid_ns)
            if by_orbit is not None:
                return by_orbit, "where its orbit says"
        return self._search.direction(
            search_number, t_mid_ns, is_waiting=following.state == "ACQUIRE"
        )

    def _of_lead(self, track: TrackState, t_mid_ns: int) -> tuple[Direction, str]:
        """Return the lead's predicted direction, the operator's offset added, and its source."""
        by_orbit = None if self._guide is None else self._guide.track_direction(t_mid_ns)
        if by_orbit is not None:
            return by_orbit, "orbit"
        config = self._config
        return follow_direction(track, t_mid_ns, config.filter, config.aim), "filter"

    def aim_after_plan(
        self, following: Following, planned: AimPlan | None, now_utc_ns: int
    ) -> tuple[NextAim, Direction] | None:
        """Return the aim of the exposure after ``planned``, and the lead track's direction then.

        None without a track. Only computes: nothing is ordered.
        """
        if following.track is None:
            return None
        config, centre = self._config, self._centre
        t_start_ns = now_utc_ns
        if planned is not None:
            t_start_ns = planned.t_start_utc_ns + round(config.exposure.cadence_s * NS)
            if planned.slew is not None:
                centre = (planned.slew.ra_icrs_deg, planned.slew.dec_icrs_deg)
        t_mid_ns = self._t_mid_ns(t_start_ns)
        direction, reason = self._direction(following, self._search.number, t_mid_ns)
        is_slew = needs_recentre(config.search, config.optics.field_deg, centre, direction)
        way_deg = 0.0 if centre is None else separation_deg(*centre, *direction)
        aim = NextAim(
            ra_icrs_deg=direction[0] % 360.0,
            dec_icrs_deg=direction[1],
            t_utc_ns=t_mid_ns,
            policy="lead" if config.filter.preset == "paper" else config.aim.policy,
            reason=reason,
            moves_arcmin=60.0 * way_deg if is_slew else None,
        )
        return aim, self._of_lead(following.track, t_mid_ns)[0]

    def _among(
        self, following: Following, lead: Direction, t_mid_ns: int, reason: str
    ) -> tuple[Direction, str]:
        """Return the aim for all tracks by ``aim.policy``, and its reason in words."""
        config = self._config
        policy, tracks = config.aim.policy, [each.track for each in following.tracks]
        if policy == "lead" or config.filter.preset == "paper" or len(tracks) < 2:
            return lead, reason
        direction, inside = group_direction(
            tracks,
            lead,
            t_mid_ns,
            policy,
            field_deg=config.optics.field_deg,
            exposure_s=config.exposure.exposure_s,
            settings=config.filter,
        )
        return direction, f"{reason}, {inside} of {len(tracks)} in the field"

    def command(self, slew: SlewCommand) -> Direction:
        """Return the direction to command, ICRS degrees, so that a slew reaches its target."""
        to = (slew.ra_icrs_deg, slew.dec_icrs_deg)
        planned, planned_utc_ns = self._planned
        # The mount chooses its side when it is told, not when it arrives.
        ordered_utc_ns = planned_utc_ns if slew == planned else slew.t_aim_utc_ns
        side = self.pier_side_after_slew(to, ordered_utc_ns)
        return pointing_command(self._pointing.at(*self._axes(to, slew.t_aim_utc_ns), side), *to)

    def _axes(self, direction: Direction, t_utc_ns: int) -> Direction:
        """Return hour angle and declination of date."""
        ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(*direction, t_utc_ns)
        return hour_angle_jnow_deg(self._site, ra_jnow_deg, t_utc_ns), dec_jnow_deg

    def note_arrival(self, slew: SlewCommand, report: MountReport, sent_to: Direction) -> bool:
        """Note that the mount has done a slew; True when it has changed the side of the pier.

        ``sent_to``: the direction that was commanded, ICRS degrees.
        """
        self.drift.note_move()
        self._commanded = sent_to
        has_flipped = report.pier_side != self._pier_side
        self.last_report = report
        self._pier_side = report.pier_side
        self._centre = (slew.ra_icrs_deg, slew.dec_icrs_deg)
        return has_flipped

    def note_frame(self, frame: Frame, opened_utc_ns: int) -> None:
        """Note a frame, whose shutter opened at that instant by this machine's clock."""
        self._frame_id = frame.frame_id
        self._last_start_utc_ns = opened_utc_ns
        self._last_mid_utc_ns = self._t_mid_ns(opened_utc_ns)
        self.drift.note_frame(frame.frame_id, self._last_mid_utc_ns)

    def note_solution(self, solution: Solution) -> None:
        """Learn the telescope's true direction and its pointing offset from a plate solution."""
        self._centre = (solution.ra_icrs_deg, solution.dec_icrs_deg)
        if self._commanded is None:
            return
        hour_angle_deg, declination_deg = self._axes(self._commanded, self._last_mid_utc_ns)
        self._pointing = with_solved_frame(
            self._pointing,
            commanded_ra_deg=self._commanded[0],
            commanded_dec_deg=self._commanded[1],
            solved_ra_deg=solution.ra_icrs_deg,
            solved_dec_deg=solution.dec_icrs_deg,
            hour_angle_deg=hour_angle_deg,
            declination_deg=declination_deg,
            pier_side=self._pier_side,
        )

    def update_search(self, before: Following, after: Following, now_utc_ns: int) -> None:
        """Update the search after a frame: count it, or start one around a lost track."""
        is_held = (before.state, after.state) == ("ACQUIRE", "ACQUIRE")
        if after.state == "LOST" and self._centre is not None:
            self._search.start_around_lost_track(self._centre, now_utc_ns)
            self._is_waiting = self._guide is not None
        elif self._is_waiting:
            self._is_waiting = after.track is None
            if after.state != "ACQUIRE":
                self._search.return_to_round()
        elif after.state == "SEARCH" or is_held:
            # A false streak in every frame must not hold the search for a night.
            self._search.count(self._centre, self._last_mid_utc_ns)
        elif after.state != "ACQUIRE":
            self._search.return_to_round()
