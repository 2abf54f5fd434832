"""The camera's process: receives FITS BLOBs through INDI, writes their pixels to shared memory.

Run as ``python -m rsoconsole.instruments.camera.camera_child``. A plain FITS file of 16 bits a
pixel is written straight from the client's buffer into the slot that the parent named in its order.
Any other file, which takes longer to decode, is copied and decoded on a thread of its own.
"""

import os
import queue
import sys
import threading
import time
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.camera._capture_settings import (
    WATCHED,
    CaptureSettings,
    sensor_caution,
    spoilt_words,
)
from rsoconsole.instruments.camera._sensor_window import BINNING, FRAME, INFO, SensorWindow
from rsoconsole.instruments.camera.frame_ring import FrameRing
from rsoconsole.instruments.frames.frame_files import frame_from_bytes
from rsoconsole.instruments.frames.plain_fits import read_plain
from rsoconsole.instruments.indi.client_choice import open_client
from rsoconsole.instruments.indi.indi_child import ReplyWriter, execute_orders
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector, without_timestamp
from rsoconsole.instruments.process_memory import return_free_pages, return_freed_blocks_at_once
from rsoconsole.records import Frame

_EXPOSURE = "CCD_EXPOSURE"
_IMAGE = "CCD1"
_DEFINED_S = 1.0
"""Longest wait for properties that not every driver has, s: they are defined one by one."""
_UNLIKE = 0.05
"""Share by which a frame's exposure may differ from the ordered one."""
_MIN_UNLIKE_S = 0.1
_FITS = b"SIMPLE"
_NO_FITS = (
    "it came as something else than FITS (the camera's own format, a packed file or a picture of"
    " a video): set the driver's transfer format to FITS, its compression and video off"
)
_NO_LIGHT = ("dark", "bias", "flat")
"""Kinds of frames that show no sky."""
_SENT_FIELDS = tuple(each.name for each in fields(Frame) if each.name not in ("pixels", "camera"))
"""Fields of a frame sent by message: pixels lie in the ring, the header gives ``camera``."""


