"""Keys by the names that people read, and the bindings made of the list of commands."""

from collections.abc import Mapping

from textual.binding import Binding

from rsoconsole.console.commands.command import Place
from rsoconsole.console.commands.commands import BY_NAME, COMMANDS

KEY_WORDS = {
    "left_square_bracket": "[",
    "right_square_bracket": "]",
    "question_mark": "?",
    "slash": "/",
    "comma": ",",
    "full_stop": ".",
    "less_than_sign": "<",
    "greater_than_sign": ">",
    "plus": "+",
    "minus": "-",
    "colon": ":",
    "pageup": "PgUp",
    "pagedown": "PgDn",
    "home": "Home",
    "end": "End",
    "space": "space",
    "backspace": "bksp",
    "escape": "esc",
    "up": "↑",
    "down": "↓",
    "left": "←",
    "right": "→",
    "f1": "F1",
}


def bindings(place: Place | None) -> list[Binding]:
    """For a screen, or with None for the application."""
    return [
        Binding(
            command.keys,
            command.name if command.sends is None else f"hand_over('{command.name}')",
            command.title,
            id=command.name,
            priority=command.priority,
            show=False,
            tooltip=command.help,
        )
        for command in COMMANDS
        if (command.is_everywhere if place is None else not command.is_everywhere)
        and (place is None or place in command.where)
    ]


def key_words(keys: str) -> str:
    """Keys as a person writes them."""
    return " ".join(KEY_WORDS.get(key, key.replace("ctrl+", "^")) for key in keys.split(","))


def first_key(name: str, keymap: Mapping[str, str] | None = None) -> str:
    """The key that a command is shown with, as a person writes it."""
    return key_words((keymap or {}).get(name, BY_NAME[name].keys)).split()[0]
