"""Records that cross the wire: each field under its own name."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rsoconsole.control.text import printable

if TYPE_CHECKING:
    from pydantic import TypeAdapter

Record = TypeVar("Record")
_PATHS = frozenset(("session",))
"""Names of files are taken as they are: another spelling names another file."""


def as_json(value: Any) -> Any:
    """A record, or what its fields hold, as JSON carries it."""
    if is_dataclass(value):
        return {each.name: as_json(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, tuple):
        return [as_json(each) for each in value]
    if isinstance(value, Mapping):
        return dict(value)
    return str(value) if isinstance(value, Path) else value


def read_record(kind: type[Record], data: Mapping[str, Any]) -> Record | None:
    """The record in an answer, its texts fit for a terminal; None where that is none.

    A field that cannot be used counts as not said.
    """
    from pydantic import ValidationError

    said = {
        name: value if name in _PATHS else _printable(value)
        for name, value in data.items()
        if value is not None
    }
    reader: TypeAdapter[Record] = _reader(kind)  # type: ignore[arg-type]  # a class has a hash
    try:
        return reader.validate_python(said)
    except ValidationError as error:
        odd = {each["loc"][0] for each in error.errors()}
    try:
        return reader.validate_python({n: value for n, value in said.items() if n not in odd})
    except ValidationError:  # a field without a default is not said
        return None


@cache
def _reader(kind: Any) -> "TypeAdapter[Any]":
    # Not loaded by what only gives an order, as STOP does.
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def _printable(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Mapping):
        return {name: _printable(each) for name, each in value.items()}
    return [_printable(each) for each in value] if isinstance(value, list) else value