class CameraChild:
    """Executes the parent's orders on one INDI camera; each method answers one order."""

    def __init__(self, writer: ReplyWriter) -> None:
        self._writer = writer
        self._client: IndiClient | None = None
        self._ring: FrameRing | None = None
        self._frame_id = 0
        self._ordered = 0
        """Number of the last update before the exposure under way was ordered."""
        self._slot: int | None = None
        """Slot for the frame of the exposure under way; None once the frame has come."""
        self._blobs: queue.SimpleQueue[tuple[int, int, bytes, float]] = queue.SimpleQueue()
        self._answer_s = 0.0
        self._exposure_s = 0.0
        self._has_begun = False
        """True once the driver has said that the exposure under way goes on."""
        self._window: SensorWindow | None = None
        self._settings: CaptureSettings | None = None
        self._pixel_um, self._size_px, self._caution = 0.0, [0, 0], ""
        threading.Thread(target=self._unpack_all, daemon=True, name="frames").start()

    def start(self, order: dict[str, Any]) -> dict[str, Any]:
        """Connect to the INDI server and the camera."""
        self._ring = FrameRing(order["ring"], order["slot_bytes"])
        client, library = open_client(
            order["client"], order["device"], self._on_vector, self._on_message
        )
        self._answer_s = float(order["answer_s"])
        client.open(order, (_EXPOSURE, _IMAGE), self._writer)
        client.enable_blobs(_IMAGE)
        self._client = client
        exposure = client.get(_EXPOSURE)
        if exposure is not None and exposure.state == "Busy":
            # Left behind by the process before this one; its frame must not pass for ours.
            self.abort({})
        ends_s = time.monotonic() + _DEFINED_S
        for name in (FRAME, BINNING, "UPLOAD_MODE"):
            client.wait(name, lambda _: True, max(ends_s - time.monotonic(), 0.0))
        settings = CaptureSettings(client, self._answer_s, self._say)
        if own := _driver_binning(client.get(INFO), order["size_px"][0], float(order["pixel_um"])):
            settings.expect_binning(own * int(order["binning"]))
        # What was left before the first start is nobody's change.
        settings.restore(is_quiet=bool(order["is_first"]))
        self._window = SensorWindow(client, self._answer_s)
        if not order["is_part"]:
            self._window.restore_whole(list(order["size_px"]))
        settings.take_present()
        self._settings = settings
        self._pixel_um, self._size_px = float(order["pixel_um"]), list(order["size_px"])
        self._caution = ""
        self._look_at_pixels(client.get(INFO))
        return {"client": library.title}

    def expose(self, order: dict[str, Any]) -> dict[str, Any]:
        """Open the shutter; returns when the camera has accepted the order."""
        client = self._ready()
        settings = self._ready_settings()
        settings.restore()
        self._frame_id, self._slot = int(order["frame_id"]), int(order["slot"])
        self._exposure_s, self._has_begun = float(order["exposure_s"]), False
        settings.begin()
        self._ordered = client.last_update_number()
        before = client.send_numbers(_EXPOSURE, {"CCD_EXPOSURE_VALUE": float(order["exposure_s"])})
        answer = client.wait(_EXPOSURE, lambda v: v.state != "Idle", self._answer_s, before)
        if answer is None:
            raise InstrumentError(
                f"the camera did not start an exposure in {self._answer_s:.0f} s: check its USB"
                " power; a slow device needs a larger waits.answer_s"
            )
        if answer.state == "Alert":
            raise InstrumentError(
                f"the camera refused the exposure: {client.failure_reason_since(before)}"
            )
        # The client has read the last frame as text: there is time now to give that memory back.
        return_free_pages()
        return {}

    def bin(self, order: dict[str, Any]) -> dict[str, Any]:
        """Multiply the binning of the driver's own setting by ``binning``, on each axis.

        The order's ``own`` is that setting, from an earlier answer; 0: not known. It is then
        computed from the configured width, as a killed engine may have left another.
        """
        client = self._ready()
        self._ready_settings().restore()
        vector = client.get(BINNING)
        if vector is None:
            raise InstrumentError("the camera's driver cannot join pixels: set leap.binning to 1")
        now = int(vector.values["HOR_BIN"])
        own = int(order["own"]) or now
        if not order["own"]:
            info = client.get(INFO)
            own = _driver_binning(info, order["width_px"], self._pixel_um) or now
        wanted = own * int(order["binning"])
        if wanted == now:
            return {"own": own}
        window = self._ready_window()
        if now == own:
            window.remember()
        before = client.send_numbers(BINNING, dict.fromkeys(("HOR_BIN", "VER_BIN"), float(wanted)))
        answer = client.wait(BINNING, lambda v: v.state != "Busy", self._answer_s, before)
        is_set = answer is not None and int(answer.values["HOR_BIN"]) == wanted
        if not is_set or answer is None or answer.state == "Alert":
            raise InstrumentError(
                f"the camera did not join {wanted} x {wanted} pixels"
                f" ({client.failure_reason_since(before)}): set leap.binning to 1"
            )
        if wanted == own:
            window.restore()
        self._ready_settings().take_present()
        return {"own": own}

    def subframe(self, order: dict[str, Any]) -> dict[str, Any]:
        """Read only the fraction ``share`` of each side: see ``SensorWindow.set_share``."""
        settings = self._ready_settings()
        settings.restore()
        answer = self._ready_window().set_share(
            float(order["share"]), list(order["own"]), list(order["size_px"])
        )
        settings.take_present()
        return answer

    def abort(self, _order: dict[str, Any]) -> dict[str, Any]:
        """Abort the exposure under way."""
        client = self._ready()
        self._frame_id, self._slot = 0, None
        exposure = client.get(_EXPOSURE)
        before = client.send_switch("CCD_ABORT_EXPOSURE", "ABORT")
        answer = client.wait("CCD_ABORT_EXPOSURE", lambda _: True, self._answer_s, before)
        if exposure is not None and exposure.state == "Busy":
            # Or the end of this exposure would pass for the answer to the next order.
            client.wait(_EXPOSURE, lambda v: v.state != "Busy", self._answer_s, before)
        return {"aborted": answer is not None}

    def _on_vector(self, vector: Vector) -> None:
        if vector.name == _IMAGE and _IMAGE in vector.blobs:
            self._receive(vector.blobs[_IMAGE], vector.arrived_monotonic_s)
        elif vector.name == _EXPOSURE:
            self._note_exposure(vector)
        elif vector.name == INFO:
            self._look_at_pixels(vector)
        elif self._settings is not None and vector.name in WATCHED:
            self._settings.note(vector)

    def _note_exposure(self, vector: Vector) -> None:
        """Note how the exposure goes on; a frame that will not come is told at once."""
        client, settings = self._client, self._settings
        if client is None or settings is None:
            return
        if vector.state == "Alert":
            self._fail(client.driver_message_since(self._ordered) or "no reason given")
        has_ended = self._has_begun and vector.state != "Busy"
        self._has_begun = vector.state == "Busy"
        if has_ended and settings.keeps_frames and self._slot is not None:
            self._slot = None
            self._fail(spoilt_words(settings.change or "LOCAL"))

    def _look_at_pixels(self, info: Vector | None) -> None:
        """Say, once for each answer, where the sensor is not the configured one."""
        caution = sensor_caution(info, self._pixel_um, self._size_px)
        if caution and caution != self._caution:
            self._say(caution)
        self._caution = caution

    def _say(self, text: str) -> None:
        self._writer.send({"event": "message", "text": text})

    def _fail(self, reason: str, frame_id: int | None = None) -> None:
        number = self._frame_id if frame_id is None else frame_id
        self._writer.send({"event": "failed", "frame_id": number, "reason": reason})

    def _on_message(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)
        self._say(without_timestamp(text))

    def _receive(self, content: memoryview, arrived_s: float) -> None:
        frame_id, slot = self._frame_id, self._slot
        self._slot = None
        change = "" if self._settings is None else self._settings.change
        if slot is None:
            print("a frame that nobody waits for is dropped", file=sys.stderr, flush=True)
        elif change:
            self._fail(spoilt_words(change), frame_id)
        elif read_plain(content) is None:
            self._blobs.put((frame_id, slot, bytes(content), arrived_s))
        else:
            self._take(frame_id, slot, content, arrived_s)

    def _unpack_all(self) -> None:
        while True:
            self._take(*self._blobs.get())

    def _take(
        self, frame_id: int, slot: int, content: bytes | memoryview, arrived_s: float
    ) -> None:
        """Decode a frame, write its pixels into their slot and notify the parent."""
        ring = self._ring
        assert ring is not None
        is_plain = isinstance(content, memoryview)

        def room(shape: tuple[int, ...]) -> npt.NDArray[np.uint16] | None:
            return ring.writable_slot(slot, shape, np.uint16) if is_plain else None

        try:
            frame = frame_from_bytes(content, frame_id, f"frame_{frame_id:06d}.fits", room=room)
            pixels = ring.writable_slot(slot, frame.pixels.shape, frame.pixels.dtype)
            if frame_id == self._frame_id and not np.may_share_memory(pixels, frame.pixels):
                pixels[...] = frame.pixels
        except Exception as error:
            is_fits = bytes(content[: len(_FITS)]) == _FITS
            self._fail(str(error) if is_fits else _NO_FITS, frame_id)
            return
        if fault := self._fault(frame):
            self._fail(fault, frame_id)
            return
        self._writer.send(
            {
                "event": "frame",
                "slot": slot,
                "dtype": frame.pixels.dtype.str,
                "shape": frame.pixels.shape,
                "arrived_monotonic_s": arrived_s,
                **{each: getattr(frame, each) for each in _SENT_FIELDS},
            }
        )

    def _fault(self, frame: Frame) -> str:
        """Return why a frame is another than was ordered, by its header; empty where it is not."""
        kind = str(frame.header.get("FRAME") or frame.header.get("IMAGETYP") or "").lower()
        for other in _NO_LIGHT:
            if other in kind:
                return f"the camera took a {other} frame: another program has set that"
        if frame.exposure_s is None:
            return ""
        allowed_s = max(_UNLIKE * self._exposure_s, _MIN_UNLIKE_S)
        if abs(frame.exposure_s - self._exposure_s) > allowed_s:
            return (
                f"the frame was exposed {frame.exposure_s:g} s, not {self._exposure_s:g} s: another"
                " program uses the camera"
            )
        return ""

    def _ready_settings(self) -> CaptureSettings:
        self._ready()
        assert self._settings is not None
        return self._settings

    def _ready_window(self) -> SensorWindow:
        self._ready()
        assert self._window is not None
        return self._window

    def _ready(self) -> IndiClient:
        if self._client is None:
            raise InstrumentError("the camera is not connected: start it first")
        return self._client


def _driver_binning(info: Vector | None, width_px: int, pixel_um: float) -> int:
    """Binning of the driver's own, which gives the configured width and, where more than one pixel
    is joined, the configured size of a pixel; 0 where none does.
    """
    sensor_px = 0.0 if info is None else float(info.values.get("CCD_MAX_X", 0.0))
    if sensor_px <= 0.0 or width_px <= 0:
        return 0
    own = round(sensor_px / width_px)
    single_um = 0.0 if info is None else float(info.values.get("CCD_PIXEL_SIZE_X") or 0.0)
    is_part = own > 1 and single_um > 0.0 and round(pixel_um / single_um) != own
    return own if own >= 1 and abs(sensor_px - own * width_px) < own and not is_part else 0


def main() -> None:
    """Execute the orders that come on stdin, until the parent ends."""
    return_freed_blocks_at_once()
    writer = ReplyWriter()
    child = CameraChild(writer)
    try:
        execute_orders(
            writer,
            slow={
                "start": child.start,
                "expose": child.expose,
                "bin": child.bin,
                "subframe": child.subframe,
            },
            urgent={"abort": child.abort},
        )
    finally:
        # The client's threads do not survive an orderly end of the interpreter.
        os._exit(0)


if __name__ == "__main__":
    main()
