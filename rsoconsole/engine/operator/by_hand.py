"""Commands that move the mount by hand (go to, nudge, track, unpark), and previews of moves."""

import math
from dataclasses import dataclass

from rsoconsole.control import (
    AimOffset,
    Command,
    Goto,
    MovePreview,
    Nudge,
    Preview,
    SetTracking,
    Unpark,
)
from rsoconsole.engine.aim.guide import Guide
from rsoconsole.engine.aim.instrument_controller import NS, InstrumentController
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.engine.aim.states import Taken
from rsoconsole.engine.operator.handlers import Accepted, Handler, Handlers, LoopControl
from rsoconsole.engine.tasks.pace import config_with_setting
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.engine.tasks.slews import Slews
from rsoconsole.engine.tasks.watch import LIFTS, Watch
from rsoconsole.pipeline import follow_direction, slew_command
from rsoconsole.records import CommandResult, done_result
from rsoconsole.sky import Pose, icrs_to_altaz, icrs_to_jnow, separation_deg, wrap_360
from rsoconsole.words import text

Direction = tuple[float, float]
Move = Goto | Nudge
PARKED = "the mount is parked: unpark it first"


@dataclass(frozen=True, slots=True, kw_only=True)
class HandMove:
    """A move by hand under way."""

    direction: Direction
    """Direction at which the telescope is to look, ICRS degrees."""
    command: Direction
    """Direction commanded to the mount for that, in its own coordinates, ICRS degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The parts of the engine that moves by hand, frames and leaps share."""

    instrument_controller: InstrumentController
    planner: Planner
    slews: Slews
    watch: Watch
    guide: Guide
    session_log: SessionLog


