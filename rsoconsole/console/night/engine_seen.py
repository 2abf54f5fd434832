"""What the console knows of the engine: its own status, or that it is silent or gone."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

from rsoconsole.control import Status, read_status

Reach = Literal["unknown", "attached", "silent", "gone", "recorded"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineView(Status):
    """The engine at one instant, as far as it can be reached."""

    reach: Reach = "unknown"
    """silent: it runs and does not answer; recorded: none is asked, a session is looked at."""
    since_utc_ns: int | None = None
    """The frame clock's last word, where the engine is silent or gone."""
    detail: str = ""
    """What went wrong, in words."""

    @property
    def is_attached(self) -> bool:
        """True while the engine answers."""
        return self.reach == "attached"

    @property
    def wants_resuming(self) -> bool:
        """True while autonomy waits for the operator's word to go on."""
        return self.is_held or self.holder == "operator"


def engine_view(answer: Mapping[str, Any]) -> EngineView:
    """The engine's answer to ``status``; what is missing or odd in it counts as not said."""
    status = read_status(answer)
    known = {each.name: getattr(status, each.name) for each in fields(Status)}
    return EngineView(reach="attached", **known)
