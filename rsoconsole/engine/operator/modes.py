"""The commands on who has the mount: arm, disarm, hold, resume, park, and the engine's end."""

from rsoconsole.control import Abort, Arm, Command, Disarm, Hold, Park, Resume, Shutdown
from rsoconsole.engine.aim import Armed, Disarmed, Held, Resumed, Trigger, step
from rsoconsole.engine.operator.handlers import Control, Handler, Handlers
from rsoconsole.reasons import DONE, CommandResult, done


class Modes:
    """Turns commands into what happens to the state machine."""

    def __init__(self, control: Control) -> None:
        self._control = control

    @property
    def handlers(self) -> Handlers:
        """Its commands."""
        return {
            Arm: Handler(expect=self._expect, execute=self._arm),
            Disarm: Handler(execute=self._pass),
            Hold: Handler(expect=self._expect_hold, execute=self._pass),
            Resume: Handler(expect=self._expect_resume, execute=self._resume),
            Park: Handler(execute=self._park),
            Abort: Handler(execute=lambda _command, _by: done("the exposure was given up")),
            Shutdown: Handler(execute=lambda _command, _by: DONE),
        }

    def _expect(self, command: Command, by: str) -> None:
        """The state machine itself says whether it would refuse."""
        refusal = step(self._control.authority, trigger_of(command, by)).refusal
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
        self._control.handle(trigger_of(command, by))
        return DONE

    def _arm(self, command: Arm, by: str) -> CommandResult:
        self._control.arm(by, frozenset(command.override))
        return DONE

    def _resume(self, _command: Resume, by: str) -> CommandResult:
        self._control.resume(by)
        return DONE

    def _park(self, _command: Park, by: str) -> CommandResult:
        self._control.park(by)
        return done("the mount parks" if self._control.is_park_wanted else "the mount is parked")


def trigger_of(command: Command, by: str) -> Trigger:
    """What a command on who has the mount is to the state machine."""
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
