"""The simulated camera as an INDI device: it asks the scene for pixels and sends them as FITS."""

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from indipydriver import BLOBMember, BLOBVector, Device

from rsoconsole.records import Site
from rsoconsole.simulator.indi_fits import Card, fits_bytes
from rsoconsole.simulator.indi_vectors import asked_for, numbers, stamp, switches, texts, turn_on
from rsoconsole.simulator.mount_model import MountModel
from rsoconsole.sky.angles import format_dec, format_ra
from rsoconsole.sky.frames import jnow_to_icrs
from rsoconsole.sky.times import utc_ns_to_iso

NS = 1_000_000_000
_GROUP = "Main Control"


class Truth(Protocol):
    """What was really in a frame."""

    def to_json(self) -> str:
        """One line for one frame."""


class SceneLike(Protocol):
    """Draws what the telescope sees."""

    def expose(  # noqa: PLR0917 - drawn the way it is spoken: where, how turned, when, how long
        self,
        boresight_ra_icrs_deg: float,
        boresight_dec_icrs_deg: float,
        rotation_deg: float,
        is_flipped: bool,
        t_start_utc_ns: int,
        exposure_s: float,
    ) -> tuple[npt.NDArray[np.uint16], Truth]:
        """Pixels (height, width) and the truth of one exposure."""

    def sky_notice(self, dec_icrs_deg: float) -> str | None:
        """Why a frame at this declination shows no stars, and the remedy; None where it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTraits:
    """Sensor, optics and how the camera hangs on the telescope."""

    width_px: int
    height_px: int
    pixel_um: float
    focal_length_mm: float
    bits: int = 12
    start_latency_s: float = 0.3
    """From the order to the opening of the shutter; DATE-OBS is the opening."""
    rotation_deg: float = 1.7
    """Position angle of the array's +y axis with the telescope west of the pier."""
    is_flipped: bool = False


@dataclass(frozen=True, slots=True)
class _Exposure:
    t_start_utc_ns: int
    exposure_s: float

    @property
    def t_end_utc_ns(self) -> int:
        return self.t_start_utc_ns + round(self.exposure_s * NS)


