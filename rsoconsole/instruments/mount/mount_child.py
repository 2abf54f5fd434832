"""The mount's process: converts ICRS degrees of its parent to INDI's hours and epoch of date.

Run as ``python -m rsoconsole.instruments.mount.mount_child``. It watches the mount while its parent
does not (``_mount_watch``). When the parent is gone it ends motion, restores sidereal tracking, and
stays until the limit that the parent last named, or until another process takes over.
"""

import contextlib
import dataclasses
import os
import time
from collections.abc import Callable
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.client_choice import open_client
from rsoconsole.instruments.indi.indi_child import ReplyWriter, execute_orders
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector
from rsoconsole.instruments.indi.reported_motion import (
    ABORT,
    COORDINATES,
    PARK,
    TRACKING,
    ReportedMotion,
)
from rsoconsole.instruments.motion import AfterStop
from rsoconsole.instruments.mount._mount_halt import StopExecutor
from rsoconsole.instruments.mount._mount_owner import MountOwner
from rsoconsole.instruments.mount._mount_watch import MountWatch
from rsoconsole.instruments.mount._track_mode import set_sidereal
from rsoconsole.instruments.mount.mount_lease import Lease
from rsoconsole.instruments.mount.mount_mirror import (
    SIDE,
    TIME,
    CoordinatePoller,
    MountMirror,
    running_clock_offset_s,
)
from rsoconsole.sky import deg_to_hours, hours_to_deg, icrs_to_jnow, separation_deg, wrap_360
from rsoconsole.words import NO_PARK

_REPORTED = (COORDINATES, PARK, TRACKING, SIDE)
_ANSWERED_S = 0.5
_ARRIVED_ALREADY_DEG = 0.05
_SAME_SITE_DEG = 0.01
_FIRST_LOOK_S = 2.0
CAME_BACK = "the mount's driver has come back during an order or a STOP: ABORT was sent first"
PARKING_ENDED = "the mount was not seen at rest in its park position yet: ABORT was sent first"