class ByHand:
    """Executes the operator's moves of the mount, within its limits; keeps the present one."""

    def __init__(self, control: LoopControl, parts: Parts) -> None:
        self._control = control
        self._parts = parts
        self.move: HandMove | None = None
        """The move by hand under way; None once it has arrived."""

    @property
    def handlers(self) -> Handlers:
        """Handlers of the commands ``goto``, ``nudge``, ``track`` and ``unpark``, by class."""
        move = Handler(check=self._check_move, expect=self._expect_unparked, execute=self._move)
        return {
            Goto: move,
            Nudge: move,
            SetTracking: Handler(expect=self._expect_free, execute=self._track),
            Unpark: Handler(expect=self._expect_park, execute=self._unpark),
        }

    def preview(self, preview: Preview) -> MovePreview:
        """Return the preview of a move: its target, distance, duration and limits; nothing moves.

        Raises ValueError for a move whose target is not known, InstrumentError when the mount is
        silent.
        """
        direction = self._wanted(preview.move)
        now_ns = self._parts.instrument_controller.now_utc_ns()
        site = self._control.config.site.to_site()
        here = self._looks_at()
        report = self._parts.instrument_controller.mount_report()
        alt_deg, az_deg = icrs_to_altaz(site, *direction, now_ns)
        ra_date_deg, dec_date_deg = icrs_to_jnow(*direction, now_ns)
        pose = Pose(
            t_utc_ns=now_ns, ra_icrs_deg=direction[0], dec_icrs_deg=direction[1], pier_side=None
        )
        margins = self._parts.watch.limits.margins_deg(pose)
        override = () if isinstance(preview.move, AimOffset) else preview.move.override
        return MovePreview(
            ra_icrs_deg=direction[0],
            dec_icrs_deg=direction[1],
            ra_date_deg=ra_date_deg,
            dec_date_deg=dec_date_deg,
            alt_deg=alt_deg,
            az_deg=az_deg,
            way_deg=separation_deg(*here, *direction),
            slew_s=self._parts.planner.slew_s(direction, now_ns),
            pier_side=report.pier_side,
            pier_side_after=self._parts.planner.pier_side_after_slew(direction, now_ns),
            margins_deg=tuple(margin for margin in margins if math.isfinite(margin[1])),
            refused=PARKED if report.is_parked else self._refusal(direction, override),
        )

    def _check_move(self, command: Move, _by: str) -> Accepted:
        direction = self._possible(command)
        commanded = self._command(direction)
        data = {
            "ra_icrs_deg": direction[0],
            "dec_icrs_deg": direction[1],
            "command_ra_icrs_deg": float(commanded[0]),
            "command_dec_icrs_deg": float(commanded[1]),
        }
        return Accepted(message="on its way; you have the mount", data=data)

    def _expect_unparked(self, _command: Command, _by: str) -> None:
        if self._parts.instrument_controller.mount_report().is_parked:
            raise ValueError(PARKED)

    def _move(self, command: Move, by: str) -> CommandResult:
        self._expect_unparked(command, by)
        direction = self._possible(command)
        report = self._parts.instrument_controller.mount_report()
        if report.is_slewing or report.is_parking:
            # Nudges add up; beside another motion than theirs they count from where that ends.
            adds_up = self.move is not None
            self._end_motion(by)
            if not adds_up:
                direction = self._possible(command)
        commanded = self._command(direction)
        self._parts.instrument_controller.order_slew(*commanded)
        self._control.handle(Taken(by=by))
        self.move = HandMove(direction=direction, command=commanded)
        now_ns = self._parts.instrument_controller.now_utc_ns()
        reason = f"{command.verb} by {by}"
        self._parts.session_log.append(
            slew_command(self._control.frame_id, direction, now_ns, reason)
        )
        return done_result("on its way")

    def _possible(self, command: Move) -> Direction:
        """Return the direction of a move, ICRS degrees.

        Raises ValueError where the telescope must not go there.
        """
        direction = self._wanted(command)
        refused = self._refusal(direction, command.override)
        if refused is not None:
            raise ValueError(refused)
        return direction

    def _end_motion(self, by: str) -> None:
        """End any motion and its target; returns when the mount rests.

        Some drivers accept no new target while they move. The operator has control from here on,
        even where the mount then refuses to go.
        """
        self._control.handle(Taken(by=by))
        self._control.end_park()
        if self._parts.instrument_controller.mount_report().is_slewing:
            self._parts.instrument_controller.end_motion()

    def _expect_free(self, command: SetTracking, by: str) -> None:
        if self._control.authority.is_autonomous:
            raise ValueError("autonomy has the mount: disarm it first")
        self._expect_unparked(command, by)

    def _track(self, command: SetTracking, by: str) -> CommandResult:
        """Turn sidereal tracking on or off; on ends a park under way."""
        self._expect_free(command, by)
        if command.is_on:
            self._control.end_park()
        self._parts.instrument_controller.instruments.mount.set_tracking(command.is_on)
        return done_result(
            "the mount tracks" if command.is_on else "tracking is off: the mount stands"
        )

    def _expect_park(self, _command: Unpark, _by: str) -> None:
        report = self._parts.instrument_controller.mount_report()
        if not (report.is_parked or report.is_parking or self._control.is_park_wanted):
            raise ValueError("the mount is not parked")

    def _unpark(self, _command: Unpark, _by: str) -> CommandResult:
        self._control.end_park()
        return done_result("the mount is not parked any more")

    def _wanted(self, move: Move | AimOffset) -> Direction:
        """Return the direction of a move, ICRS degrees."""
        if isinstance(move, Goto):
            return float(wrap_360(move.ra_icrs_deg)), move.dec_icrs_deg
        if isinstance(move, AimOffset):
            return self._beside(move)
        ra_deg, dec_deg = self._looks_at()
        dec_after_deg = min(max(dec_deg + move.north_arcmin / 60.0, -90.0), 90.0)
        cos_dec = max(math.cos(math.radians(dec_after_deg)), 1e-3)
        return float(wrap_360(ra_deg + move.east_arcmin / 60.0 / cos_dec)), dec_after_deg

    def _beside(self, move: AimOffset) -> Direction:
        """Return a place beside the lead track, as it is at this moment."""
        track = self._control.following.track
        if track is None:
            raise ValueError("nothing is followed: there is no prediction to look beside")
        config = self._control.config
        for name, value in move.settings().items():
            config = config_with_setting(config, name, value)
        now_ns = self._parts.instrument_controller.now_utc_ns()
        by_orbit = self._parts.guide.track_direction(now_ns, config.aim)
        return by_orbit or follow_direction(track, now_ns, config.filter, config.aim)

    def _refusal(self, direction: Direction, override: tuple[str, ...]) -> str | None:
        """Return the limit that this move would break; None when none."""
        now_ns = self._parts.instrument_controller.now_utc_ns()
        exposure = self._control.config.exposure
        until_ns = now_ns + round((exposure.cadence_s + exposure.exposure_s) * NS)
        lifted = frozenset(LIFTS[name] for name in override if name in LIFTS)
        refusal = self._parts.slews.refusal(self._command(direction), now_ns, until_ns, lifted)
        return None if refusal is None else text(refusal)

    def _looks_at(self) -> Direction:
        """Return where the telescope looks; during a slew its target, so that nudges add up."""
        move = self.move
        if move is not None:
            return move.direction
        return self._parts.planner.looking_at(self._parts.instrument_controller.mount_report())

    def _command(self, direction: Direction) -> Direction:
        now_ns = self._parts.instrument_controller.now_utc_ns()
        return self._parts.planner.command(
            slew_command(self._control.frame_id, direction, now_ns, "by hand")
        )