class CameraDevice:
    """Answers the CCD interface of INDI; a frame is drawn when its exposure is over."""

    def __init__(
        self,
        *,
        name: str,
        traits: CameraTraits,
        scene: SceneLike,
        mount: MountModel,
        site: Site,
        now_utc_ns: Callable[[], int],
        truth_path: Path | None,
        mount_name: str,
        spawn: Callable[[Coroutine[Any, Any, None]], Any],
    ) -> None:
        self._name, self._traits, self._scene = name, traits, scene
        self._mount, self._site, self._mount_name = mount, site, mount_name
        self._now_utc_ns, self._truth_path, self._spawn = now_utc_ns, truth_path, spawn
        self._exposure: _Exposure | None = None
        self._generation = 0
        self._is_sky_empty = False
        # One thread: frames are drawn in the order in which they were taken.
        self._painter = ThreadPoolExecutor(1, "painter")
        self._exposing = numbers("CCD_EXPOSURE", _GROUP, {"CCD_EXPOSURE_VALUE": 1.0}, form="%.6g")
        self._abort = switches("CCD_ABORT_EXPOSURE", _GROUP, ("ABORT",), None, rule="AtMostOne")
        self._upload = switches(
            "UPLOAD_MODE",
            "Options",
            ("UPLOAD_CLIENT", "UPLOAD_LOCAL", "UPLOAD_BOTH"),
            "UPLOAD_CLIENT",
        )
        self._blob = BLOBVector(
            "CCD1", "Image", "Image Info", "ro", "Idle", [BLOBMember("CCD1", "Image", 0, ".fits")]
        )
        width_px, height_px = traits.width_px, traits.height_px
        others = [
            switches("CONNECTION", _GROUP, ("CONNECT", "DISCONNECT"), "CONNECT"),
            numbers(
                "CCD_INFO",
                "Image Info",
                {
                    "CCD_MAX_X": width_px,
                    "CCD_MAX_Y": height_px,
                    "CCD_PIXEL_SIZE": traits.pixel_um,
                    "CCD_PIXEL_SIZE_X": traits.pixel_um,
                    "CCD_PIXEL_SIZE_Y": traits.pixel_um,
                    "CCD_BITSPERPIXEL": 16,
                },
                perm="ro",
            ),
            numbers(
                "CCD_FRAME",
                "Image Settings",
                {"X": 0, "Y": 0, "WIDTH": width_px, "HEIGHT": height_px},
                perm="ro",
            ),
            numbers("CCD_BINNING", "Image Settings", {"HOR_BIN": 1, "VER_BIN": 1}, perm="ro"),
            texts(
                "DRIVER_INFO",
                "General Info",
                {"DRIVER_NAME": name, "DRIVER_EXEC": "rsoconsole", "DRIVER_INTERFACE": "2"},
            ),
        ]
        self.device = Device(name, [self._exposing, self._abort, self._upload, self._blob, *others])

    async def handle(self, event: Any) -> None:
        """Carry out what a client asks of one property, at the present instant."""
        if event.vectorname == "CCD_EXPOSURE":
            await self._handle_exposure(event)
        elif event.vectorname == "CCD_ABORT_EXPOSURE":
            self._exposure = None
            self._generation += 1
            turn_on(self._abort, None)
            await self._send(self._abort, "Ok")
            self._exposing["CCD_EXPOSURE_VALUE"] = "0"
            await self._send(self._exposing, "Idle")
        elif event.vectorname == "UPLOAD_MODE":
            turn_on(self._upload, asked_for(event))
            await self._send(self._upload, "Ok")
        else:
            await self._send(event.vector, "Ok")

    async def pass_time(self) -> None:
        """Close the shutter where the present instant lies past the exposure's end."""
        exposure = self._exposure
        if exposure is None or self._now_utc_ns() < exposure.t_end_utc_ns:
            return
        self._exposure = None
        t_mid_utc_ns = (exposure.t_start_utc_ns + exposure.t_end_utc_ns) // 2
        # Looked up now: the mount's past is kept only for a while.
        boresight_date_deg = self._mount.boresight_date_deg(t_mid_utc_ns)
        ra_icrs_deg, dec_icrs_deg = jnow_to_icrs(*boresight_date_deg, t_mid_utc_ns)
        cards = self._cards(exposure)
        is_east = self._mount.instant(t_mid_utc_ns).pier_side == "east"
        rotation_deg = (self._traits.rotation_deg + (180.0 if is_east else 0.0)) % 360.0
        pointing = (float(ra_icrs_deg), float(dec_icrs_deg), rotation_deg)
        self._spawn(self._deliver(exposure, pointing, cards, self._generation))

    async def _handle_exposure(self, event: Any) -> None:
        try:
            exposure_s = float(self.device.indi_number_to_float(event["CCD_EXPOSURE_VALUE"]))
        except (KeyError, TypeError):
            exposure_s = 0.0
        if not 1e-6 <= exposure_s <= 3600.0:
            await self._send(self._exposing, "Alert", "an exposure lasts 1e-6 to 3600 s")
            return
        latency_ns = round(self._traits.start_latency_s * NS)
        self._generation += 1
        self._exposure = _Exposure(self._now_utc_ns() + latency_ns, exposure_s)
        self._exposing["CCD_EXPOSURE_VALUE"] = repr(exposure_s)
        await self._send(self._exposing, "Busy")

    async def _deliver(
        self,
        exposure: _Exposure,
        pointing: tuple[float, float, float],
        cards: dict[str, Card],
        generation: int,
    ) -> None:
        loop = asyncio.get_running_loop()
        try:
            file = await loop.run_in_executor(self._painter, self._paint, exposure, pointing, cards)
        except Exception as error:
            await self._send(self._exposing, "Alert", f"the scene cannot be drawn: {error}")
            return
        if generation != self._generation:
            return
        await self._tell_of_empty_sky(pointing[1])
        self._exposing["CCD_EXPOSURE_VALUE"] = "0"
        await self._send(self._exposing, "Ok")
        self._blob["CCD1"] = file
        self._blob.set_blobsize("CCD1", len(file))
        await self._blob.send_setVectorMembers(
            timestamp=stamp(self._now_utc_ns()), state="Ok", members=["CCD1"]
        )

    async def _tell_of_empty_sky(self, dec_icrs_deg: float) -> None:
        """Once when the sky becomes empty; again only after a frame with stars."""
        notice = self._scene.sky_notice(dec_icrs_deg)
        if notice is not None and not self._is_sky_empty:
            await self._say(notice)
        self._is_sky_empty = notice is not None

    def _paint(
        self,
        exposure: _Exposure,
        pointing: tuple[float, float, float],
        cards: dict[str, Card],
    ) -> bytes:
        ra_icrs_deg, dec_icrs_deg, rotation_deg = pointing
        pixels, truth = self._scene.expose(
            ra_icrs_deg,
            dec_icrs_deg,
            rotation_deg,
            self._traits.is_flipped,
            exposure.t_start_utc_ns,
            exposure.exposure_s,
        )
        if self._truth_path is not None:
            with self._truth_path.open("a", encoding="utf-8") as lines:
                lines.write(truth.to_json() + "\n")
        return bytes(fits_bytes(pixels, cards))

    def _cards(self, exposure: _Exposure) -> dict[str, Card]:
        """The header INDI's CCD driver writes; RA and DEC are J2000 from the mount's own belief."""
        belief = self._mount.instant(exposure.t_start_utc_ns)
        ra, dec = jnow_to_icrs(belief.ra_date_deg, belief.dec_date_deg, exposure.t_start_utc_ns)
        traits = self._traits
        return {
            "INSTRUME": self._name,
            "TELESCOP": self._mount_name,
            "ROWORDER": "TOP-DOWN",
            "EXPTIME": exposure.exposure_s,
            "DATE-OBS": utc_ns_to_iso(exposure.t_start_utc_ns, 6).rstrip("Z"),
            "PIXSIZE1": traits.pixel_um,
            "PIXSIZE2": traits.pixel_um,
            "XPIXSZ": traits.pixel_um,
            "YPIXSZ": traits.pixel_um,
            "XBINNING": 1,
            "YBINNING": 1,
            "FRAME": "Light",
            "IMAGETYP": "Light Frame",
            "FOCALLEN": traits.focal_length_mm,
            "APTDIA": traits.focal_length_mm / 2.2,
            "SITELAT": self._site.latitude_deg,
            "SITELONG": self._site.longitude_deg,
            "OBJCTRA": format_ra(float(ra)).replace(":", " "),
            "OBJCTDEC": format_dec(float(dec)).replace(":", " "),
            "RA": float(ra),
            "DEC": float(dec),
            "PIERSIDE": belief.pier_side.upper(),
            "EQUINOX": 2000,
        }

    async def _send(self, vector: Any, state: str, message: str = "") -> None:
        if message:
            await self._say(message)
        await vector.send_setVector(timestamp=stamp(self._now_utc_ns()), state=state)

    async def _say(self, message: str) -> None:
        await self.device.send_device_message(message, stamp(self._now_utc_ns()))
