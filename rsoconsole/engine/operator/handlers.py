"""Handlers of commands: checked on the wire's threads, executed on the loop's thread.

Each part of the engine provides the handlers of its own commands (``by_hand.py``,
``decisions.py``); the loop and the command handler only look them up.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from rsoconsole.config import Config
from rsoconsole.control import Abort, Arm, Command, Disarm, Hold, Park, Resume, Seek, Set, Shutdown
from rsoconsole.engine.aim.guide import Guide
from rsoconsole.engine.aim.instrument_controller import InstrumentController
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.engine.aim.states import (
    Armed,
    Authority,
    Disarmed,
    Held,
    Resumed,
    Sought,
    Step,
    Trigger,
    step,
)
from rsoconsole.engine.tasks.pace import TemporarySettings, change_record, config_with_setting
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.engine.tasks.slews import Slews
from rsoconsole.pipeline import direction_at
from rsoconsole.records import DONE, CommandResult, TrackState, done_result
from rsoconsole.tracking import Following
from rsoconsole.tracking.filters import estimator
from rsoconsole.words import text

SOON = "in force from the next cycle"


class LoopControl(Protocol):
    """The loop as handlers see it: its state, and the methods that change it."""

    @property
    def config(self) -> Config:
        """The configuration in force."""

    @property
    def authority(self) -> Authority:
        """State of the loop: who has control of the mount, and which tracks are followed."""

    @property
    def following(self) -> Following:
        """The followed tracks, and the state of the fold over frames."""

    @property
    def frame_id(self) -> int:
        """Number of the last exposure that was begun."""

    @property
    def last_track(self) -> TrackState | None:
        """The last lead track of this night."""

    @property
    def may_move(self) -> bool:
        """True where autonomy has control and no hold stops its slews."""

    def handle(self, trigger: Trigger) -> Step:
        """Pass a trigger through the state machine and return the step.

        Raises ValueError, with the reason, where the state machine refuses.
        """

    def configure(self, config: Config) -> None:
        """Use a new configuration from the next cycle on."""

    def arm(self, by: str, lifted: frozenset[str]) -> None:
        """Give control to autonomy; ``lifted``: names of the checks that are overridden.

        Raises ValueError where autonomy has control already.
        """

    def resume(self, by: str) -> None:
        """Give control back to autonomy, or follow an ended track again.

        Raises ValueError where that is not possible.
        """

    def expect_night(self) -> None:
        """Raise ValueError where dome, weather or daylight would end autonomy at once."""

    def expect_cloud(self) -> None:
        """Raise ValueError under a clear sky, where "hold until clear" would end at once."""

    def park(self, by: str) -> None:
        """Disarm and send the mount to its park position.

        Raises ValueError where the driver has none.
        """

    @property
    def is_park_wanted(self) -> bool:
        """True while the mount is to be parked and is not parked yet."""

    def end_park(self) -> None:
        """End parking: release a parked mount, or stop one that is on its way to park."""


class RefusedError(ValueError):
    """A command that cannot be carried out now; ``data``: details for a console."""

    def __init__(self, reason: str, data: Mapping[str, Any] | None = None) -> None:
        super().__init__(reason)
        self.data = dict(data or {})


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """The answer to a command that has passed its check."""

    message: str = SOON
    data: Mapping[str, Any] = field(default_factory=dict)
    command: Command | None = None
    """More exact command to execute instead; None: the command itself."""


def accept_unchecked(_command: Command, _by: str) -> Accepted:
    """Accept a command that needs no check."""
    return Accepted()


def skip_state_check(_command: Command, _by: str) -> None:
    """Accept any state of the loop: the check of commands that are always possible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handler:
    """The check and the execution of one command; ``by``, their second argument, is the sender."""

    execute: Callable[[Any, str], CommandResult]
    """Executor on the loop's thread; ValueError: it cannot; InstrumentError: the mount fails."""
    check: Callable[[Any, str], Accepted] = accept_unchecked
    """Check on the wire's threads, before the command is queued; ValueError refuses it."""
    expect: Callable[[Any, str], None] = skip_state_check
    """Checks conditions that earlier commands may still change: called only while none waits."""


Handlers = Mapping[type[Command], Handler]


def joined(parts: Iterable[Handlers]) -> dict[type[Command], Handler]:
    """Return the handlers of several parts of the engine in one mapping.

    Raises ValueError where two of them handle the same command.
    """
    found: dict[type[Command], Handler] = {}
    for part in parts:
        twice = found.keys() & part.keys()
        if twice:
            raise ValueError(f"two handlers of {', '.join(sorted(c.verb for c in twice))}")
        found.update(part)
    return found