class MountChild:
    """Executes the parent's orders on one INDI mount; most methods answer one order."""

    def __init__(
        self,
        writer: ReplyWriter,
        *,
        monotonic_s: Callable[[], float] = time.monotonic,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._writer, self._monotonic_s, self._time_ns = writer, monotonic_s, time_ns
        self._is_simulated = False
        self._answer_s = 0.0
        self._after_stop: AfterStop = "track"
        self._address: tuple[str, int, str] | None = None
        self._client: IndiClient | None = None
        self._mirror: MountMirror | None = None
        self._watch: MountWatch | None = None
        self._halt: StopExecutor | None = None
        self._motion = ReportedMotion(monotonic_s)
        self._stops = 0
        """Number of STOPs received: an order from before one is not executed behind it."""

    def start(self, order: dict[str, Any]) -> dict[str, Any]:
        """Connect to the INDI server and the mount, and begin to watch."""
        client, library = open_client(order["client"], order["device"], self._on_vector)
        client.open(order, (COORDINATES, "ON_COORD_SET"), self._writer)
        self._address = order["host"], order["port"], order["device"]
        owner = MountOwner(*self._address)
        self.attach(client, order, owner).start()
        if not self._is_simulated:
            CoordinatePoller(order["host"], order["port"], order["device"], self._motion).start()
        if self._is_simulated:
            before = client.send_switch("SIM_REPORT", "NOW")
            self._expect(COORDINATES, "report", before)
        elif order.get("stops_first"):
            self._writer.send({"event": "message", "text": CAME_BACK})
            self._ready_halt().end_motion("track")
        if client.has_connected_device and not self._is_simulated:
            # What it tells before its first look is no place of the mount.
            client.wait(COORDINATES, lambda vector: not vector.is_definition, _FIRST_LOOK_S)
        return {"client": library.title}

    def attach(self, client: IndiClient, order: dict[str, Any], owner: MountOwner) -> MountWatch:
        """Use a client that is connected already; return the watch, which the caller starts."""
        self._is_simulated, self._after_stop = bool(order["simulated"]), order["after_stop"]
        self._answer_s = float(order["answer_s"])
        self._client = client
        self._mirror = MountMirror(
            client,
            self._is_simulated,
            self._motion,
            monotonic_s=self._monotonic_s,
            time_ns=self._time_ns,
        )
        self._watch = MountWatch(
            lease=Lease(float(order["lease_s"])),
            mirror=self._mirror,
            owner=owner,
            stop=lambda: self._ready_halt().end_motion("track"),
            track=self._track,
            park=lambda: client.send_switch(PARK, "PARK"),
            say=lambda text: self._writer.send({"event": "message", "text": text}),
            on_ended=lambda unwatched_s, lease_s: self._writer.send(
                {"event": "slew ended", "unwatched_s": unwatched_s, "lease_s": lease_s}
            ),
            monotonic_s=self._monotonic_s,
        )
        self._halt = StopExecutor(
            client,
            self._mirror,
            self._motion,
            self._watch,
            track=self._track,
            await_report=self._await_report,
            say=self._writer.send,
            monotonic_s=self._monotonic_s,
        )
        return self._watch

    def abilities(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Return what the driver can do."""
        return {"abilities": dataclasses.asdict(self._ready()[1].abilities)}

    def on_order(self, order: dict[str, Any]) -> None:
        """Note the arrival of an order: it shows that the parent is alive."""
        if order["verb"] == "abort":
            self._stops += 1
        order["stops"] = self._stops
        if self._watch is not None:
            self._watch.lease.renew(self._monotonic_s())

    def keep(self, order: dict[str, Any]) -> dict[str, Any]:
        """Renew the lease, and set the instant at which tracking must end."""
        if self._watch is not None:
            self._watch.keep(float(order["lease_s"]), order["track_until_utc_ns"])
        return {}

    def slew(self, order: dict[str, Any]) -> dict[str, Any]:
        """Slew to an ICRS direction and track; returns when the mount has accepted the order."""
        client, mirror = self._ready()
        self._refuse_if_parked()
        if mirror.is_parking:
            raise InstrumentError("the mount is on its way to its park position: unpark it first")
        self._new_order(order)
        if self._watch is not None:
            self._watch.note_slew_order()
        ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(
            order["ra_icrs_deg"], order["dec_icrs_deg"], order["now_utc_ns"]
        )
        self.set_sidereal_rate()
        on_set = client.get("ON_COORD_SET")
        if on_set is None or not on_set.values.get("TRACK"):
            self._switch("ON_COORD_SET", "TRACK")
        target = {"RA": deg_to_hours(float(ra_jnow_deg)), "DEC": float(dec_jnow_deg)}
        self._refuse_if_overtaken(order)
        before = client.send_numbers(COORDINATES, target)
        if self._is_overtaken(order):
            client.send_switch(ABORT, "ABORT")
        self._refuse_if_overtaken(order)

        def is_answer(vector: Vector) -> bool:
            # Some drivers never say that they are busy.
            if vector.state in ("Busy", "Alert") or mirror.motion.is_fast:
                return True
            ra_deg = hours_to_deg(vector.values["RA"])
            distance_deg = separation_deg(
                ra_deg, vector.values["DEC"], float(ra_jnow_deg), float(dec_jnow_deg)
            )
            return bool(distance_deg < _ARRIVED_ALREADY_DEG)

        answer = client.wait(COORDINATES, is_answer, self._answer_s, before)
        if answer is None:
            raise self._unanswered("start to slew", before)
        if answer.state == "Alert":
            raise InstrumentError(
                f"the mount refused to slew: {client.failure_reason_since(before)}"
            )
        return {}

    def abort(self, order: dict[str, Any]) -> dict[str, Any]:
        """End motion; returns when the driver has answered, or after 2 s without an answer."""
        return self._ready_halt().end_motion(
            self._after_stop,
            had_tracking=bool(order.get("had_tracking")),
            on_progress=lambda what: self._writer.send(
                {"event": what, "number": order.get("number"), "at_s": self._monotonic_s()}
            ),
        )

    def park(self, order: dict[str, Any]) -> dict[str, Any]:
        """Send the mount to its park position; a parked mount is left as it is."""
        client, mirror = self._ready()
        if not mirror.abilities.can_park:
            raise InstrumentError(f"{NO_PARK}: it cannot park")
        if mirror.is_parked or mirror.is_parking:
            return {}
        self._new_order(order)
        before = client.send_switch(PARK, "PARK")
        self._await_report(self._expect(PARK, "park", before).serial)
        return {}

    def unpark(self, order: dict[str, Any]) -> dict[str, Any]:
        """Release a parked mount; a mount on its way to its park position is stopped."""
        client, mirror = self._ready()
        self._new_order(order)
        if mirror.is_parking:
            self._writer.send({"event": "message", "text": PARKING_ENDED})
            self._ready_halt().end_motion("track")
        if mirror.is_reported_parked:
            before = client.send_switch(PARK, "UNPARK")
            released = self._expect(
                PARK, "unpark", before, lambda v: v.state == "Alert" or not v.values.get("PARK")
            )
            self._await_report(released.serial)
        return {}

    def set_tracking(self, order: dict[str, Any]) -> dict[str, Any]:
        """Turn sidereal tracking on or off; during a slew this takes effect at its end."""
        wanted = bool(order["is_on"])
        if wanted:  # a mount that says that it is parked may track all the same
            self._refuse_if_parked()
        self._new_order(order)
        if wanted:
            self.set_sidereal_rate()
        if self._track(wanted) is not wanted and not self._ready()[1].is_moving:
            raise InstrumentError(
                f"the mount did not turn tracking {'on' if wanted else 'off'}: "
                "look at its driver's log"
            )
        return {}

    def set_sidereal_rate(self, _order: dict[str, Any] | None = None) -> dict[str, Any]:
        """Set the sidereal rate, where the mount has another one to track at."""
        if text := set_sidereal(self._ready()[0]):
            self._writer.send({"event": "message", "text": text})
        return {}

    def set_site(self, order: dict[str, Any]) -> dict[str, Any]:
        """Set the site in the mount; INDI's longitude runs from 0 to 360 deg east."""
        client, _ = self._ready()
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
            off_deg = separation_deg(
                vector.values["LONG"], vector.values["LAT"], order["longitude_deg"], latitude_deg
            )
            return vector.state == "Alert" or bool(off_deg < _SAME_SITE_DEG)

        self._expect("GEOGRAPHIC_COORD", "take its site", before, is_answer)
        return {}

    def site(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Return the site that the mount reports; None where it reports none."""
        return {"site": self._ready()[1].site()}

    def utc_offset(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Return the mount's clock minus the machine's, s; None where not known."""
        client, mirror = self._ready()
        if self._is_simulated:
            before = client.send_switch("SIM_REPORT", "NOW")
            reported = client.wait(TIME, lambda _: True, self._answer_s, before)
            if reported is not None:
                # The observatory's time comes behind the mount's: the one before it is older.
                self._await_report(reported.serial)
        elif client.get(TIME) is None:
            # Right after the start a driver may still be telling its properties.
            client.wait(TIME, lambda _: True, _ANSWERED_S)
        offset_s = mirror.utc_offset_s()
        if offset_s is None and client.get(TIME) is not None and self._address is not None:
            # Another program has connected it: what it says may be of then, or of now.
            with contextlib.suppress(InstrumentError):
                offset_s = running_clock_offset_s(*self._address)
        return {"offset_s": offset_s}

    def report(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Return the mount's present state, the fields of a ``MountReport``."""
        return {"report": self._ready()[1].fresh_report()}

    def shut_down(self, *, is_orderly: bool) -> None:
        """End motion, restore sidereal tracking; then watch the mount unless ``is_orderly``.

        ``is_orderly``: True where the parent ordered the end; False where it just ended. A mount on
        its way to its park position continues, and a mount at rest stays at rest: both are safe.
        """
        if self._watch is None or self._mirror is None:
            return
        self._watch.end()
        if not self._watch.is_taken_over and not self._mirror.is_parking:
            self._ready_halt().end_motion("track")
            if not (is_orderly or self._is_simulated):
                self._watch.finish_stop_measurement()
        if not is_orderly:
            self._watch.watch_unattended()
        self._watch.owner.release()

    def _ready_halt(self) -> StopExecutor:
        self._ready()
        assert self._halt is not None
        return self._halt

    def _track(self, is_on: bool) -> bool | None:
        """Turn tracking on or off; return its state after that.

        None for a mount that does not report it.
        """
        client, mirror = self._ready()
        if client.get(TRACKING) is None:
            return None
        member = "TRACK_ON" if is_on else "TRACK_OFF"
        answer = self._switch(TRACKING, member)
        client.wait(TRACKING, lambda v: bool(v.values.get(member)), _ANSWERED_S, answer.serial - 1)
        self._await_report(answer.serial)
        return mirror.is_reported_tracking

    def _new_order(self, order: dict[str, Any]) -> None:
        """End earlier orders: a STOP's measurement, tracking that was to be held.

        Raises InstrumentError where STOP has come since the order was sent.
        """
        self._refuse_if_overtaken(order)
        self._ready()[1].note_order()
        if self._watch is not None:
            self._watch.hold_tracking(None)
            self._watch.set_stop_measurement(None)

    def _is_overtaken(self, order: dict[str, Any]) -> bool:
        return int(order.get("stops", self._stops)) != self._stops

    def _refuse_if_overtaken(self, order: dict[str, Any]) -> None:
        if self._is_overtaken(order):
            raise InstrumentError("STOP came before the mount had taken this order")

    def _on_vector(self, vector: Vector) -> None:
        self._motion.take(vector)
        if vector.name not in _REPORTED or self._client is None or self._mirror is None:
            return
        # The simulated mount sends its time just before its coordinates.
        if not self._is_simulated or vector.name == COORDINATES:
            coordinates = self._client.get(COORDINATES)
            if coordinates is not None:
                self._report(coordinates)
        if self._watch is not None:
            self._watch.look(is_moving=self._mirror.is_moving)

    def _report(self, coordinates: Vector) -> None:
        assert self._mirror is not None
        self._writer.send(
            {
                "event": "report",
                "report": self._mirror.report(coordinates, self._mirror.now_utc_ns()),
                "tracks_after_stop": self._mirror.tracking_to_order("track"),
            }
        )

    def _refuse_if_parked(self) -> None:
        if self._ready()[1].is_reported_parked:
            raise InstrumentError("the mount is parked and takes no orders: unpark it first")

    def _switch(self, name: str, member: str) -> Vector:
        client, _ = self._ready()
        before = client.send_switch(name, member)
        return self._expect(name, f"set {name}", before)

    def _await_report(self, answered: int) -> None:
        """Wait for the report that the simulated mount sends after every answer.

        So no caller reads an older one.
        """
        if self._is_simulated:
            self._ready()[0].wait(COORDINATES, lambda _: True, self._answer_s, answered)

    def _expect(
        self,
        name: str,
        what: str,
        before: int,
        is_answer: Callable[[Vector], bool] = lambda _: True,
    ) -> Vector:
        """Return the property with which the driver answers an order.

        ``before``: number of the last update before the order. Raises InstrumentError where it
        refuses or does not answer in time.
        """
        client, _ = self._ready()
        answer = client.wait(name, is_answer, self._answer_s, before)
        if answer is None:
            raise self._unanswered(what, before)
        if answer.state == "Alert":
            raise InstrumentError(
                f"the mount refused to {what}: {client.failure_reason_since(before)}"
            )
        return answer

    def _unanswered(self, what: str, before: int) -> InstrumentError:
        said = self._ready()[0].driver_message_since(before)
        return InstrumentError(
            f"the mount did not {what} in {self._answer_s:.0f} s: look at its driver's log"
            f"{f' ({said})' if said else ''}; a slow device needs a larger waits.answer_s"
        )

    def _ready(self) -> tuple[IndiClient, MountMirror]:
        if self._client is None or self._mirror is None:
            raise InstrumentError("the mount is not connected: start it first")
        return self._client, self._mirror


def main() -> None:
    """Execute the orders that come on stdin, until the parent ends."""
    child = MountChild(ReplyWriter())
    orders = [child.start, child.slew, child.park, child.unpark, child.set_tracking]
    others = [child.set_site, child.site, child.utc_offset, child.set_sidereal_rate]
    try:
        is_orderly = execute_orders(
            child._writer,
            slow={order.__name__: order for order in (*orders, *others)},
            urgent={
                "abort": child.abort,
                "report": child.report,
                "keep": child.keep,
                "abilities": child.abilities,
            },
            on_order=child.on_order,
        )
        child.shut_down(is_orderly=is_orderly)
    finally:
        # The client's threads do not survive an orderly end of the interpreter.
        os._exit(0)


if __name__ == "__main__":
    main()
