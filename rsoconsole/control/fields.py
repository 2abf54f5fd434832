"""Records that cross the wire: each field under its own name; None for what a reader cannot use."""

import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from rsoconsole.control.text import printable


def as_json(value: Any) -> Any:
    """A record, or what its fields hold, as JSON carries it."""
    if is_dataclass(value):
        return {each.name: as_json(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, tuple):
        return [as_json(each) for each in value]
    if isinstance(value, Mapping):
        return dict(value)
    return str(value) if isinstance(value, Path) else value


def read_fields(record: type, data: Mapping[str, Any]) -> dict[str, Any]:
    """What an answer says of a record's fields; what is missing or odd in it counts as not said."""
    hints = _hints(record)
    found = {
        each.name: read_value(hints[each.name], data.get(each.name)) for each in fields(record)
    }
    return {name: value for name, value in found.items() if value is not None}


def read_value(hint: Any, value: Any) -> Any:
    """What JSON gave as a field has it; None for what it cannot be."""
    kinds = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    kind = next(each for each in kinds if each is not type(None))
    if is_dataclass(kind):
        return _record(kind, value)
    reader = _READERS.get(kind)
    return _rows(get_args(kind)[0], value) if reader is None else reader(value)


@cache
def _hints(record: type) -> dict[str, Any]:
    return get_type_hints(record)


def _record(kind: Any, value: Any) -> Any:
    if not isinstance(value, Mapping):
        return None
    try:
        return kind(**read_fields(kind, value))
    except TypeError:  # a field without a default is not said
        return None


def _rows(kind: Any, value: Any) -> tuple[Any, ...] | None:
    if not isinstance(value, list | tuple):
        return None
    read = partial(read_value, kind) if is_dataclass(kind) else partial(_pair, get_args(kind))
    return tuple(row for row in map(read, value) if row is not None)


def _pair(kinds: tuple[Any, ...], value: Any) -> tuple[Any, ...] | None:
    if not isinstance(value, list | tuple) or len(value) != len(kinds):
        return None
    data = tuple(read_value(kind, each) for kind, each in zip(kinds, value, strict=True))
    return None if None in data else data


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _whole(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _truth(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _text(value: Any) -> str | None:
    return printable(value) if isinstance(value, str) and value else None


def _texts(value: Any) -> tuple[str, ...] | None:
    return tuple(printable(str(v)) for v in value) if isinstance(value, list | tuple) else None


def _wholes(value: Any) -> tuple[int, ...] | None:
    if not isinstance(value, list | tuple):
        return None
    return tuple(number for number in map(_whole, value) if number is not None)


def _path(value: Any) -> Path | None:
    return Path(value) if isinstance(value, str) and value else None


def _counts(value: Any) -> dict[str, int] | None:
    if not isinstance(value, Mapping):
        return None
    return {str(name): count for name, count in value.items() if isinstance(count, int)}


_READERS: dict[Any, Callable[[Any], Any]] = {
    float: _number,
    int: _whole,
    bool: _truth,
    str: _text,
    Path: _path,
    tuple[str, ...]: _texts,
    tuple[int, ...]: _wholes,
    Mapping[str, int]: _counts,
}
"""By the type of a field."""
