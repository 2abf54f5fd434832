"""Converts records to JSON and back, without loss.

Floats are written in their shortest round-trip form; tuples are written as arrays and read as
tuples; a record inside a record is read as a record. NaN and infinities are refused: a missing
value is None. Keys that are no field, such as a reason's text, are skipped.
"""

import json
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np

from rsoconsole.base import SessionError, parse_json
from rsoconsole.records import OFF_RECORD, Reason, Record
from rsoconsole.words import text

KINDS: Mapping[str, type] = types.MappingProxyType(
    {record.__name__: record for record in get_args(Record)}
)

_Decoder: TypeAlias = Callable[[Any], Any]


def encode(record: Record) -> tuple[str, int | None, str]:
    """Encode one record; return (kind, frame_id or None, JSON body).

    Raises SessionError for an object that is no record of the log, for NaN and infinities, and for
    values that JSON cannot represent.
    """
    kind = type(record).__name__
    if KINDS.get(kind) is not type(record):
        raise SessionError(f"{kind} is not a record of a session")
    body = json.dumps(to_json_value(record, kind), separators=(",", ":"))
    return kind, getattr(record, "frame_id", None), body


def decode(kind: str, body: str) -> Record:
    """Decode a record from the kind and body that ``encode`` returned.

    Raises SessionError when the kind is unknown or the body is no such record.
    """
    record_type = KINDS.get(kind)
    if record_type is None:
        raise SessionError(f"this version knows no record {kind!r}: update rsoconsole")
    try:
        decoded: Record = _decoder(record_type)(parse_json(body))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise SessionError(f"a {kind} of this session is damaged: {error}") from error
    return decoded


def from_json_value(hint: Any, value: Any) -> Any:
    """Return a value of the type ``hint``, from JSON that ``to_json_value`` returned.

    Raises ValueError, TypeError or KeyError where the JSON does not fit the type.
    """
    return _decoder(hint)(value)


def to_json_value(  # noqa: PLR0911 -- one case a type
    value: Any, where: str = "value"
) -> Any:
    """Convert ``value`` to JSON values: dicts, lists, strings, finite numbers, None.

    Raises SessionError for what JSON cannot represent; ``where`` names the value in its message.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        if not math.isfinite(value):
            raise SessionError(f"{where} is {value}: a missing value is None")
        return value
    if isinstance(value, int):
        if not -(2**63) <= value < 2**63:
            raise SessionError(f"{where} does not fit into 64 bits")
        return value
    if isinstance(value, (tuple, list)):
        return [to_json_value(item, where) for item in value]
    if isinstance(value, Mapping):
        return {str(key): to_json_value(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, Reason):
        # For people who read the log by SQL; no program reads it back.
        return {**_members(value, where), "text": text(value)}
    if is_dataclass(value) and not isinstance(value, type):
        return _members(value, where)
    raise SessionError(f"{where} is a {type(value).__name__}, which JSON cannot carry")


def _members(value: Any, where: str) -> dict[str, Any]:
    return {
        f.name: to_json_value(getattr(value, f.name), f"{where}.{f.name}")
        for f in fields(value)
        if OFF_RECORD not in f.metadata
    }


@cache
def _decoder(hint: Any) -> _Decoder:  # noqa: PLR0911 -- one case a type
    if hint is float:
        return _to_float
    if hint is int:
        return _to_int
    if hint is str:
        return _to_str
    if get_origin(hint) is Literal:
        return _literal_decoder(get_args(hint))
    if hint is bool:
        return _to_bool
    if is_dataclass(hint):
        return _record_decoder(hint)
    return _container_decoder(hint)


def _container_decoder(hint: Any) -> _Decoder:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _union_decoder(arguments)
    if origin is tuple and arguments[1:] == (Ellipsis,):
        item = _decoder(arguments[0])
        return lambda value: tuple(map(item, value))
    if origin is tuple:
        items = tuple(_decoder(argument) for argument in arguments)
        return lambda value: tuple(
            decode_item(part) for decode_item, part in zip(items, value, strict=True)
        )
    if origin is not None and issubclass(origin, Mapping):
        member = _decoder(arguments[1])
        return lambda value: {key: member(part) for key, part in value.items()}
    if hint is Any:
        return lambda value: value
    raise TypeError(f"the session cannot carry {hint}")


def _union_decoder(arguments: tuple[Any, ...]) -> _Decoder:
    takes_text = str in arguments
    hints = [a for a in arguments if a not in (str, type(None))]
    others = [(_required(a), _decoder(a)) for a in hints]
    is_optional = type(None) in arguments
    is_one, first = len(others) == 1, others[0][1] if others else _to_str

    def read(value: Any) -> Any:
        if value is None and is_optional:
            return None
        if takes_text and isinstance(value, str):
            return value
        if is_one or not isinstance(value, dict):
            return first(value)
        # Of several records the first whose members are there; the first one says what is wrong.
        for needed, each in others:
            if needed <= value.keys():
                return each(value)
        return first(value)

    return read


def _required(record_type: Any) -> frozenset[str]:
    """Members that a record must have; empty for a type that is no record."""
    if not is_dataclass(record_type):
        return frozenset()
    return frozenset(
        f.name for f in fields(record_type) if f.default is MISSING and f.default_factory is MISSING
    )


def _literal_decoder(allowed: tuple[Any, ...]) -> _Decoder:
    def read(value: Any) -> Any:
        if value not in allowed:
            raise ValueError(f"{value!r} where one of {', '.join(map(repr, allowed))} belongs")
        return value

    return read


def _record_decoder(record_type: Any) -> _Decoder:
    hints = get_type_hints(record_type)
    kept = [f.name for f in fields(record_type) if OFF_RECORD not in f.metadata]
    pairs = tuple((name, _decoder(hints[name])) for name in kept)
    required = _required(record_type)

    def read(value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"{value!r} where text or a {record_type.__name__} belongs")
        if not required <= value.keys():
            raise KeyError(f"no {', '.join(sorted(required - value.keys()))}")
        return record_type(**{name: member(value[name]) for name, member in pairs if name in value})

    return read


def _to_float(value: Any) -> float:
    # Most of a session's values: a finite one less itself is 0, NaN and infinity are not.
    if type(value) is float and value - value == 0.0:
        return value
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"{value!r} where a number belongs")
    return float(value)


def _to_int(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"{value!r} where a whole number belongs")
    return value


def _to_str(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{value!r} where text belongs")
    return value


def _to_bool(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{value!r} where true or false belongs")
    return value
