"""Who asks: a console, of which one at a time is in control, or anything else."""

import getpass
import os
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

SenderKind: TypeAlias = Literal["console", "script"]
_CONSOLE = "console "
"""How a console's name begins on the wire and on record, for people."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Who hands the engine a command."""

    name: str = "operator"
    kind: SenderKind = "script"
    """"script": a shell, a program; it is not asked whether it is in control."""

    @classmethod
    def console(cls, name: str) -> "Sender":
        """A console, or a panel that is one."""
        return cls(name=name, kind="console")

    @classmethod
    def at(cls, place: str) -> "Sender":
        """A console or panel of this process's user, at a terminal or a notebook."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = str(os.getuid())
        return cls.console(f"{user}@{place}")

    @property
    def words(self) -> str:
        """As the wire and the record have it."""
        return f"{_CONSOLE}{self.name}" if self.kind == "console" else self.name


def sender_of(by: str, kind: Any = None) -> Sender:
    """The sender that a request names; ``kind``: None where it does not say what that is.

    Where it does not, a name that begins as a console's is one's.
    """
    if kind == "script" or not by.startswith(_CONSOLE):
        return Sender(name=by, kind="console" if kind == "console" else "script")
    return Sender.console(by.removeprefix(_CONSOLE))
