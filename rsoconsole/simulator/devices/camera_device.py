"""The simulated camera as an INDI device, which sends the scene's exposures as FITS files."""

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indipydriver import BLOBMember, BLOBVector, Device

from rsoconsole.records import FloatArray, Site
from rsoconsole.simulator.camera.indi_fits import (
    CameraTraits,
    Card,
    Fate,
    draw_frame_delivery,
    fits_bytes,
)
from rsoconsole.simulator.camera.truth import header_start_utc_ns
from rsoconsole.simulator.devices._read_out import ReadOutMode, ReadOutVectors
from rsoconsole.simulator.mount.indi_vectors import (
    connection_vector,
    driver_info,
    indi_timestamp,
    number_vector,
    requested_numbers,
    requested_switch,
    switch_vector,
    turn_on,
)
from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.simulator.scene.scene import Scene
from rsoconsole.simulator.world.world import DEFAULT_WORLD, World
from rsoconsole.sky import jnow_to_icrs
from rsoconsole.words import NS_PER_S, format_dec, format_ra, utc_ns_to_iso

_GROUP = "Main Control"


@dataclass(frozen=True, slots=True)
class _Exposure:
    t_start_utc_ns: int
    """Start noted by the driver; like all instants here by the observatory's clock."""
    exposure_s: float
    opens_later_s: float
    fate: Fate
    late_s: float
    mode: ReadOutMode

    @property
    def t_end_utc_ns(self) -> int:
        """End of the exposure by the driver: its start plus the exposure."""
        return self.t_start_utc_ns + round(self.exposure_s * NS_PER_S)

    @property
    def t_due_utc_ns(self) -> int:
        """Instant at which its frame is delivered."""
        later_s = max(0.0, self.opens_later_s) + (self.late_s if self.fate == "late" else 0.0)
        return self.t_end_utc_ns + round(later_s * NS_PER_S)

    def at(self, share: float) -> int:
        """Instant at this fraction of the true exposure: 0 is its opening, 1 its closing."""
        since_s = self.opens_later_s + share * self.exposure_s
        return self.t_start_utc_ns + round(since_s * NS_PER_S)


