"""The live screen over which a session is opened."""

from typing import Protocol

from rsoconsole.console.night.engine_seen import EngineView
from rsoconsole.night import NightView


class LiveBehind(Protocol):
    """What a session's screen asks of it."""

    night: NightView
    engine: EngineView

    @property
    def alert(self) -> str:
        """What it would say in its first line."""

    def action_give_seat(self) -> None:
        """Let another console act."""

    def action_keep_seat(self) -> None:
        """Go on acting here."""
