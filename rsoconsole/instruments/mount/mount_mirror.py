"""State of an INDI mount: what its driver reports, corrected by the measured motion.

Where the reported directions determine the motion, they count more than the reported state.
"""

import contextlib
import dataclasses
import math
import threading
import time
from collections.abc import Callable, Collection
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector
from rsoconsole.instruments.indi.indi_wire import IndiWire
from rsoconsole.instruments.indi.reported_motion import (
    ABORT,
    COORDINATES,
    PARK,
    POLLING,
    TRACKING,
    ReportedMotion,
)
from rsoconsole.instruments.motion import AfterStop, Motion, tracking_after_stop
from rsoconsole.instruments.ports import MountAbilities
from rsoconsole.sky import hours_to_deg, iso_to_utc_ns, jnow_to_icrs, wrap_180

SIDE = "TELESCOPE_PIER_SIDE"
TIME = "TIME_UTC"
SITE = "GEOGRAPHIC_COORD"
OFFERED = (ABORT, TRACKING, PARK, SIDE, SITE, TIME)
"""Properties that some drivers lack."""
SILENT_SLEW_S = 10.0
"""Longest silence believed of a driver that slews: drivers then report several times a second."""
PARK_PROOF_S = 5.0
"""Time within which a mount that is reported to be parked is measured, where it can be."""
BUSY_AT_REST_S = 10.0
"""Time of measured rest, s, after which an ordered mount has arrived, whatever its driver says."""
_NS = 1_000_000_000


