"""Commands of the operator: each is a frozen dataclass with all there is to know of its verb.

Its fields are the arguments, its class attributes the policy, its methods the check and the words.
The wire's JSON, the record's arguments and the shell's verb are made of the fields; the engine has
a handler for each class (``engine/operator/handlers.py``), keys and dialogs make instances.
"""

import dataclasses
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field
from typing import Any, ClassVar, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from rsoconsole.base import NOT_FINITE

LARGEST_WHOLE = 2**53
"""Above it a whole number is not kept exactly by everything that reads JSON."""
_EMPTY: tuple[Any, ...] = (None, "", [], (), {})

COMMANDS: dict[str, "type[Command]"] = {}
"""Every command by its verb, in the order in which they are declared."""

C = TypeVar("C", bound="type[Command]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One thing that an operator can ask of the engine; the policy below holds for the verb."""

    verb: ClassVar[str]
    """The command's name on the wire and on record."""
    title: ClassVar[str] = ""
    """The command's name in notices, where the verb does not read well."""
    is_immediate: ClassVar[bool] = False
    """Answered on the thread that brought it, before everything that waits."""
    is_urgent: ClassVar[bool] = False
    """Does not wait for the end of an exposure."""
    moves_mount: ClassVar[bool] = False
    """May move the mount: a limit and the end of the night undo it while it waits."""
    survives_stop: ClassVar[bool] = False
    """Moves nothing: STOP does not undo it while it waits."""
    needs_control: ClassVar[bool] = True
    """Only the console in control may ask for it (a shell always may)."""
    wakes_loop: ClassVar[bool] = True
    """The loop looks at it before it has waited for its next exposure."""
    awaits_mount: ClassVar[bool] = False
    """Its answer waits, but not for long, until the mount has taken or refused it."""
    answer_s: ClassVar[float] = 5.0
    """Wait of a console for the engine's answer, s; longer where pixels are read first."""
    is_on_panel: ClassVar[bool] = False
    """The notebook's panel may ask for it by its verb."""
    takes_anything: ClassVar[bool] = False
    """Arguments that it has not are passed over: nothing may stand in its way."""
    shell: ClassVar[str] = ""
    """An example of it as a verb of the program; empty: the shell has none."""
    shell_help: ClassVar[str] = ""
    """The text of the shell's ``--help``."""

    def check(self) -> None:
        """Raises ValueError with the reason where its arguments can never be carried out."""

    def words(self) -> str:
        """The command in words, for the log."""
        return self.verb

    def arguments(self) -> dict[str, Any]:
        """The arguments as the wire and the record have them; what is not given is left out."""
        given = {_key(f): getattr(self, f.name) for f in dataclasses.fields(self)}
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in given.items()
            if value is not None and value != ()
        }

    @classmethod
    def read(cls, arguments: Mapping[str, Any]) -> Self:
        """The command that these arguments are of. Raises ValueError that says what is wrong."""
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
        """As a notice calls it."""
        return cls.title or cls.verb


def register(command: C) -> C:
    """Make a command known by its verb. Raises ValueError for a verb that is taken."""
    if command.verb in COMMANDS:
        raise ValueError(f"there is a command {command.verb!r} already")
    COMMANDS[command.verb] = command
    return command


def argument(key: str = "", *, default: Any = MISSING, help_: str = "", shell: str = "") -> Any:
    """A field of a command.

    ``key``: what the wire calls it, where that is another name; ``help_`` and ``shell``: its
    words and its name in a terminal.
    """
    metadata = {"key": key, "help": help_, "shell": shell}
    return field(default=default, metadata={k: v for k, v in metadata.items() if v})


def command_of(verb: str, arguments: Mapping[str, Any]) -> Command:
    """The command that a verb and its arguments are.

    Raises ValueError, in words, for a verb that there is not and for arguments that are not its.
    """
    known = COMMANDS.get(verb)
    if known is None:
        raise ValueError(f"the engine knows no '{verb}'; it knows {', '.join(COMMANDS)}")
    command = known.read(arguments)
    command.check()
    return command


def takes_anything(verb: str) -> bool:
    """True for verbs that are carried out whatever is odd about the request."""
    known = COMMANDS.get(verb)
    return known is not None and known.takes_anything


def command_words(verb: str, arguments: Mapping[str, Any]) -> str:
    """A recorded command in words, also one that the program no longer has.

    Arguments that say nothing are left out.
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


def with_overrides(words: str, override: tuple[str, ...]) -> str:
    """Words of a command with the checks that it overrides by name."""
    return f"{words}, overriding {', '.join(override)}" if override else words


def finite(value: Any) -> bool:
    """True for a finite number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and (isinstance(value, int) or math.isfinite(value))


def _key(each: "dataclasses.Field[Any]") -> str:
    return str(each.metadata.get("key", each.name))


def _value(key: str, hint: Any, given: Any) -> Any:
    """What JSON gave for a field. Raises ValueError in words."""
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
    float: ("a number", finite, float),
    int: ("a whole number", _is_whole, int),
    bool: ("true or false", lambda value: isinstance(value, bool), bool),
    str: ("text", lambda value: isinstance(value, str), str),
    tuple[str, ...]: ("a list of names", _are_names, tuple),
}
"""For the type of a field: JSON's value in words, a test of it, and what is made of it."""


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
