"""What a simulated observatory is to be, as it crosses to its process."""

from dataclasses import dataclass, field
from typing import Any

from rsoconsole.simulator.devices import Schedule


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservatorySettings:
    """What the observatory is to be; crosses to its process as JSON."""

    scenario: str
    seed: int
    speed: float
    """Virtual seconds a wall second; 0: at once."""
    truth_path: str | None = None
    width_px: int | None = None
    """A smaller sensor than the scenario's, for quick looks."""
    height_px: int | None = None
    stage: str | None = None
    """``module:function`` that opens another stage than the scenarios'."""
    plan: dict[str, Any] | None = None
    """A ``NightPlan`` as a table, instead of the scenario."""
    weather: Schedule = ()
    """(seconds since the start, "ok" | "warning" | "alert") in order; ok before the first."""
    dome: Schedule = ()
    """(seconds since the start, "open" | "closed" | "moving") in order; open before the first."""
    world: dict[str, Any] = field(default_factory=dict)
    """Imperfections, as ``World.named`` gives them."""