class MountMirror:
    """State of one mount, from the last values of its properties and its measured motion."""

    def __init__(
        self,
        client: IndiClient,
        is_simulated: bool,
        reported: ReportedMotion | None = None,
        *,
        monotonic_s: Callable[[], float] = time.monotonic,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """``reported`` None: the motion is not measured."""
        self._client, self._is_simulated = client, is_simulated
        self._reported = reported or ReportedMotion(monotonic_s)
        self._monotonic_s, self._time_ns = monotonic_s, time_ns
        self._ordered_s = -math.inf

    def note_order(self) -> None:
        """Note that an order is sent now: earlier measurements no longer count."""
        self._ordered_s = self._monotonic_s()
        self._reported.begin()

    @property
    def motion(self) -> Motion:
        """Measured motion of the mount.

        Unknown for a parked mount whose driver no longer polls it: coordinates that never change
        would look like tracking.
        """
        motion = self._reported.motion()
        if (
            motion.kind == "tracks"
            and self.is_reported_parked
            and not self._reported.has_recent_report
        ):
            tracking = self._client.get(TRACKING)
            if tracking is None or not tracking.values.get("TRACK_ON"):
                return Motion()
        return motion

    @property
    def abilities(self) -> MountAbilities:
        """What the driver can do."""

        return abilities_from_properties(
            {name for name in OFFERED if self._client.get(name) is not None}
        )

    @property
    def is_reported_parked(self) -> bool:
        """True when the driver reports that the mount is parked."""
        park = self._client.get(PARK)
        return park is not None and park.state != "Busy" and bool(park.values.get("PARK"))

    @property
    def is_parked(self) -> bool:
        """True when the driver reports that the mount is parked, and no slew is measured.

        Some drivers report it with the order, before the mount is there: what was reported just now
        is believed once the mount is measured at rest, or ``PARK_PROOF_S`` later.
        """
        return self.is_reported_parked and not (self.motion.is_fast or self._is_park_unproven)

    @property
    def _is_park_unproven(self) -> bool:
        park = self._client.get(PARK)
        if self._is_simulated or park is None or park.is_definition or not self.is_reported_parked:
            return False
        is_new = self._monotonic_s() - park.arrived_monotonic_s < PARK_PROOF_S
        return is_new and not self.motion.is_at_rest

    @property
    def is_parking(self) -> bool:
        """True while the driver reports that the mount is on its way to its park position, or that
        it is there and nothing shows it yet.
        """
        return self._is_reported_parking or self._is_park_unproven

    @property
    def _is_reported_parking(self) -> bool:
        park = self._client.get(PARK)
        return park is not None and park.state == "Busy"

    @property
    def is_reported_moving(self) -> bool:
        """True while the driver reports that the mount slews or parks."""
        coordinates = self._client.get(COORDINATES)
        is_busy = coordinates is not None and coordinates.state == "Busy"
        return self._is_reported_parking or is_busy

    @property
    def is_moving(self) -> bool:
        """True while the mount slews or parks: as measured, else as its driver reports it."""
        motion = self.motion
        if motion.is_fast:
            return True
        ordered_ago_s = self._monotonic_s() - self._ordered_s
        return self.is_reported_moving and not (
            motion.is_at_rest and ordered_ago_s > BUSY_AT_REST_S
        )

    @property
    def is_slewing(self) -> bool:
        """True while the mount slews, but not to its park position."""
        return self.is_moving and not self.is_parking and not self.is_parked

    @property
    def is_reported_tracking(self) -> bool:
        """True when the driver reports tracking, or reports nothing about tracking.

        False for a mount reported as parked.
        """
        tracking = self._client.get(TRACKING)
        return not self.is_reported_parked and (
            tracking is None or bool(tracking.values.get("TRACK_ON"))
        )

    @property
    def is_tracking(self) -> bool:
        """True when the mount is measured to track; where it is not measured at rest, as
        reported.
        """
        motion = self.motion
        return motion.kind == "tracks" if motion.is_at_rest else self.is_reported_tracking

    def now_utc_ns(self) -> int:
        """Return the machine's time, UTC ns; in a simulated observatory its last reported
        instant.
        """
        if not self._is_simulated:
            return self._time_ns()
        sim_time = self._client.get("SIM_TIME")
        return int(sim_time.values["UTC_NS"]) if sim_time is not None else 0

    def tracking_to_order(self, after_stop: AfterStop) -> bool | None:
        """Return whether a STOP now must turn tracking on or off; None: leave it as it is."""
        return tracking_after_stop(
            after_stop,
            was_slewing=self.is_slewing,
            was_parking=self.is_parking,
            was_tracking=self.is_tracking,
            is_parked=self.is_parked,
        )

    def report(self, coordinates: Vector, t_utc_ns: int) -> dict[str, Any]:
        """Return the fields of a ``MountReport`` for ``coordinates`` at ``t_utc_ns``.

        Raises InstrumentError where the coordinates are not finite numbers.
        """
        ra_deg, dec_deg = jnow_to_icrs(
            hours_to_deg(coordinates.values["RA"]), coordinates.values["DEC"], t_utc_ns
        )
        if not (math.isfinite(float(ra_deg)) and math.isfinite(float(dec_deg))):
            raise InstrumentError("the mount reports no direction: home or align it")
        side = self._client.get(SIDE)
        pier_side = None
        if side is not None and side.values.get("PIER_EAST") != side.values.get("PIER_WEST"):
            pier_side = "east" if side.values["PIER_EAST"] else "west"
        age_s = self._monotonic_s() - coordinates.arrived_monotonic_s
        return {
            "t_utc_ns": t_utc_ns,
            "ra_icrs_deg": float(ra_deg),
            "dec_icrs_deg": float(dec_deg),
            "is_slewing": self.is_moving,
            "is_parking": self.is_parking,
            "is_parked": self.is_parked,
            "is_tracking": self.is_tracking,
            "pier_side": pier_side,
            "age_s": 0.0 if self._is_simulated else age_s,
            "motion": dataclasses.asdict(self.motion),
        }

    def fresh_report(self) -> dict[str, Any]:
        """Return the fields of a ``MountReport`` for now, from the last reported coordinates.

        INDI sends only changes, so the last coordinates still hold. Raises InstrumentError when
        they are old and show a slew: then the driver is silent.
        """
        coordinates = self._client.get(COORDINATES)
        assert coordinates is not None
        report = self.report(coordinates, self._time_ns())
        is_silent = report["age_s"] > SILENT_SLEW_S and not self.motion.is_at_rest
        if coordinates.state == "Busy" and is_silent:
            raise InstrumentError(
                f"the mount has said nothing for {report['age_s']:.0f} s in the middle of a slew: "
                "check its cable and driver, and look at the telescope"
            )
        return report

    def utc_offset_s(self) -> float | None:
        """Return the mount's clock minus the machine's, s; None where not known.

        In a simulated observatory the observatory's clock is subtracted. Drivers repeat an old time
        to new clients: of a time reported before this process connected, only a positive offset
        counts.
        """
        vector = self._client.get(TIME)
        mount_utc_ns = None if vector is None else _utc_ns(str(vector.values.get("UTC") or ""))
        if vector is None or mount_utc_ns is None:
            return None
        if self._is_simulated:
            return (mount_utc_ns - self.now_utc_ns()) / _NS
        age_ns = round((self._monotonic_s() - vector.arrived_monotonic_s) * _NS)
        offset_s = (mount_utc_ns - (self._time_ns() - age_ns)) / _NS
        is_fresh = not vector.is_definition or self._client.has_connected_device
        return offset_s if is_fresh or offset_s > 0.0 else None

    def site(self) -> dict[str, float] | None:
        """Return the fields of a ``Site`` as the mount reports it; None where it reports none."""
        vector = self._client.get(SITE)
        if vector is None:
            return None
        return {
            "latitude_deg": vector.values["LAT"],
            "longitude_deg": wrap_180(vector.values["LONG"]),
            "elevation_m": vector.values.get("ELEV", 0.0),
        }


def abilities_from_properties(properties: Collection[str]) -> MountAbilities:
    """Return the abilities of an INDI driver that has defined these properties."""
    return MountAbilities(
        can_abort=ABORT in properties,
        can_park=PARK in properties,
        can_set_tracking=TRACKING in properties,
        has_pier_side=SIDE in properties,
        has_site=SITE in properties,
        has_time=TIME in properties,
    )


def _utc_ns(text: str) -> int | None:
    """Instant of ISO 8601 as INDI writes it, without a zone; None where it is none."""
    try:
        return iso_to_utc_ns(text)
    except ValueError:
        return None


_CLOCK_APART_S, _CLOCK_ANSWER_S = 4.0, 2.0
"""Time between two questions for a clock that shows whole seconds, and for an answer, s."""


def running_clock_offset_s(host: str, port: int, device: str) -> float | None:
    """Return the mount's clock minus the machine's, s, by a driver that answers with the present.

    It is asked twice: most drivers repeat the time that they were once given, which says nothing.
    None for those, and without an answer. Raises InstrumentError where no server answers.
    """
    wire = IndiWire(host, port)
    try:
        offsets_s: list[float] = []
        for number in range(2):
            if number:
                # What the driver tells everybody meanwhile is not the answer.
                wire.wait(lambda _: False, _CLOCK_APART_S)
            wire.ask(device, TIME)
            vector = wire.wait(lambda v: (v.device, v.name) == (device, TIME), _CLOCK_ANSWER_S)
            mount_utc_ns = None if vector is None else _utc_ns(vector.values.get("UTC", ""))
            if mount_utc_ns is None:
                return None
            offsets_s.append((mount_utc_ns - time.time_ns()) / _NS)
    finally:
        wire.close()
    is_running = abs(offsets_s[1] - offsets_s[0]) < _CLOCK_APART_S / 2.0
    return offsets_s[1] if is_running else None


_LOOK_S = 0.1
_HELD_UP_S = 0.6
_AGAIN_S = 2.0


class CoordinatePoller:
    """Requests a silent driver's coordinates again and again, on a thread of its own."""

    def __init__(self, host: str, port: int, device: str, motion: ReportedMotion) -> None:
        """``motion`` receives the answers, besides the reports that the driver sends by itself."""
        self._host, self._port, self._device, self._motion = host, port, device, motion

    def start(self) -> None:
        """Begin to request and read."""
        threading.Thread(target=self._run, daemon=True, name="coordinate poller").start()

    def _run(self) -> None:
        while True:
            with contextlib.suppress(InstrumentError):
                wire = IndiWire(self._host, self._port)
                try:
                    self._listen(wire)
                finally:
                    wire.close()
            time.sleep(_AGAIN_S)

    def _listen(self, wire: IndiWire) -> None:
        """Read until the server hangs up: then InstrumentError."""
        self._motion.begin()
        wire.ask(self._device, POLLING)
        looked_s = time.monotonic()
        while True:
            vector = wire.wait(lambda each: each.device == self._device, _LOOK_S)
            now_s = time.monotonic()
            if now_s - looked_s > _HELD_UP_S:
                self._motion.reset_after_delay()
            looked_s = now_s
            if vector is not None and vector.is_definition:
                self._motion.take(vector)
            if self._motion.wants_word():
                wire.ask(self._device, COORDINATES)
