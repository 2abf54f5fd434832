"""Builders of INDI property vectors, stamped with simulated time."""

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


def connection() -> Any:
    """CONNECTION of a device that is connected."""
    return switches("CONNECTION", "Main Control", ("CONNECT", "DISCONNECT"), "CONNECT")


def driver_info(name: str, interface: int) -> Any:
    """DRIVER_INFO; ``interface``: the sum of INDI's bits for what the device can do."""
    values = {"DRIVER_NAME": name, "DRIVER_EXEC": "rsoconsole", "DRIVER_INTERFACE": str(interface)}
    return texts("DRIVER_INFO", "General Info", values)


def lights(name: str, group: str, values: Mapping[str, str]) -> Any:
    """A light vector in state Ok; every light and the whole are Idle, Ok, Busy or Alert."""
    members = [LightMember(key, key, value) for key, value in values.items()]
    return LightVector(name, name, group, "Ok", members)


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


FAULTS = ("IGNORED_SLEWS", "IGNORED_ABORTS", "ABORT_ENDS_TRACKING", "TRACKING_RETURNS", "IS_SILENT")


class MountFaults:
    """SIM_FAULTS: numbers of slews and aborts to come that are silently ignored.

    ABORT_ENDS_TRACKING: an abort turns tracking off, as some drivers do. TRACKING_RETURNS: so
    often tracking is on again after it was turned off, as with drivers that remember what they
    did before a slew. IS_SILENT: a driver that hangs; it neither reports nor obeys.
    """

    def __init__(self) -> None:
        self.vector = numbers("SIM_FAULTS", "Options", dict.fromkeys(FAULTS, 0.0))
        self._values = dict.fromkeys(FAULTS, 0.0)

    def set(self, values: Mapping[str, float]) -> None:
        """Set the values that a client sends; others stay as they are."""
        self._values.update({key: value for key, value in values.items() if key in FAULTS})
        for key, value in self._values.items():
            self.vector[key] = repr(value)

    @property
    def is_silent(self) -> bool:
        """True: the driver hangs."""
        return self._values["IS_SILENT"] > 0

    @property
    def abort_ends_tracking(self) -> bool:
        """True: an abort ends tracking too."""
        return self._values["ABORT_ENDS_TRACKING"] > 0

    def turns_tracking_on_again(self) -> bool:
        """True where tracking is to be on again; counts down the announced times."""
        if self._values["TRACKING_RETURNS"] <= 0:
            return False
        self._values["TRACKING_RETURNS"] -= 1
        return True

    def ignores(self, event: Any) -> bool:
        """True where this order is ignored; counts down the announced ones."""
        if event.vectorname == "SIM_FAULTS":
            return False
        key = {
            "EQUATORIAL_EOD_COORD": "IGNORED_SLEWS",
            "TELESCOPE_ABORT_MOTION": "IGNORED_ABORTS",
        }.get(event.vectorname)
        if key is not None and self._values[key] > 0:
            self._values[key] -= 1
            return True
        return self.is_silent
