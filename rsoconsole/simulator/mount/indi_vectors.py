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


def indi_timestamp(t_utc_ns: int) -> datetime:
    """The instant as a UTC datetime for INDI, rounded down to microseconds."""
    return _EPOCH + timedelta(microseconds=t_utc_ns // 1000)


def number_vector(
    name: str, group: str, values: Mapping[str, float], *, perm: str = "rw", form: str = "%.10g"
) -> Any:
    """Return an INDI number vector in state Ok; ``form``: INDI's format of its numbers."""
    members = [
        NumberMember(key, key, form, "-1e12", "1e12", "0", repr(float(value)))
        for key, value in values.items()
    ]
    return NumberVector(name, name, group, perm, "Ok", members)


def switch_vector(
    name: str,
    group: str,
    members: tuple[str, ...],
    on: str | None,
    *,
    perm: str = "rw",
    rule: str = "OneOfMany",
) -> Any:
    """A switch vector in state Ok; ``on``: the member that is on, None for all off."""
    each = [SwitchMember(key, key, "On" if key == on else "Off") for key in members]
    return SwitchVector(name, name, group, perm, rule, "Ok", each)


def text_vector(name: str, group: str, values: Mapping[str, str], *, perm: str = "ro") -> Any:
    """Return an INDI text vector in state Ok; ``values``: its members' texts by name."""
    return TextVector(
        name,
        name,
        group,
        perm,
        "Ok",
        [TextMember(key, key, value) for key, value in values.items()],
    )


def connection_vector() -> Any:
    """The CONNECTION vector of a connected device."""
    return switch_vector("CONNECTION", "Main Control", ("CONNECT", "DISCONNECT"), "CONNECT")


def driver_info(name: str, interface: int) -> Any:
    """The DRIVER_INFO vector; ``interface``: the sum of INDI's interface bits of the device."""
    values = {"DRIVER_NAME": name, "DRIVER_EXEC": "rsoconsole", "DRIVER_INTERFACE": str(interface)}
    return text_vector("DRIVER_INFO", "General Info", values)


def light_vector(name: str, group: str, values: Mapping[str, str]) -> Any:
    """A light vector in state Ok; ``values``: Idle, Ok, Busy or Alert by member."""
    members = [LightMember(key, key, value) for key, value in values.items()]
    return LightVector(name, name, group, "Ok", members)


def turn_on(vector: Any, member: str | None) -> bool:
    """Turn on this member of a switch vector and all others off; True when anything changed."""
    before = {key: vector[key] for key in vector}
    for key in vector:
        vector[key] = "On" if key == member else "Off"
    return before != {key: vector[key] for key in vector}


def requested_switch(event: Mapping[str, str]) -> str | None:
    """The member that a client's newSwitchVector turns on; None where it turns on none."""
    return next((key for key, value in event.items() if value == "On"), None)


def requested_numbers(device: Any, event: Mapping[str, str]) -> dict[str, float]:
    """The numbers of a client's newNumberVector by member, without those that are not finite."""
    found = {}
    for key, value in event.items():
        with suppress(TypeError, ValueError):
            number = float(device.indi_number_to_float(value))
            if isfinite(number):
                found[key] = number
    return found


FAULTS = ("IGNORED_SLEWS", "IGNORED_ABORTS", "ABORT_ENDS_TRACKING", "TRACKING_RETURNS", "IS_SILENT")


class MountFaults:
    """Faults of the mount's driver, set by clients through SIM_FAULTS; 0: no fault.

    IGNORED_SLEWS: number of next slews that are silently ignored.
    IGNORED_ABORTS: the same for aborts.
    ABORT_ENDS_TRACKING: above 0, an abort turns tracking off, as some drivers do.
    TRACKING_RETURNS: number of times that tracking comes on again after it was turned off, as with
    drivers that restore the state before a slew.
    IS_SILENT: above 0, the driver hangs: it neither reports nor obeys.
    """

    def __init__(self) -> None:
        self.vector = number_vector("SIM_FAULTS", "Options", dict.fromkeys(FAULTS, 0.0))
        self._values = dict.fromkeys(FAULTS, 0.0)

    def set(self, values: Mapping[str, float]) -> None:
        """Set the faults that a client sends; the rest keep their values."""
        self._values.update({key: value for key, value in values.items() if key in FAULTS})
        for key, value in self._values.items():
            self.vector[key] = repr(value)

    @property
    def is_silent(self) -> bool:
        """True while the driver hangs: it neither reports nor obeys."""
        return self._values["IS_SILENT"] > 0

    @property
    def abort_ends_tracking(self) -> bool:
        """True where an abort turns tracking off too."""
        return self._values["ABORT_ENDS_TRACKING"] > 0

    def consume_tracking_return(self) -> bool:
        """Return whether tracking must come on again; if so, decrement TRACKING_RETURNS."""
        if self._values["TRACKING_RETURNS"] <= 0:
            return False
        self._values["TRACKING_RETURNS"] -= 1
        return True

    def consume_ignored_request(self, event: Any) -> bool:
        """Return whether to ignore this request.

        It is ignored while IGNORED_SLEWS or IGNORED_ABORTS for it is above 0, which is then
        decremented, and, without this, while the driver is silent. SIM_FAULTS is never ignored.
        """
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
