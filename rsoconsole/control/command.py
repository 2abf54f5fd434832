"""Commands of the operator: each is a frozen dataclass with everything about its verb.

Its fields are the command's arguments; its class attributes say how the engine treats the verb; its
methods check the arguments and put the command into words. The wire's JSON, the recorded arguments
and the shell's verb are made of the fields. The engine has a handler for each class
(``engine/operator/handlers.py``); keys and dialogs make instances.
"""

import dataclasses
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field
from typing import Any, ClassVar, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from rsoconsole.base import NOT_FINITE

LARGEST_WHOLE = 2**53
"""Greatest whole number that every JSON reader keeps exactly."""
_EMPTY: tuple[Any, ...] = (None, "", [], (), {})

COMMANDS: dict[str, "type[Command]"] = {}

C = TypeVar("C", bound="type[Command]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command of the operator to the engine; the class attributes below belong to its verb."""

    verb: ClassVar[str]
    """The command's name on the wire and on record."""
    title: ClassVar[str] = ""
    """The command's name in notices; empty: the verb itself."""
    is_immediate: ClassVar[bool] = False
    """True for a command answered on its connection's own thread, ahead of the queue."""
    is_urgent: ClassVar[bool] = False
    """True for a command that is executed at once, even while an exposure is under way."""
    moves_mount: ClassVar[bool] = False
    """True if the command may move the mount: a limit or night's end undoes it while it waits."""
    survives_stop: ClassVar[bool] = False
    """True for a command that STOP does not cancel while it waits, because it moves nothing."""
    needs_control: ClassVar[bool] = True
    """True for a command that only the console in control may give (a shell command always may)."""
    wakes_loop: ClassVar[bool] = True
    """True for a command that the loop executes at once, not only after its next exposure."""
    awaits_mount: ClassVar[bool] = False
    """True where the answer waits briefly until the mount has accepted or refused the command."""
    answer_s: ClassVar[float] = 5.0
    """How long a console waits for the engine's answer, s; longer where pixels are read first."""
    is_on_panel: ClassVar[bool] = False
    """True where the notebook's panel may send the command by its verb."""
    takes_anything: ClassVar[bool] = False
    """True where unknown arguments are ignored, so that a faulty request is still carried out."""
    shell: ClassVar[str] = ""
    """Example of the command in a shell; empty: the shell has no such verb."""
    shell_help: ClassVar[str] = ""

    def check(self) -> None:
        """Check the arguments.

        Raises ValueError, with the reason, for arguments that can never be carried out.
        """

    def words(self) -> str:
        """The command in words, for the log."""
        return self.verb

    def arguments(self) -> dict[str, Any]:
        """Return the arguments given, by their names on the wire and on record."""
        given = {_key(f): getattr(self, f.name) for f in dataclasses.fields(self)}
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in given.items()
            if value is not None and value != ()
        }

    @classmethod
    def read(cls, arguments: Mapping[str, Any]) -> Self:
        """Make the command from its arguments, named as on the wire.

        Raises ValueError with the reason for unknown, missing or invalid arguments.
        """
        known = {_key(f): f for f in dataclasses.fields(cls)}
        unknown = [name for name in arguments if name not in known]
        if unknown and not cls.takes_anything:
            takes = f"it takes {', '.join(known)}" if known else "it takes no arguments"
            raise ValueError(f"{cls.verb} knows no {', '.join(map(repr, unknown))}; {takes}")
        hints, values = get_type_hints(cls), {}
        for key, each in known.items():
            if key in arguments:
                values[each.name] = _value(key, hints[each.name], arguments[key])
            elif each.default is MISSING and each.default_factory is MISSING:
                raise ValueError(f"{cls.verb} needs {key}, {_needed(hints[each.name])}")
        return cls(**values)

    @classmethod
    def label(cls) -> str:
        """Return the command's name in a notice: its title, else its verb."""
        return cls.title or cls.verb


