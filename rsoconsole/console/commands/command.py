"""Description of a console command: name, keys, title, help, and its screens."""

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
"""Screens with key meanings of their own: one key may do different things on each."""
BOTH: tuple[Place, ...] = ("live", "review")


@dataclass(frozen=True, slots=True)
class KeyCommand:
    """One command of the console and its keys; it may send a ``control.Command``."""

    name: str
    """Name in keymap files and of the action, ``action_<name>``."""
    keys: str
    """The command's keys by Textual's names, separated by commas."""
    title: str
    help: str
    group: Group
    where: tuple[Place, ...] = ("live",)
    """Screens on which the keys work; ignored where ``is_everywhere``."""
    acts: bool = False
    """True where it needs an engine and a console that may act; read-only consoles leave it out."""
    priority: bool = False
    """True where the keys work over dialogs and inside text fields too."""
    is_everywhere: bool = False
    """True where the application itself has the command, so that it works on every screen."""
    sends: Command | None = None
    """Command that the key sends to the engine and no more; None: the key runs its action."""

    def is_available_on(self, place: Place) -> bool:
        """Return whether the command's keys work on the screen ``place``."""
        return self.is_everywhere or place in self.where
