"""How the engine is: one record that crosses the wire, and the JSON that scripts read of it.

The engine fills it, consoles, panel and shell read it. In JSON a field has its own name, which
says unit and frame; the names of the first version stand beside them and stay.
"""

import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from rsoconsole.control.text import printable

SCHEMA = 1
"""Of all JSON that the program prints and the engine answers; raised where a meaning changes."""
FIRST_NAMES: Mapping[str, str] = types.MappingProxyType(
    {
        "frame_id": "frame",
        "ra_icrs_deg": "ra",
        "dec_icrs_deg": "dec",
        "alt_deg": "alt",
        "az_deg": "az",
        "mount_ra_icrs_deg": "mount_ra",
        "mount_dec_icrs_deg": "mount_dec",
    }
)
"""Field -> its key in the first version, which scripts may still read and older engines say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """One part of machine or instruments and how it is."""

    name: str
    ok: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The engine at one instant; None or empty: not known, or not so."""

    state: str | None = None
    """Of the loop: IDLE, SEARCH, ACQUIRE, TRACK, COAST, LOST, MANUAL or FAULT."""
    holder: str | None = None
    """Who has the mount: autonomy, operator, nobody."""
    is_held: bool = False
    """Autonomy has the mount and gives it no slews."""
    resumes_when_clear: bool = False
    """The hold ends by itself when the stars are back."""
    frame_id: int | None = None
    """The exposure begun last."""
    target: str | None = None
    ra_icrs_deg: float | None = None
    """Where what is followed was at ``t_utc_ns``."""
    dec_icrs_deg: float | None = None
    alt_deg: float | None = None
    """The same as seen from the site."""
    az_deg: float | None = None
    t_utc_ns: int | None = None
    mount_ra_icrs_deg: float | None = None
    """Where the mount itself said to be a second ago."""
    mount_dec_icrs_deg: float | None = None
    is_parked: bool | None = None
    is_slewing: bool | None = None
    """As the mount said a second ago."""
    is_tracking: bool | None = None
    pier_side: str | None = None
    now_utc_ns: int | None = None
    """The engine's clock."""
    exposing_until_utc_ns: int | None = None
    """When the shutter closes; None while it is closed."""
    next_start_utc_ns: int | None = None
    """When the next exposure is to begin; None while that is not planned."""
    next_limit: str | None = None
    """What sidereal tracking runs into within hours, and when."""
    lifted: tuple[str, ...] = ()
    """Checks and limits that the operator has overridden, by name."""
    faults: tuple[str, ...] = ()
    temporary: Mapping[str, int] = field(default_factory=dict)
    """Settings that hold for so many frames more."""
    health: tuple[Health, ...] = ()
    machine: Mapping[str, Any] | None = None
    """Heat, power, disk and time source; the units stand in its keys."""
    seat: str | None = None
    """The console in control; None while none is."""
    seat_asked_by: str | None = None
    session: Path | None = None
    pid: int | None = None


def status_json(status: Status) -> dict[str, Any]:
    """A status as JSON carries it: every field by its name, and by the name it had first."""
    told: dict[str, Any] = {"schema": SCHEMA}
    for each in fields(Status):
        value = _plain(getattr(status, each.name))
        told[each.name] = value
        if each.name in FIRST_NAMES:
            told[FIRST_NAMES[each.name]] = value
    return told


def read_status(told: Mapping[str, Any]) -> Status:
    """The status in an engine's answer; what is missing or odd in it counts as not said."""
    hints, values = get_type_hints(Status), {}
    for each in fields(Status):
        key = each.name if each.name in told else FIRST_NAMES.get(each.name, each.name)
        value = _read(hints[each.name], told.get(key))
        if value is not None:
            values[each.name] = value
    values.setdefault("now_utc_ns", values.get("t_utc_ns"))
    return Status(**values)


def _plain(value: Any) -> Any:
    if isinstance(value, Health):
        return {"name": value.name, "ok": value.ok, "text": value.text}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, Mapping):
        return dict(value)
    return str(value) if isinstance(value, Path) else value


def _read(hint: Any, value: Any) -> Any:
    """What JSON gave as a field has it; None for what it cannot be."""
    kinds = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    kind = next(each for each in kinds if each is not type(None))
    return _READERS[kind](value)


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


def _path(value: Any) -> Path | None:
    return Path(value) if isinstance(value, str) and value else None


def _table(value: Any) -> dict[str, Any] | None:
    return {str(k): v for k, v in value.items()} if isinstance(value, Mapping) else None


def _counts(value: Any) -> dict[str, int] | None:
    table = _table(value)
    if table is None:
        return None
    return {name: count for name, count in table.items() if isinstance(count, int)}


def _health(value: Any) -> tuple[Health, ...] | None:
    if not isinstance(value, list | tuple):
        return None
    return tuple(
        Health(
            name=printable(str(row.get("name", ""))),
            ok=row.get("ok") is True,
            text=printable(str(row.get("text", ""))),
        )
        for row in value
        if isinstance(row, Mapping)
    )


_READERS: dict[Any, Callable[[Any], Any]] = {
    float: _number,
    int: _whole,
    bool: _truth,
    str: _text,
    Path: _path,
    tuple[str, ...]: _texts,
    tuple[Health, ...]: _health,
    Mapping[str, int]: _counts,
    Mapping[str, Any]: _table,
}
"""By the type of a field."""
