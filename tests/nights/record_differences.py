"""In what two records, or two rows of records, differ: a failing test shows that alone."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass

MAX_CHARACTERS = 160
MAX_LINES = 30


def differences(left: object, right: object) -> list[str] | None:
    """Lines for pytest; None where these are no records."""
    if is_dataclass(left) and type(left) is type(right):
        return [f"{type(left).__name__}:", *_of_two(left, right, "")][:MAX_LINES]
    if not (_are_records(left) and _are_records(right)):
        return None
    assert isinstance(left, Sequence)
    assert isinstance(right, Sequence)
    lines = [] if len(left) == len(right) else [f"{len(left)} records == {len(right)} records"]
    for n, (one, other) in enumerate(zip(left, right, strict=False)):
        if one == other:
            continue
        if type(one) is type(other):
            lines += [f"{n}: {type(one).__name__}:", *_of_two(one, other, "")]
        else:
            lines.append(f"{n}: {_short(one)} == {_short(other)}")
    if len(left) != len(right):
        longer, n = (left, len(right)) if len(left) > len(right) else (right, len(left))
        lines.append(f"{n}: one side alone has {_short(longer[n])}")
    return ["records:", *lines][:MAX_LINES]


def _are_records(value: object) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(map(is_dataclass, value))


def _of_two(left: object, right: object, place: str) -> list[str]:
    lines = []
    for field in fields(left):  # type: ignore[arg-type]
        one, other = getattr(left, field.name), getattr(right, field.name)
        if one is other or not field.compare or _is_same(one, other):
            continue
        name = f"{place}{field.name}"
        if is_dataclass(one) and type(one) is type(other):
            lines += _of_two(one, other, f"{name}.")
        else:
            lines.append(f"  {name}: {_short(one)} == {_short(other)}")
    return lines


def _is_same(one: object, other: object) -> bool:
    try:
        return bool(one == other)
    except ValueError:  # arrays
        return repr(one) == repr(other)


def _short(value: object) -> str:
    words = repr(value)
    return words if len(words) <= MAX_CHARACTERS else f"{words[: MAX_CHARACTERS - 1]}…"