class Modes:
    """Handles the commands on control of the mount, such as arm, hold, resume and park."""

    def __init__(self, control: LoopControl) -> None:
        self._control = control

    @property
    def handlers(self) -> Handlers:
        """Handlers of the commands on the control of the mount, by class."""
        return {
            Arm: Handler(expect=self._expect, execute=self._arm),
            Disarm: Handler(execute=self._pass),
            Hold: Handler(expect=self._expect_hold, execute=self._pass),
            Resume: Handler(expect=self._expect_resume, execute=self._resume),
            Park: Handler(execute=self._park),
            Abort: Handler(execute=lambda _command, _by: done_result("the exposure was given up")),
            Shutdown: Handler(execute=lambda _command, _by: DONE),
        }

    def _expect(self, command: Command, by: str) -> None:
        """Raise ValueError where the state machine would refuse."""
        refusal = step(self._control.authority, command_trigger(command, by)).refusal
        if refusal is not None:
            raise ValueError(refusal)

    def _expect_hold(self, command: Hold, by: str) -> None:
        self._expect(command, by)
        if command.until == "clear":
            self._control.expect_cloud()

    def _expect_resume(self, command: Resume, by: str) -> None:
        self._expect(command, by)
        self._control.expect_night()

    def _pass(self, command: Command, by: str) -> CommandResult:
        self._control.handle(command_trigger(command, by))
        return DONE

    def _arm(self, command: Arm, by: str) -> CommandResult:
        self._control.arm(by, frozenset(command.override))
        return DONE

    def _resume(self, _command: Resume, by: str) -> CommandResult:
        self._control.resume(by)
        return DONE

    def _park(self, _command: Park, by: str) -> CommandResult:
        self._control.park(by)
        return done_result(
            "the mount parks" if self._control.is_park_wanted else "the mount is parked"
        )


def command_trigger(command: Command, by: str) -> Trigger:
    """Return the state machine's trigger for arm, disarm, hold or resume.

    Raises TypeError for other commands.
    """
    match command:
        case Arm():
            return Armed(by=by)
        case Disarm():
            return Disarmed(by=by)
        case Hold():
            return Held(by=by, until_clear=command.until == "clear")
        case Resume():
            return Resumed(by=by)
    raise TypeError(f"{command.verb} is nothing to the state machine")


class Settings:
    """Handles changes of settings while the loop runs."""

    def __init__(
        self, control: LoopControl, temporary: TemporarySettings, session_log: SessionLog
    ) -> None:
        self._control = control
        self._temporary = temporary
        self._session_log = session_log

    @property
    def handlers(self) -> Handlers:
        """Handler of the command ``set``, by class."""
        return {Set: Handler(check=self._check, execute=self._set)}

    def _check(self, command: Set, _by: str) -> Accepted:
        config_with_setting(self._control.config, command.name, command.value)
        return Accepted()

    def _set(self, command: Set, by: str) -> CommandResult:
        before = self._control.config
        after = config_with_setting(before, command.name, command.value)
        if command.frames is None:
            self._temporary.keep(command.name)
        else:
            self._temporary.remember_setting(before, command.name, command.frames)
        self._session_log.append(change_record(before, after, command.name, by))
        self._control.configure(after)
        if after.filter.preset != before.filter.preset:
            estimator.preload_modules(after.filter)
        return DONE


class Seeking:
    """Handles the command to search around the last track's predicted position."""

    def __init__(
        self,
        control: LoopControl,
        instrument_controller: InstrumentController,
        planner: Planner,
        slews: Slews,
        guide: Guide,
    ) -> None:
        self._control = control
        self._instrument_controller = instrument_controller
        self._planner = planner
        self._slews = slews
        self._guide = guide

    @property
    def handlers(self) -> Handlers:
        """Handler of the command ``seek``, by class."""
        return {Seek: Handler(expect=self._expect, execute=self._seek)}

    def _expect(self, _command: Seek, _by: str) -> None:
        self.direction()

    def _seek(self, _command: Seek, by: str) -> CommandResult:
        """Search in a widening spiral round the predicted place."""
        direction = self.direction()
        self._control.handle(Sought(by=by))
        self._planner.search_about(direction, self._instrument_controller.now_utc_ns())
        return done_result("looking for it in a widening spiral")

    def direction(self) -> tuple[float, float]:
        """Return the direction predicted for the last track now, ICRS degrees.

        Raises ValueError where no search is possible there.
        """
        track, authority = self._control.last_track, self._control.authority
        if track is None:
            raise ValueError("nothing has been followed this night that could be looked for")
        if not authority.is_autonomous:
            raise ValueError("autonomy does not have the mount: arm or resume first")
        if authority.is_held:
            raise ValueError("the mount is held: resume first")
        now_ns = self._instrument_controller.now_utc_ns()
        # A line on the sky leads astray within the hour, an orbit does not.
        direction = self._guide.last_track_direction(now_ns) or direction_at(track, now_ns)
        refused = self._slews.direction_refusal(direction, now_ns)
        if refused is not None:
            raise ValueError(f"it cannot be looked for where it must be: {text(refused)}")
        return direction
