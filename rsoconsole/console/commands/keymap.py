"""Keys of commands: keymap files, Textual's bindings, key names; and sending the commands.

``keymap.toml`` beside the configuration gives commands other keys, by the commands' names.
"""

import contextlib
import logging
import threading
import unicodedata
from collections.abc import Callable, Mapping
from pathlib import Path

from textual.binding import Binding, InvalidBinding
from textual.keys import KEY_NAME_REPLACEMENTS, Keys

from rsoconsole.base import (
    ConfigError,
    ControlError,
    parse_toml,
    read_foreign_text,
    value_errors_as,
)
from rsoconsole.console.commands.command import BOTH, Place
from rsoconsole.console.commands.commands import BY_NAME, COMMANDS, commands_in
from rsoconsole.control import Command, ControlClient, DirectStop, Outcome, StopNews, Stopping

STOPS = ("stop", "stop_by_letter")
"""Commands whose keys a keymap cannot change."""
RESERVED = {
    "ctrl+q": "Leave, whatever else is",
    "ctrl+c": "Leave, whatever else is",
    "ctrl+p": "the list of commands",
    "enter": "for what is chosen or typed",
    "tab": "for the next field",
    "shift+tab": "for the field before",
    "ctrl+i": "tab to a terminal",
    "ctrl+m": "enter to a terminal",
    "ctrl+j": "enter to a terminal",
    "ctrl+h": "backspace to a terminal",
}
EXAMPLES = "g, f5, ctrl+n, R, slash or left_square_bracket"
MODIFIERS = {"ctrl", "alt", "shift", "super"}
_NAMED_KEYS = {key.value for key in Keys} | set(KEY_NAME_REPLACEMENTS.values())


def load_keymap(path: Path) -> dict[str, str]:
    """Read a keymap file: Textual's keys by the name of the command; empty without a file.

    Raises ConfigError for an invalid file, an unknown command, or a key given twice.
    """
    try:
        text = read_foreign_text(path)
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    with value_errors_as(ConfigError, f"{path}: "):
        table = parse_toml(text)
    unknown = [name for name in table if name not in BY_NAME]
    if unknown:
        raise ConfigError(
            f"{path}: no command is called {', '.join(unknown)}; there are {', '.join(BY_NAME)}"
        )
    wrong = [name for name, keys in table.items() if not isinstance(keys, str) or not keys.strip()]
    if wrong:
        raise ConfigError(f'{path}: {", ".join(wrong)} needs a key as text, such as "f5"')
    kept = [name for name in STOPS if name in table]
    if kept:
        raise ConfigError(f"{path}: {', '.join(kept)}: STOP keeps its keys, x and ctrl+x")
    keymap = {name: ",".join(_textual_keys(path, name, keys)) for name, keys in table.items()}
    _refuse_doubles(path, keymap)
    return keymap


def _textual_keys(path: Path, name: str, keys: str) -> list[str]:
    """Return the keys by Textual's own names. Raises ConfigError for an unknown key."""
    try:
        bindings = list(Binding.make_bindings([Binding(keys.replace(" ", ""), name)]))
    except InvalidBinding as error:
        raise ConfigError(f"{path}: {name} = {keys!r}: write it like {EXAMPLES}") from error
    found = [binding.key for binding in bindings]
    for key in found:
        if key in RESERVED:
            raise ConfigError(f"{path}: {name}: {key} is {RESERVED[key]}")
        if not _is_key(key):
            raise ConfigError(f"{path}: {name}: there is no key {key!r}; write it like {EXAMPLES}")
    return found


def _is_key(key: str) -> bool:
    *modifiers, plain = key.split("+")
    if not set(modifiers) <= MODIFIERS or (modifiers == ["shift"] and len(plain) == 1):
        return False  # a terminal sends the capital itself
    if len(plain) == 1 or plain in _NAMED_KEYS:
        return True
    with contextlib.suppress(KeyError):
        return bool(unicodedata.lookup(plain.replace("_", " ").upper()))
    return False


def _refuse_doubles(path: Path, keymap: Mapping[str, str]) -> None:
    """Raise ConfigError where a key does two things on one screen."""
    for place in BOTH:
        owners: dict[str, str] = {}
        for command in commands_in(place):
            for key in keymap.get(command.name, command.keys).split(","):
                if key in owners:
                    raise ConfigError(f"{path}: {key} is both {owners[key]} and {command.name}")
                owners[key] = command.name


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
    """Return Textual's bindings of a screen's commands; None: of the application's commands."""
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
    """Return keys as a person writes them: "^p F1" for "ctrl+p,f1"."""
    return " ".join(KEY_WORDS.get(key, key.replace("ctrl+", "^")) for key in keys.split(","))


def first_key(name: str, keymap: Mapping[str, str] | None = None) -> str:
    """Return a command's first key as the screens show it; ``keymap``: keys by command name."""
    return key_words((keymap or {}).get(name, BY_NAME[name].keys)).split()[0]


log = logging.getLogger(__name__)


class Orders:
    """Sends commands to the engine without blocking; callbacks run on the sending threads."""

    def __init__(
        self, wire: Callable[[], ControlClient], stop_directly: DirectStop | None = None
    ) -> None:
        self._wire = wire
        self._stop_directly = stop_directly

    def stop(self, on_news: Callable[[StopNews], None]) -> None:
        """Send STOP at once; ``on_news`` is called for each stage: late, answered, ended."""
        Stopping(self._wire, self._stop_directly, on_news).begin()

    def send(self, command: Command, on_outcome: Callable[[Outcome], None]) -> None:
        """Send a command; ``on_outcome`` gets the answer, or that the engine cannot be reached."""

        def work() -> None:
            try:
                outcome = self._wire().send(command, timeout_s=command.answer_s)
            except ControlError as error:
                outcome = Outcome(ok=False, message=str(error))
            except Exception as error:  # the seat must hear of it, whatever it is
                log.exception("%s", command.verb)
                words = f"{command.verb}: {error or type(error).__name__}"
                outcome = Outcome(ok=False, message=words)
            on_outcome(outcome)

        threading.Thread(target=work, name=f"console-{command.verb}", daemon=True).start()
