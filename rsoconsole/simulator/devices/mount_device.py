"""The simulated mount as an INDI device: coordinates in hours and degrees, epoch of date."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

from indipydriver import Device

from rsoconsole.records import Site
from rsoconsole.simulator.mount.indi_vectors import (
    MountFaults,
    connection_vector,
    driver_info,
    indi_timestamp,
    number_vector,
    requested_numbers,
    requested_switch,
    switch_vector,
    text_vector,
    turn_on,
)
from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.sky import deg_to_hours, hours_to_deg, iso_to_utc_ns, wrap_360
from rsoconsole.words import utc_ns_to_iso

_GROUP = "Main Control"


class MountDevice:
    """INDI telescope device that controls and reports a ``MountModel``."""

    def __init__(
        self,
        name: str,
        model: MountModel,
        site: Site,
        focal_length_mm: float,
        now_utc_ns: Callable[[], int],
    ) -> None:
        self._model = model
        self._now_utc_ns = now_utc_ns
        now = model.instant(now_utc_ns())
        self._coordinates = number_vector(
            "EQUATORIAL_EOD_COORD",
            _GROUP,
            {"RA": deg_to_hours(now.ra_date_deg), "DEC": now.dec_date_deg},
        )
        self._on_set = switch_vector("ON_COORD_SET", _GROUP, ("TRACK", "SLEW", "SYNC"), "TRACK")
        self._abort = switch_vector(
            "TELESCOPE_ABORT_MOTION", _GROUP, ("ABORT",), None, rule="AtMostOne"
        )
        self._park = switch_vector("TELESCOPE_PARK", _GROUP, ("PARK", "UNPARK"), "UNPARK")
        self._tracking = switch_vector(
            "TELESCOPE_TRACK_STATE", _GROUP, ("TRACK_ON", "TRACK_OFF"), "TRACK_ON"
        )
        self._side = switch_vector(
            "TELESCOPE_PIER_SIDE",
            _GROUP,
            ("PIER_WEST", "PIER_EAST"),
            f"PIER_{now.pier_side.upper()}",
            perm="ro",
        )
        aperture_mm = focal_length_mm / 2.2
        self._site = number_vector(
            "GEOGRAPHIC_COORD",
            "Site",
            {
                "LAT": site.latitude_deg,
                "LONG": wrap_360(site.longitude_deg),
                "ELEV": site.elevation_m,
            },
        )
        # libindi's clients do not see the stamps of vectors.
        self._sim_time = text_vector("SIM_TIME", _GROUP, {"UTC_NS": str(now_utc_ns())})
        self._reporting = asyncio.Lock()
        self.faults = MountFaults()
        self._clock_error_ns = 0
        self._time = text_vector("TIME_UTC", "Site", {"UTC": self._iso(), "OFFSET": "0"}, perm="rw")
        self.device = Device(
            name,
            [
                connection_vector(),
                self._coordinates,
                self._on_set,
                self._abort,
                self._park,
                self._tracking,
                self._side,
                self._site,
                self._time,
                self.faults.vector,
                # A fresh client asks for a report with its simulated time.
                switch_vector("SIM_REPORT", _GROUP, ("NOW",), None, rule="AtMostOne"),
                self._sim_time,
                number_vector(
                    "TELESCOPE_INFO",
                    "Options",
                    {
                        "TELESCOPE_APERTURE": aperture_mm,
                        "TELESCOPE_FOCAL_LENGTH": focal_length_mm,
                        "GUIDER_APERTURE": aperture_mm,
                        "GUIDER_FOCAL_LENGTH": focal_length_mm,
                    },
                ),
                number_vector(
                    "TELESCOPE_TRACK_RATE",
                    _GROUP,
                    {"TRACK_RATE_RA": 15.041067, "TRACK_RATE_DE": 0.0},
                    perm="ro",
                ),
                driver_info(name, 5),
            ],
        )

    async def handle(self, event: Any) -> None:
        """Carry out a client's request to set one property, at the present instant."""
        actions = {
            "EQUATORIAL_EOD_COORD": self._handle_coordinates,
            "ON_COORD_SET": self._handle_on_set,
            "TELESCOPE_ABORT_MOTION": self._handle_abort,
            "TELESCOPE_PARK": self._handle_park,
            "TELESCOPE_TRACK_STATE": self._handle_tracking,
            "GEOGRAPHIC_COORD": self._handle_site,
            "TIME_UTC": self._handle_time,
            "SIM_FAULTS": self._handle_faults,
            "SIM_REPORT": self._handle_report,
        }
        action = actions.get(event.vectorname)
        if self.faults.consume_ignored_request(event):
            return
        if action is not None:
            await action(event)
        else:
            await self._acknowledge(event.vector)

    async def report(self) -> None:
        """Send every client the mount's present state; time and coordinates come last."""
        if self.faults.is_silent:
            return
        async with self._reporting:
            t_utc_ns = self._now_utc_ns()
            now = self._model.instant(t_utc_ns)
            if turn_on(self._tracking, "TRACK_ON" if now.is_tracking else "TRACK_OFF"):
                await self._acknowledge(self._tracking)
            if turn_on(self._side, f"PIER_{now.pier_side.upper()}"):
                await self._acknowledge(self._side)
            if self._park.state == "Busy" and not now.is_slewing:
                turn_on(self._park, "PARK" if now.is_parked else "UNPARK")
                await self._acknowledge(self._park)
            self._sim_time["UTC_NS"] = str(t_utc_ns)
            await self._acknowledge(self._sim_time)
            self._coordinates["RA"] = repr(deg_to_hours(now.ra_date_deg))
            self._coordinates["DEC"] = repr(now.dec_date_deg)
            await self._coordinates.send_setVector(
                timestamp=indi_timestamp(t_utc_ns), state="Busy" if now.is_slewing else "Ok"
            )

    def refresh(self) -> None:
        """Update the properties that are sent only on request, without sending them."""
        self._time["UTC"] = self._iso()
        self._sim_time["UTC_NS"] = str(self._now_utc_ns())

    async def _handle_report(self, _event: Any) -> None:
        await self._acknowledge(self._time)
        await self.report()

    async def _handle_site(self, event: Any) -> None:
        """Set the site that the mount believes; where it stands and what it shows stays."""
        for key, value in requested_numbers(self.device, event).items():
            self._site[key] = repr(wrap_360(value) if key == "LONG" else value)
        await self._acknowledge(self._site)

    async def _handle_time(self, event: Any) -> None:
        try:
            set_utc_ns = iso_to_utc_ns(event["UTC"])
        except (KeyError, ValueError):
            await self._refuse("UTC is a time like 2023-06-22T03:04:05", self._time)
            return
        self._clock_error_ns = set_utc_ns - self._now_utc_ns()
        await self._acknowledge(self._time)

    async def _handle_faults(self, event: Any) -> None:
        self.faults.set(requested_numbers(self.device, event))
        await self._acknowledge(self.faults.vector)

    async def _handle_coordinates(self, event: Any) -> None:
        t_utc_ns = self._now_utc_ns()
        if self._model.instant(t_utc_ns).is_parked:
            await self._refuse("the mount is parked: unpark it first")
            return
        try:
            ra_date_deg = hours_to_deg(self.device.indi_number_to_float(event["RA"]))
            dec_date_deg = float(self.device.indi_number_to_float(event["DEC"]))
        except (KeyError, TypeError):
            await self._refuse("RA and DEC are both needed, as numbers")
            return
        if not math.isfinite(ra_date_deg) or not -90.0 <= dec_date_deg <= 90.0:
            await self._refuse(f"declination {dec_date_deg} is outside -90 to 90")
            return
        if self._on_set["SYNC"] == "On":
            await self._refuse("this mount takes no SYNC")
            return
        self._model.slew(wrap_360(ra_date_deg), dec_date_deg, t_utc_ns)
        if self._on_set["SLEW"] == "On":
            self._model.set_tracking(False, t_utc_ns)
        await self.report()

    async def _handle_on_set(self, event: Any) -> None:
        turn_on(self._on_set, requested_switch(event) or "TRACK")
        await self._acknowledge(self._on_set)

    async def _handle_abort(self, _event: Any) -> None:
        t_utc_ns = self._now_utc_ns()
        self._model.abort(t_utc_ns)
        if self.faults.abort_ends_tracking:
            self._model.set_tracking(False, t_utc_ns)
        turn_on(self._abort, None)
        await self._acknowledge(self._abort)
        await self.report()

    async def _handle_park(self, event: Any) -> None:
        t_utc_ns = self._now_utc_ns()
        wanted = requested_switch(event)
        if wanted == "PARK" and not self._model.instant(t_utc_ns).is_parked:
            self._model.park(t_utc_ns)
            turn_on(self._park, "PARK")
            await self._park.send_setVector(timestamp=indi_timestamp(t_utc_ns), state="Busy")
        elif wanted == "UNPARK":
            self._model.abort(t_utc_ns)
            self._model.unpark(t_utc_ns)
            turn_on(self._park, "UNPARK")
            await self._acknowledge(self._park)
        else:
            await self._acknowledge(self._park)
        await self.report()

    async def _handle_tracking(self, event: Any) -> None:
        t_utc_ns = self._now_utc_ns()
        if self._model.instant(t_utc_ns).is_parked:
            await self._refuse("the mount is parked: unpark it first", self._tracking)
            return
        self._model.set_tracking(requested_switch(event) == "TRACK_ON", t_utc_ns)
        turn_on(self._tracking, requested_switch(event))
        await self._acknowledge(self._tracking)
        await self.report()
        if requested_switch(event) == "TRACK_OFF" and self.faults.consume_tracking_return():
            self._model.set_tracking(True, t_utc_ns)
            await self.report()

    async def _acknowledge(self, vector: Any) -> None:
        if vector is self._time:
            self._time["UTC"] = self._iso()
        await vector.send_setVector(timestamp=indi_timestamp(self._now_utc_ns()), state="Ok")

    async def _refuse(self, why: str, vector: Any = None) -> None:
        t = indi_timestamp(self._now_utc_ns())
        await self.device.send_device_message(why, t)
        await (vector or self._coordinates).send_setVector(timestamp=t, state="Alert")

    def _iso(self) -> str:
        """Time of the mount's own clock, finer than the whole seconds of real ones."""
        return utc_ns_to_iso(self._now_utc_ns() + self._clock_error_ns, 3).rstrip("Z")