def register_command(command: C) -> C:
    """Add a command class to ``COMMANDS``. Raises ValueError if its verb is there already."""
    if command.verb in COMMANDS:
        raise ValueError(f"there is a command {command.verb!r} already")
    COMMANDS[command.verb] = command
    return command


def argument_field(
    key: str = "", *, default: Any = MISSING, help_: str = "", shell: str = ""
) -> Any:
    """Declare a field of a command.

    ``key``: its name on the wire, where that is not the field's; ``help_``: its help text in a
    terminal; ``shell``: its name in a terminal, where that differs.
    """
    metadata = {"key": key, "help": help_, "shell": shell}
    return field(default=default, metadata={k: v for k, v in metadata.items() if v})


def make_command(verb: str, arguments: Mapping[str, Any]) -> Command:
    """Make and check the command for a verb and its arguments.

    Raises ValueError, with the reason, for an unknown verb and for wrong arguments.
    """
    known = COMMANDS.get(verb)
    if known is None:
        raise ValueError(f"the engine knows no '{verb}'; it knows {', '.join(COMMANDS)}")
    command = known.read(arguments)
    command.check()
    return command


def is_always_executed(verb: str) -> bool:
    """True for a verb that is carried out even with unknown arguments in the request."""
    known = COMMANDS.get(verb)
    return known is not None and known.takes_anything


def command_words(verb: str, arguments: Mapping[str, Any]) -> str:
    """Return a recorded command in words, also for a verb that the program no longer has.

    Empty arguments are left out.
    """
    words, rest = verb, dict(arguments)
    known = COMMANDS.get(verb)
    if known is not None:
        own = {_key(f) for f in dataclasses.fields(known)}
        try:
            command = known.read({k: v for k, v in arguments.items() if k in own})
            words, rest = command.words(), {k: v for k, v in rest.items() if k not in own}
        except ValueError:
            pass
    parts = [f"{key} {_plain(value)}" for key, value in rest.items() if value not in _EMPTY]
    return ", ".join([words, *parts])


def add_override_words(words: str, override: tuple[str, ...]) -> str:
    """Return a command's words followed by the names of the checks that it overrides."""
    return f"{words}, overriding {', '.join(override)}" if override else words


def is_finite_number(value: Any) -> bool:
    """Return True for a finite number; a bool is not a number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and (isinstance(value, int) or math.isfinite(value))


def _key(each: "dataclasses.Field[Any]") -> str:
    return str(each.metadata.get("key", each.name))


def _value(key: str, hint: Any, given: Any) -> Any:
    """Convert JSON's value for a field. Raises ValueError in words."""
    is_whole = isinstance(given, int) and abs(given) > LARGEST_WHOLE
    if is_whole or (isinstance(given, float) and not math.isfinite(given)):
        raise ValueError(f"{key} {NOT_FINITE}, not {given}")
    kinds = _kinds(hint)
    if given is None and type(None) in kinds:
        return None
    for kind in kinds:
        reader = _READERS.get(kind)
        if reader is not None and reader[1](given):
            return reader[2](given)
    raise ValueError(f"{key} must be {_needed(hint)}")


def _kinds(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(get_args(hint))
    return (hint,)


def _needed(hint: Any) -> str:
    kinds = [kind for kind in _kinds(hint) if kind in _READERS]
    if float in kinds:
        kinds = [kind for kind in kinds if kind is not int]
    return " or ".join(_READERS[kind][0] for kind in kinds)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _are_names(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(each, str) for each in value)


_READERS: dict[Any, tuple[str, Callable[[Any], bool], Callable[[Any], Any]]] = {
    float: ("a number", is_finite_number, float),
    int: ("a whole number", _is_whole, int),
    bool: ("true or false", lambda value: isinstance(value, bool), bool),
    str: ("text", lambda value: isinstance(value, str), str),
    tuple[str, ...]: ("a list of names", _are_names, tuple),
}
"""By the type of a field: its JSON value in words, a test of that value, and its conversion."""


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
