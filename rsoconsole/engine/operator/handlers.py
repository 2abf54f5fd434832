"""What the engine has for a command: a check on the wire's threads, the doing on the loop's.

Each part of the engine brings the handlers of its own commands (``modes.py``, ``by_hand.py``,
``settings.py``, ``decisions.py``, ``seek.py``); the loop and the command handler only look them up.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from rsoconsole.config import Config
from rsoconsole.control import Command
from rsoconsole.engine.aim import Authority, Step, Trigger
from rsoconsole.reasons import CommandResult
from rsoconsole.records import TrackState
from rsoconsole.tracking.association import Following

SOON = "in force from the next cycle"


class Control(Protocol):
    """What a handler may ask of the loop: how things stand, and to change them."""

    @property
    def config(self) -> Config:
        """The configuration in force."""

    @property
    def authority(self) -> Authority:
        """Who has the mount, and what the loop follows."""

    @property
    def following(self) -> Following:
        """What is followed."""

    @property
    def frame_id(self) -> int:
        """The exposure begun last."""

    @property
    def last_track(self) -> TrackState | None:
        """What was followed last this night."""

    @property
    def may_move(self) -> bool:
        """Whether autonomy has the mount and nobody holds it."""

    def handle(self, trigger: Trigger) -> Step:
        """Pass through one step. Raises ValueError with the reason where it refuses."""

    def configure(self, config: Config) -> None:
        """Take new settings; in force from the next cycle."""

    def arm(self, by: str, lifted: frozenset[str]) -> None:
        """Hand the mount to autonomy. Raises ValueError where it has it already."""

    def resume(self, by: str) -> None:
        """Give it back, or follow again what was ended. Raises ValueError where that cannot be."""

    def expect_night(self) -> None:
        """Raises ValueError where dome, weather or daylight would end the night at once."""

    def expect_cloud(self) -> None:
        """Raises ValueError where the sky is clear."""

    def park(self, by: str) -> None:
        """Disarm and send the mount to its park position. Raises ValueError where it has none."""

    @property
    def is_park_wanted(self) -> bool:
        """Whether the mount is to be parked and is not yet."""

    def end_park(self) -> None:
        """Park no more: release a mount that is parked, stop one that is on its way there."""


class RefusedError(ValueError):
    """A command that cannot be now, with what a console shows beside the reason."""

    def __init__(self, reason: str, data: Mapping[str, Any] | None = None) -> None:
        super().__init__(reason)
        self.data = dict(data or {})


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """The answer to a command that can be, as far as is known."""

    message: str = SOON
    data: Mapping[str, Any] = field(default_factory=dict)
    command: Command | None = None
    """To be executed in its place: the same, said exactly; None: as it is."""


def accept(_command: Command, _by: str) -> Accepted:
    """Nothing about it has to be looked at."""
    return Accepted()


def expect_nothing(_command: Command, _by: str) -> None:
    """Nothing in the state of the loop forbids it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handler:
    """How one command is checked and done; ``by`` is who asks."""

    execute: Callable[[Any, str], CommandResult]
    """On the loop's thread; gives what came of it. Raises ValueError with the reason where
    it cannot be, InstrumentError where the mount fails."""
    check: Callable[[Any, str], Accepted] = accept
    """On the wire's threads, before it is queued. Raises ValueError where it cannot be."""
    expect: Callable[[Any, str], None] = expect_nothing
    """The same of what commands before it may still change: asked only while none waits."""


Handlers = Mapping[type[Command], Handler]


def joined(parts: Iterable[Handlers]) -> dict[type[Command], Handler]:
    """All handlers of some parts. Raises ValueError where two have one for the same command."""
    found: dict[type[Command], Handler] = {}
    for part in parts:
        twice = found.keys() & part.keys()
        if twice:
            raise ValueError(f"two handlers of {', '.join(sorted(c.verb for c in twice))}")
        found.update(part)
    return found
