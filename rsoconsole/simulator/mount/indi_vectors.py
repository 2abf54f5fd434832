"""Short ways to say INDI property vectors, stamped with simulated time."""

from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from math import isfinite
from typing import Any

from indipydriver import (
    LightMember,
    LightVector,
    NumberMember,
    NumberVector,
    SwitchMember,
    SwitchVector,
    TextMember,
    TextVector,
)

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)  # noqa: UP017 - the driver wants this very object


def stamp(t_utc_ns: int) -> datetime:
    """The instant as INDI stamps it, to the microsecond below."""
    return _EPOCH + timedelta(microseconds=t_utc_ns // 1000)


def numbers(
    name: str, group: str, values: Mapping[str, float], *, perm: str = "rw", form: str = "%.10g"
) -> Any:
    """A number vector in state Ok."""
    members = [
        NumberMember(key, key, form, "-1e12", "1e12", "0", repr(float(value)))
        for key, value in values.items()
    ]
    return NumberVector(name, name, group, perm, "Ok", members)


def switches(
    name: str,
    group: str,
    members: tuple[str, ...],
    on: str | None,
    *,
    perm: str = "rw",
    rule: str = "OneOfMany",
) -> Any:
    """A switch vector in state Ok with at most one member on."""
    each = [SwitchMember(key, key, "On" if key == on else "Off") for key in members]
    return SwitchVector(name, name, group, perm, rule, "Ok", each)


def texts(name: str, group: str, values: Mapping[str, str], *, perm: str = "ro") -> Any:
    """A text vector in state Ok."""
    return TextVector(
        name,
        name,
        group,
        perm,
        "Ok",
        [TextMember(key, key, value) for key, value in values.items()],
    )


def lights(name: str, group: str, values: Mapping[str, str], *, state: str = "Ok") -> Any:
    """A light vector; every light and the whole are Idle, Ok, Busy or Alert."""
    members = [LightMember(key, key, value) for key, value in values.items()]
    return LightVector(name, name, group, state, members)


def turn_on(vector: Any, member: str | None) -> bool:
    """Set exactly this member of a switch vector on; True when that changed anything."""
    before = {key: vector[key] for key in vector}
    for key in vector:
        vector[key] = "On" if key == member else "Off"
    return before != {key: vector[key] for key in vector}


def asked_for(event: Mapping[str, str]) -> str | None:
    """The member that a new switch vector turns on."""
    return next((key for key, value in event.items() if value == "On"), None)


def asked_numbers(device: Any, event: Mapping[str, str]) -> dict[str, float]:
    """The members of a new number vector; those that are no numbers are passed over."""
    found = {}
    for key, value in event.items():
        with suppress(TypeError, ValueError):
            number = float(device.indi_number_to_float(value))
            if isfinite(number):
                found[key] = number
    return found
