"""Looks at the machine now and then, beside loop and watch, and says what begins and ends.

Reading may take a moment (programs are asked), so that neither the loop nor the thread that
answers the operator does it: both read what was seen last.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rsoconsole.control import Machine, Poller
from rsoconsole.engine.machine import (
    Medium,
    TimeSource,
    Trouble,
    medium_of,
    read_machine,
    read_time_source,
    troubles_of,
)

log = logging.getLogger(__name__)

EVERY_S = 15.0
SLOW_LOOKS = 8
"""Looks from one check of disk and time source to the next."""
QUIET_LOOKS = 4
"""Looks without it after which a trouble is over: a weak supply comes and goes."""
ABOUT = "machine: "
"""How every line of the log about the machine begins."""
Level = Literal["info", "warning", "alarm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineState:
    """The machine as it was seen last."""

    reading: Machine
    troubles: tuple[Trouble, ...]
    """What is not well, and what was not a moment ago."""
    medium: Medium
    time_source: TimeSource

    def as_status(self) -> Machine:
        """What ``status`` has of it."""
        return replace(
            self.reading,
            troubles=tuple(trouble.words for trouble in self.troubles),
            recording_medium=self.medium.kind,
            recording_device=self.medium.device or None,
            recording_life_used_percent=self.medium.life_used_percent,
            time_source=self.time_source.kind,
            time_source_detail=self.time_source.detail,
            real_time_clock=self.time_source.rtc,
        )


class Troubles:
    """A fold over what is not well: each trouble is said when it begins and when it is over."""

    def __init__(self) -> None:
        self._held: dict[str, tuple[Trouble, int]] = {}

    @property
    def held(self) -> tuple[Trouble, ...]:
        """What is not over yet, in the order in which it began."""
        return tuple(trouble for trouble, _ in self._held.values())

    def step(self, seen: tuple[Trouble, ...]) -> list[tuple[Level, str]]:
        """What there is to say after one more look."""
        said: list[tuple[Level, str]] = []
        for trouble in seen:
            if trouble.name not in self._held:
                level: Level = "warning" if trouble.name == "hot" else "alarm"
                said.append((level, f"{ABOUT}{trouble.words}: {trouble.remedy}"))
            self._held[trouble.name] = trouble, 0
        names = {trouble.name for trouble in seen}
        for name, (trouble, missed) in list(self._held.items()):
            if name in names:
                continue
            if missed + 1 < QUIET_LOOKS:
                self._held[name] = trouble, missed + 1
            else:
                del self._held[name]
                said.append(("info", f"{ABOUT}no longer {trouble.words.partition(':')[0]}"))
        return said


class MachineWatch(Poller):
    """Looks on a thread of its own; what it saw last can be read from any."""

    def __init__(self, folder: Path, say: Callable[[Level, str], None]) -> None:
        """``folder``: where the session is written; ``say``: puts a line on record."""
        super().__init__("machine", EVERY_S)
        self._folder = folder
        self._say = say
        self._troubles = Troubles()
        self._looks = 0
        self.state: MachineState | None = None

    def look(self) -> None:
        """Look once."""
        reading = read_machine()
        said = self._troubles.step(troubles_of(reading))
        before = self.state
        if before is None or self._looks % SLOW_LOOKS == 0:
            medium, time_source = medium_of(self._folder), read_time_source()
        else:
            medium, time_source = before.medium, before.time_source
        self._looks += 1
        self.state = MachineState(
            reading=reading, troubles=self._troubles.held, medium=medium, time_source=time_source
        )
        for level, text in said:
            self._say(level, text)

    def _look(self) -> None:
        try:
            self.look()
        except Exception:  # a machine that is told about wrongly must not end the looking
            log.exception("the machine could not be looked at")
