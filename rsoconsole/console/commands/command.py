"""Commands of the console: name, keys, title, help, and the screens that have them."""

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
    """One command of the console, with its keys; the engine gets a ``control.Command``."""

    name: str
    """Name in a keymap; the action is ``action_<name>``."""
    keys: str
    """Keys as Textual writes them, several parted by commas."""
    title: str
    help: str
    group: Group
    where: tuple[Place, ...] = ("live",)
    """Screens that have it; ignored where ``is_everywhere``."""
    acts: bool = False
    """True where it needs an engine and a console that may act; others are not offered it."""
    priority: bool = False
    """True where it works over dialogs and inside fields too."""
    is_everywhere: bool = False
    """True where the application has it, on every screen."""
    sends: Command | None = None
    """The engine's command, where the key only sends it; there is no action then."""

    def is_in(self, place: Place) -> bool:
        """Return True if its key works on that screen."""
        return self.is_everywhere or place in self.where
