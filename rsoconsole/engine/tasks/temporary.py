"""Settings that hold for a number of frames, then go back to what they were."""

from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.engine.tasks.tunables import change_record, changed, value_of
from rsoconsole.records import ParameterChange


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loan:
    before: float | int | str
    frames: int


class Temporary:
    """What is lent, by the name of the setting."""

    def __init__(self, of_night: Callable[[Config], Config] = lambda config: config) -> None:
        """``of_night``: a configuration as the night has it, without what a track changed in it."""
        self._of_night = of_night
        self._loans: dict[str, _Loan] = {}

    def lend(self, config: Config, name: str, frames: int) -> None:
        """Remember what the setting is now; the first lender's value comes back at the end."""
        known = self._loans.get(name)
        before = value_of(self._of_night(config), name) if known is None else known.before
        self._loans[name] = _Loan(before=before, frames=frames)

    def keep(self, name: str) -> None:
        """Somebody has set it for good."""
        self._loans.pop(name, None)

    def left(self) -> dict[str, int]:
        """Frames that each still holds for."""
        return {name: loan.frames for name, loan in dict(self._loans).items()}

    def count(self, config: Config) -> tuple[Config, tuple[ParameterChange, ...]]:
        """One frame more: the configuration with what is over set back, and the record of it."""
        changes: list[ParameterChange] = []
        for name, loan in list(self._loans.items()):
            if loan.frames > 1:
                self._loans[name] = _Loan(before=loan.before, frames=loan.frames - 1)
                continue
            del self._loans[name]
            after = changed(config, name, loan.before)
            changes.append(change_record(config, after, name, "the end of its frames"))
            config = after
        return config, tuple(changes)