class CameraDevice:
    """Simulated INDI camera; it draws each frame when the exposure is over."""

    def __init__(
        self,
        *,
        name: str,
        traits: CameraTraits,
        scene: Scene,
        mount: MountModel,
        site: Site,
        now_utc_ns: Callable[[], int],
        truth_path: Path | None,
        mount_name: str,
        spawn: Callable[[Coroutine[Any, Any, None]], Any],
        world: World = DEFAULT_WORLD,
        seed: int = 0,
    ) -> None:
        self._world, self._seed = world, seed
        self._t_night_utc_ns = now_utc_ns()
        self._name, self._traits, self._scene = name, traits, scene
        self._mount, self._site, self._mount_name = mount, site, mount_name
        self._now_utc_ns, self._truth_path, self._spawn = now_utc_ns, truth_path, spawn
        self._exposure: _Exposure | None = None
        self._read_out = ReadOutVectors(traits, can_bin=isinstance(scene, Scene))
        self._scenes: dict[int, Scene] = {1: scene}
        """Scenes by the factor of pixels that they join beyond the first scene's."""
        self._generation = 0
        self._is_sky_empty = False
        # One thread: frames are drawn in the order in which they were taken.
        self._painter = ThreadPoolExecutor(1, "painter")
        self._exposing = number_vector(
            "CCD_EXPOSURE", _GROUP, {"CCD_EXPOSURE_VALUE": 1.0}, form="%.6g"
        )
        self._abort = switch_vector(
            "CCD_ABORT_EXPOSURE", _GROUP, ("ABORT",), None, rule="AtMostOne"
        )
        self._upload = switch_vector(
            "UPLOAD_MODE",
            "Options",
            ("UPLOAD_CLIENT", "UPLOAD_LOCAL", "UPLOAD_BOTH"),
            "UPLOAD_CLIENT",
        )
        self._blob = BLOBVector(
            "CCD1", "Image", "Image Info", "ro", "Idle", [BLOBMember("CCD1", "Image", 0, ".fits")]
        )
        whole, pixel_um = self._read_out.mode, traits.pixel_um / traits.binning
        self.device = Device(
            name,
            [
                self._exposing,
                self._abort,
                self._upload,
                self._blob,
                connection_vector(),
                number_vector(
                    "CCD_INFO",
                    "Image Info",
                    {
                        "CCD_MAX_X": whole.width_px,
                        "CCD_MAX_Y": whole.height_px,
                        "CCD_PIXEL_SIZE": pixel_um,
                        "CCD_PIXEL_SIZE_X": pixel_um,
                        "CCD_PIXEL_SIZE_Y": pixel_um,
                        "CCD_BITSPERPIXEL": 16,
                    },
                    perm="ro",
                ),
                self._read_out.frame,
                self._read_out.binning,
                driver_info(name, 2),
            ],
        )

    async def handle(self, event: Any) -> None:
        """Carry out a client's request to set one property, at the present instant."""
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
            turn_on(self._upload, requested_switch(event))
            await self._send(self._upload, "Ok")
        elif event.vectorname in ("CCD_BINNING", "CCD_FRAME"):
            await self._handle_read_out(event)
        else:
            await self._send(event.vector, "Ok")

    async def pass_time(self) -> None:
        """Finish the exposure under way if its end has passed, and have its frame delivered."""
        exposure = self._exposure
        if exposure is None or self._now_utc_ns() < exposure.t_due_utc_ns:
            return
        self._exposure = None
        if exposure.fate == "dropped":
            return
        if exposure.fate == "failed":
            await self._send(self._exposing, "Alert", "the frame was lost between camera and host")
            return
        t_mid_utc_ns = exposure.at(0.5)
        # Looked up now: the mount's past is kept only for a while.
        boresight_date_deg = self._mount.boresight_date_deg(t_mid_utc_ns)
        ra_icrs_deg, dec_icrs_deg = jnow_to_icrs(*boresight_date_deg, t_mid_utc_ns)
        cards = self._cards(exposure)
        is_east = self._mount.instant(t_mid_utc_ns).pier_side == "east"
        turned_deg = self._traits.rotation_deg + (180.0 if is_east else 0.0)
        hours = (t_mid_utc_ns - self._t_night_utc_ns) / NS_PER_S / 3600.0
        rotation_deg = (turned_deg + self._world.optics.rotation_deg_h * hours) % 360.0
        pointing = (float(ra_icrs_deg), float(dec_icrs_deg), rotation_deg)
        path = None  # a restless mount's, (2, k) arcsec east and north of the middle
        if not self._mount.unrest.is_zero:
            path = self._mount.creep_and_jump_path_arcsec(exposure.at(0.0), exposure.at(1.0))
        self._spawn(self._deliver(exposure, pointing, path, cards, self._generation))

    def awaited_frame_due_utc_ns(self) -> int | None:
        """Return when the awaited frame of a finished exposure is due; None: none is awaited."""
        exposure = self._exposure
        if exposure is None or self._now_utc_ns() < exposure.t_end_utc_ns:
            return None
        return exposure.t_due_utc_ns

    async def _handle_read_out(self, event: Any) -> None:
        asked = requested_numbers(self.device, event)
        is_binning = event.vectorname == "CCD_BINNING"
        vectors = self._read_out
        vector = vectors.binning if is_binning else vectors.frame
        if self._exposure is not None:
            await self._send(vector, "Alert", "an exposure is under way")
        elif vectors.set_binning(asked) if is_binning else vectors.set_frame(asked):
            await self._send(vector, "Ok")
            await self._send(vectors.frame if is_binning else vectors.binning, "Ok")
        else:
            await self._send(vector, "Alert", "the camera cannot read out so")

    def _scene_of(self, mode: ReadOutMode) -> Scene:
        factor = mode.scene_binning_factor(self._traits) or 1
        if factor not in self._scenes:
            self._scenes[factor] = self._scene.binned(factor)
        return self._scenes[factor]

    async def _handle_exposure(self, event: Any) -> None:
        try:
            exposure_s = float(self.device.indi_number_to_float(event["CCD_EXPOSURE_VALUE"]))
        except (KeyError, TypeError):
            exposure_s = 0.0
        if not 1e-6 <= exposure_s <= 3600.0:
            await self._send(self._exposing, "Alert", "an exposure lasts 1e-6 to 3600 s")
            return
        latency_ns = round(self._traits.start_latency_s * NS_PER_S)
        self._generation += 1
        t_start_utc_ns = self._now_utc_ns() + latency_ns
        self._exposure = _Exposure(
            t_start_utc_ns,
            exposure_s,
            self._world.shutter.latency_s + self._world.shutter.bias_s,
            draw_frame_delivery(self._world.frames, self._seed, t_start_utc_ns),
            self._world.frames.late_s,
            self._read_out.mode,
        )
        self._exposing["CCD_EXPOSURE_VALUE"] = repr(exposure_s)
        await self._send(self._exposing, "Busy")

    async def _deliver(
        self,
        exposure: _Exposure,
        pointing: tuple[float, float, float],
        path: FloatArray | None,
        cards: dict[str, Card],
        generation: int,
    ) -> None:
        loop = asyncio.get_running_loop()
        try:
            file = await loop.run_in_executor(
                self._painter, self._paint, exposure, pointing, path, cards
            )
        except Exception as error:
            await self._send(self._exposing, "Alert", f"the scene cannot be drawn: {error}")
            return
        if generation != self._generation:
            return
        await self._report_empty_sky(pointing[1])
        self._exposing["CCD_EXPOSURE_VALUE"] = "0"
        await self._send(self._exposing, "Ok")
        self._blob["CCD1"] = file
        self._blob.set_blobsize("CCD1", len(file))
        await self._blob.send_setVectorMembers(
            timestamp=indi_timestamp(self._now_utc_ns()), state="Ok", members=["CCD1"]
        )

    async def _report_empty_sky(self, dec_icrs_deg: float) -> None:
        """Report an empty sky once; again only after a frame with stars."""
        notice = self._scene.empty_sky_message(dec_icrs_deg)
        if notice is not None and not self._is_sky_empty:
            await self._say(notice)
        self._is_sky_empty = notice is not None

    def _paint(
        self,
        exposure: _Exposure,
        pointing: tuple[float, float, float],
        path: FloatArray | None,
        cards: dict[str, Card],
    ) -> bytes:
        ra_icrs_deg, dec_icrs_deg, rotation_deg = pointing
        pixels, truth = self._scene_of(exposure.mode).expose(
            ra_icrs_deg,
            dec_icrs_deg,
            rotation_deg,
            self._traits.is_flipped,
            exposure.t_start_utc_ns,
            exposure.exposure_s,
            *(() if path is None else (path,)),
        )
        if self._truth_path is not None:
            with self._truth_path.open("a", encoding="utf-8") as lines:
                lines.write(truth.to_json() + "\n")
        return bytes(fits_bytes(exposure.mode.crop(pixels), cards))

    def _cards(self, exposure: _Exposure) -> dict[str, Card]:
        """Header cards of INDI's CCD driver; RA and DEC are J2000 from the mount's own belief."""
        traits, site = self._traits, self._site
        belief = self._mount.instant(exposure.t_start_utc_ns)
        ra, dec = jnow_to_icrs(belief.ra_date_deg, belief.dec_date_deg, belief.t_utc_ns)
        pixel_um = traits.pixel_um / traits.binning
        cards: dict[str, Card] = {
            "INSTRUME": self._name,
            "TELESCOP": self._mount_name,
            "ROWORDER": "TOP-DOWN",
            "EXPTIME": exposure.exposure_s,
            "DATE-OBS": _date_obs(self._world, belief.t_utc_ns),
            "PIXSIZE1": pixel_um,
            "PIXSIZE2": pixel_um,
            "FRAME": "Light",
            "IMAGETYP": "Light Frame",
            "FOCALLEN": traits.focal_length_mm,
            "APTDIA": traits.focal_length_mm / 2.2,
            "SITELAT": site.latitude_deg,
            "SITELONG": site.longitude_deg,
            "OBJCTRA": format_ra(float(ra)).replace(":", " "),
            "OBJCTDEC": format_dec(float(dec)).replace(":", " "),
            "RA": float(ra),
            "DEC": float(dec),
            "PIERSIDE": belief.pier_side.upper(),
            "EQUINOX": 2000,
        }
        # Joined pixels of a colour sensor have seen all colours.
        if self._world.sensor.bayer and exposure.mode.binning == 1:
            cards["BAYERPAT"] = "RGGB"
        return cards | exposure.mode.cards(traits)

    async def _send(self, vector: Any, state: str, message: str = "") -> None:
        if message:
            await self._say(message)
        await vector.send_setVector(timestamp=indi_timestamp(self._now_utc_ns()), state=state)

    async def _say(self, message: str) -> None:
        await self.device.send_device_message(message, indi_timestamp(self._now_utc_ns()))


def _date_obs(world: World, t_start_utc_ns: int) -> str:
    """DATE-OBS of an exposure that the driver began then: to the microsecond, or cut down."""
    is_whole = world.shutter.round_s >= 1.0 and world.shutter.round_s.is_integer()
    written_utc_ns = header_start_utc_ns(world, t_start_utc_ns)
    return utc_ns_to_iso(written_utc_ns, 0 if is_whole else 6).rstrip("Z")
