"""The command that changes a setting, for good or for some frames."""

from rsoconsole.control import Set
from rsoconsole.engine.operator.handlers import Accepted, Control, Handler, Handlers
from rsoconsole.engine.tasks import SessionLog, Temporary, change_record, changed
from rsoconsole.reasons import DONE, CommandResult
from rsoconsole.tracking.filters import estimator


class Settings:
    """What may be tuned while the loop runs."""

    def __init__(self, control: Control, temporary: Temporary, session_log: SessionLog) -> None:
        self._control = control
        self._temporary = temporary
        self._session_log = session_log

    @property
    def handlers(self) -> Handlers:
        """Its commands."""
        return {Set: Handler(check=self._check, execute=self._set)}

    def _check(self, command: Set, _by: str) -> Accepted:
        changed(self._control.config, command.name, command.value)
        return Accepted()

    def _set(self, command: Set, by: str) -> CommandResult:
        before = self._control.config
        after = changed(before, command.name, command.value)
        if command.frames is None:
            self._temporary.keep(command.name)
        else:
            self._temporary.lend(before, command.name, command.frames)
        self._session_log.append(change_record(before, after, command.name, by))
        self._control.configure(after)
        if after.filter.preset != before.filter.preset:
            estimator.make_ready(after.filter)
        return DONE
