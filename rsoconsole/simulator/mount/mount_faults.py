"""How the simulated mount can be made to misbehave, to test what must live with real ones."""

from collections.abc import Mapping
from typing import Any

from rsoconsole.simulator.mount.indi_vectors import numbers

FAULTS = (
    "IGNORED_SLEWS",
    "IGNORED_ABORTS",
    "ABORT_ENDS_TRACKING",
    "TRACKING_RETURNS",
    "IS_SILENT",
)


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
        """Take what a client asks for; others stay as they are."""
        self._values.update({key: value for key, value in values.items() if key in FAULTS})
        for key, value in self._values.items():
            self.vector[key] = repr(value)

    @property
    def is_silent(self) -> bool:
        """The driver hangs."""
        return self._values["IS_SILENT"] > 0

    @property
    def abort_ends_tracking(self) -> bool:
        """An abort ends more than motion."""
        return self._values["ABORT_ENDS_TRACKING"] > 0

    def takes_back_tracking_off(self) -> bool:
        """Whether tracking is to be on again; counts those that were announced."""
        if self._values["TRACKING_RETURNS"] <= 0:
            return False
        self._values["TRACKING_RETURNS"] -= 1
        return True

    def ignores(self, event: Any) -> bool:
        """Whether this order is passed over; counts those that were announced."""
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
