"""The mount's process: ICRS degrees to its parent, hours and epoch of date to INDI.

Run as ``python -m rsoconsole.instruments.mount_child``. When its parent goes away it ends motion
and restores sidereal tracking before it ends itself.
"""

import math
import os
import time
from typing import Any

from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.indi_child import IndiClient, Mouth, Vector, run_child
from rsoconsole.sky.angles import deg_to_hours, hours_to_deg, separation_deg, wrap_180, wrap_360
from rsoconsole.sky.frames import icrs_to_jnow, jnow_to_icrs

_COORDINATES = "EQUATORIAL_EOD_COORD"
_TELLING = (_COORDINATES, "TELESCOPE_PARK", "TELESCOPE_TRACK_STATE", "TELESCOPE_PIER_SIDE")
_ACK_S = 5.0
_ARRIVED_ALREADY_DEG = 0.05
_SAME_SITE_DEG = 0.01


class MountChild:
    """Carries out the parent's orders on one INDI mount."""

    def __init__(self, mouth: Mouth) -> None:
        self._mouth = mouth
        self._is_simulated = False
        self._client: IndiClient | None = None

    def start(self, order: dict[str, Any]) -> dict[str, Any]:
        """Connect to server and mount."""
        self._is_simulated = bool(order["simulated"])
        client = IndiClient(order["device"], self._on_vector)
        client.open(order["host"], order["port"], (_COORDINATES, "ON_COORD_SET"))
        self._client = client
        if self._is_simulated:
            before = client.send_switch("SIM_REPORT", "NOW")
            self._expect(client.wait(_COORDINATES, lambda _: True, _ACK_S, before), "report")
        return {}

    def slew(self, order: dict[str, Any]) -> dict[str, Any]:
        """Go to an ICRS direction and track; answers when the mount has taken the order."""
        client = self._ready()
        self._refuse_if_parked()
        ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(
            order["ra_icrs_deg"], order["dec_icrs_deg"], order["now_utc_ns"]
        )
        on_set = client.get("ON_COORD_SET")
        if on_set is None or not on_set.values.get("TRACK"):
            self._switch("ON_COORD_SET", "TRACK")
        target = {"RA": deg_to_hours(float(ra_jnow_deg)), "DEC": float(dec_jnow_deg)}
        before = client.send_numbers(_COORDINATES, target)

        def is_answer(vector: Vector) -> bool:
            if vector.state in ("Busy", "Alert"):
                return True
            ra_deg = hours_to_deg(vector.values["RA"])
            distance_deg = separation_deg(
                ra_deg, vector.values["DEC"], float(ra_jnow_deg), float(dec_jnow_deg)
            )
            return bool(distance_deg < _ARRIVED_ALREADY_DEG)

        answer = client.wait(_COORDINATES, is_answer, _ACK_S, before)
        if answer is None:
            raise InstrumentError(
                f"the mount did not start to slew in {_ACK_S:.0f} s: "
                f"look at its driver's log. {client.last_message}".rstrip()
            )
        if answer.state == "Alert":
            raise InstrumentError(
                f"the mount refused to slew: {client.last_message or 'no reason'}"
            )
        return {}

    def abort(self, _order: dict[str, Any]) -> dict[str, Any]:
        """End motion; answers when the mount says that it stands."""
        client = self._ready()
        known = client.get(_COORDINATES)
        was_moving = known is None or known.state == "Busy"
        before = client.send_switch("TELESCOPE_ABORT_MOTION", "ABORT")
        if was_moving:
            stands = client.wait(_COORDINATES, lambda v: v.state != "Busy", _ACK_S, before)
        else:
            stands = client.wait("TELESCOPE_ABORT_MOTION", lambda _: True, _ACK_S, before)
            self._await_report(before)
        return {"stopped": stands is not None}

    def park(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Send the mount to its park position."""
        client = self._ready()
        before = client.send_switch("TELESCOPE_PARK", "PARK")
        self._expect(client.wait("TELESCOPE_PARK", lambda _: True, _ACK_S, before), "park")
        self._await_report(before)
        return {}

    def unpark(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Release the mount."""
        client = self._ready()
        if self._is_parked():
            before = client.send_switch("TELESCOPE_PARK", "UNPARK")
            released = client.wait(
                "TELESCOPE_PARK", lambda v: not v.values.get("PARK", False), _ACK_S, before
            )
            self._expect(released, "unpark")
            self._await_report(before)
        return {}

    def set_tracking(self, order: dict[str, Any]) -> dict[str, Any]:
        """Sidereal tracking on or off."""
        self._refuse_if_parked()
        before = self._switch(
            "TELESCOPE_TRACK_STATE", "TRACK_ON" if order["is_on"] else "TRACK_OFF"
        )
        self._await_report(before)
        return {}

    def set_site(self, order: dict[str, Any]) -> dict[str, Any]:
        """Tell the mount where it stands; INDI's longitude runs from 0 to 360 east."""
        client = self._ready()
        latitude_deg = float(order["latitude_deg"])
        before = client.send_numbers(
            "GEOGRAPHIC_COORD",
            {
                "LAT": latitude_deg,
                "LONG": wrap_360(order["longitude_deg"]),
                "ELEV": order["elevation_m"],
            },
        )

        def is_answer(vector: Vector) -> bool:
            told_deg = separation_deg(
                vector.values["LONG"], vector.values["LAT"], order["longitude_deg"], latitude_deg
            )
            return vector.state == "Alert" or bool(told_deg < _SAME_SITE_DEG)

        self._expect(client.wait("GEOGRAPHIC_COORD", is_answer, _ACK_S, before), "take its site")
        return {}

    def site(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Where the mount believes to stand."""
        vector = self._ready().get("GEOGRAPHIC_COORD")
        if vector is None:
            return {"site": None}
        return {
            "site": {
                "latitude_deg": vector.values["LAT"],
                "longitude_deg": wrap_180(vector.values["LONG"]),
                "elevation_m": vector.values.get("ELEV", 0.0),
            }
        }

    def report(self, _order: dict[str, Any]) -> dict[str, Any]:
        """The mount's state: INDI speaks only of changes, so the last word still holds."""
        vector = self._ready().get(_COORDINATES)
        assert vector is not None
        return {"report": self._report(vector, time.time_ns())}

    def leave_safely(self) -> None:
        """End motion and restore sidereal tracking: nobody is left to watch the mount."""
        if self._client is None:
            return
        self.abort({})
        if not self._is_parked() and self._client.get("TELESCOPE_TRACK_STATE") is not None:
            self._switch("TELESCOPE_TRACK_STATE", "TRACK_ON")

    def _on_vector(self, vector: Vector) -> None:
        if vector.name not in _TELLING or self._client is None:
            return
        if self._is_simulated:
            # The simulated mount sends its time just before its coordinates.
            if vector.name == _COORDINATES:
                sim_time = self._client.get("SIM_TIME")
                self._say(vector, int(sim_time.values["UTC_NS"]) if sim_time else 0)
            return
        coordinates = self._client.get(_COORDINATES)
        if coordinates is not None:
            self._say(coordinates, time.time_ns())

    def _say(self, vector: Vector, t_utc_ns: int) -> None:
        self._mouth.say({"event": "report", "report": self._report(vector, t_utc_ns)})

    def _report(self, vector: Vector, t_utc_ns: int) -> dict[str, Any]:
        client = self._ready()
        ra_deg, dec_deg = jnow_to_icrs(
            hours_to_deg(vector.values["RA"]), vector.values["DEC"], t_utc_ns
        )
        if not (math.isfinite(float(ra_deg)) and math.isfinite(float(dec_deg))):
            raise InstrumentError("the mount reports no direction: home or align it")
        park, side = client.get("TELESCOPE_PARK"), client.get("TELESCOPE_PIER_SIDE")
        tracking = client.get("TELESCOPE_TRACK_STATE")
        is_slewing = vector.state == "Busy" or (park is not None and park.state == "Busy")
        is_parked = self._is_parked()
        pier_side = None
        if side is not None and side.values.get("PIER_EAST") != side.values.get("PIER_WEST"):
            pier_side = "east" if side.values["PIER_EAST"] else "west"
        return {
            "t_utc_ns": t_utc_ns,
            "ra_icrs_deg": float(ra_deg),
            "dec_icrs_deg": float(dec_deg),
            "is_slewing": is_slewing,
            "is_parked": is_parked,
            "is_tracking": not is_parked
            and (tracking is None or bool(tracking.values.get("TRACK_ON"))),
            "pier_side": pier_side,
        }

    def _is_parked(self) -> bool:
        park = self._ready().get("TELESCOPE_PARK")
        return park is not None and park.state != "Busy" and bool(park.values.get("PARK"))

    def _refuse_if_parked(self) -> None:
        if self._is_parked():
            raise InstrumentError("the mount is parked and takes no orders: unpark it first")

    def _switch(self, name: str, member: str) -> int:
        client = self._ready()
        before = client.send_switch(name, member)
        self._expect(client.wait(name, lambda _: True, _ACK_S, before), f"set {name}")
        return before

    def _await_report(self, before: int) -> None:
        """The simulated mount reports after every order: wait, so that nobody sees it older."""
        if self._is_simulated:
            self._ready().wait(_COORDINATES, lambda _: True, _ACK_S, before)

    def _expect(self, answer: Vector | None, what: str) -> None:
        words = self._ready().last_message
        if answer is None:
            raise InstrumentError(
                f"the mount did not {what} in {_ACK_S:.0f} s: look at its driver's log. {words}"
            )
        if answer.state == "Alert":
            raise InstrumentError(f"the mount refused to {what}: {words or 'no reason given'}")

    def _ready(self) -> IndiClient:
        if self._client is None:
            raise InstrumentError("the mount is not connected: start it first")
        return self._client


def main() -> None:
    """Obey until the parent goes away."""
    child = MountChild(Mouth())
    orders = [child.start, child.slew, child.park, child.unpark, child.set_tracking]
    orders += [child.set_site, child.site]
    try:
        run_child(
            child._mouth,
            slow={order.__name__: order for order in orders},
            urgent={"abort": child.abort, "report": child.report},
        )
        child.leave_safely()
    finally:
        # PyIndi's threads do not survive an orderly end of the interpreter.
        os._exit(0)


if __name__ == "__main__":
    main()
