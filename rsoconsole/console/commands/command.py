"""What a key of the console is, and where it works."""

from dataclasses import dataclass
from typing import Literal

from rsoconsole.control import Command

Group = Literal["safety", "telescope", "streaks", "time", "plots", "picture", "console"]
GROUPS: dict[Group, str] = {
    "safety": "Safety",
    "time": "Time",
    "telescope": "Telescope",
    "streaks": "Streaks and track",
    "plots": "Plots",
    "picture": "Picture",
    "console": "Console",
}
Place = Literal["live", "review"]
"""The screens that have keys of their own: a key may mean another thing in each."""
BOTH: tuple[Place, ...] = ("live", "review")


@dataclass(frozen=True, slots=True)
class KeyCommand:
    """One thing to do with a key; what the engine is asked for is a ``control.Command``."""

    name: str
    """By which a keymap calls it; the action is ``action_<name>``."""
    keys: str
    """As Textual writes them, several parted by commas."""
    title: str
    help: str
    group: Group
    where: tuple[Place, ...] = ("live",)
    """The screens that have it; of no meaning for one that is everywhere."""
    acts: bool = False
    """Whether it needs an engine, and a seat that may act; others are not offered it."""
    priority: bool = False
    """Whether it works over dialogs and inside fields too."""
    is_everywhere: bool = False
    """Whether the application has it, on every screen."""
    sends: Command | None = None
    """The command that it only hands to the engine: it needs no action of its own then."""

    def is_in(self, place: Place) -> bool:
        """Whether its key works there."""
        return self.is_everywhere or place in self.where
