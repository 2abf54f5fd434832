"""The camera, behind a child process that speaks INDI; frames come through shared memory."""

import contextlib
from collections import deque
from dataclasses import fields
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import IndiConfig, OpticsConfig, WaitsConfig
from rsoconsole.instruments.camera.frame_ring import FrameRing
from rsoconsole.instruments.frames.frame_header import camera_mode
from rsoconsole.instruments.indi.indi_process import IndiProcess, device_settings, drain_messages
from rsoconsole.records import Frame

ARRIVED_KEY = "ARRIVED_MONOTONIC_S"
"""Header key, not in FITS, of the instant a frame's last byte came, by ``time.monotonic()``."""
_MAX_MESSAGES = 100
_BYTES_PER_PIXEL = 4
_ROUNDED_PX, _ROUNDED_SHARE = 32.0, 0.02
"""By how much a frame's sides may differ from those ordered: drivers round them."""


class IndiCamera:
    """A camera that is reached through INDI; one exposure at a time."""

    def __init__(
        self,
        config: IndiConfig,
        optics: OpticsConfig,
        log_path: Path,
        waits: WaitsConfig | None = None,
    ) -> None:
        """``start`` connects; this only describes the camera. ``waits`` None: the defaults."""
        waits = waits or WaitsConfig()
        self._order_s = waits.longest_order_s
        # Room for float32, though cameras give uint16: untouched pages cost nothing.
        self._size_px = optics.width_px, optics.height_px
        self._ring = FrameRing.create(optics.width_px * optics.height_px * _BYTES_PER_PIXEL)
        self._has_started = False
        self._said_size_px = (0, 0)
        self._awaited: int | None = None
        self._outcome: dict[str, Any] | None = None
        self._driver_binning: int | None = None
        """Binning of the driver, before this program has set another."""
        self._binning = 1
        """Binning on each axis, in units of the driver's own."""
        self._own_window: list[int] | None = None
        """Window that the driver read before: x, y, width, height in the sensor's pixels."""
        self._share = 1.0
        """Share of each side of ``_own_window`` that is read now."""
        self._window: list[int] = []
        """Window that is read now, in the sensor's pixels."""
        self._messages: deque[str] = deque(maxlen=_MAX_MESSAGES)
        self.process = IndiProcess(
            name="camera",
            module="rsoconsole.instruments.camera.camera_child",
            settings={
                **device_settings("camera", config.camera, config, waits),
                "size_px": self._size_px,
                "pixel_um": optics.pixel_um,
                "ring": self._ring.descriptor,
                "slot_bytes": self._ring.slot_bytes,
            },
            log_path=log_path,
            on_event=self._on_event,
            descriptors=(self._ring.descriptor,),
            start_s=waits.longest_connection_s,
            on_start=self._start_settings,
        )

    def start(self) -> None:
        """Start the camera's process and connect. Raises InstrumentError."""
        self.process.start()

    def _start_settings(self) -> dict[str, Any]:
        is_first, self._has_started = not self._has_started, True
        return {
            "binning": self._binning,
            "is_part": self._share < 1.0,
            "is_first": is_first,
        }

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        """Open the shutter; returns once the camera has accepted the order.

        Raises InstrumentError.
        """
        self._outcome, self._awaited = None, frame_id
        self.process.request(
            "expose",
            self._order_s,
            exposure_s=exposure_s,
            frame_id=frame_id,
            slot=self._ring.free_slot(),
        )

    def set_binning(self, binning: int) -> int:
        """Multiply the binning of the driver's own setting by ``binning``, on each axis.

        1: the driver's own setting. Returns the binning now in force.
        """
        answer = self.process.request(
            "bin",
            self._order_s,
            binning=binning,
            own=self._driver_binning or 0,
            width_px=self._size_px[0],
        )
        self._driver_binning, self._binning = int(answer["own"]), binning
        return self._binning

    def set_subframe(self, share: float) -> float:
        """Read only the fraction ``share`` of each side of the driver's own window.

        About its middle; 1: the whole of that window. Returns the fraction set, which the driver
        may have rounded.
        """
        if share < 1.0:
            # Also where the answer does not come: what may be in force is given back at the end.
            self._share = share
        answer = self.process.request(
            "subframe",
            self._order_s,
            share=share,
            own=self._own_window or [],
            size_px=self._size_px,
        )
        self._own_window, self._share = list(answer["own"]), float(answer["share"])
        self._window = list(answer["window"])
        return self._share

    def wait_frame(self, timeout_s: float) -> Frame:
        """Return the frame of the exposure under way, within ``timeout_s`` of wall time.

        Its pixels are read-only: they lie in shared memory, which stays reserved as long as the
        frame is in use. Raises InstrumentError when no frame comes; the camera's process is then
        started again.
        """
        if self._awaited is None:
            raise InstrumentError("no exposure is under way: start one first")
        try:
            has_come = self.process.wait(
                lambda: self._outcome is not None, timeout_s, starts_again=False
            )
        finally:
            self._awaited = None
        if not has_come:
            self.process.restart()
            raise InstrumentError(
                f"camera gave no frame in {timeout_s:.0f} s: check its USB power, on a slow "
                "machine raise exposure.frame_timeout_s; its connection has been made again"
            )
        outcome = self._outcome
        assert outcome is not None
        if outcome["event"] == "failed":
            raise InstrumentError(f"the camera gave no usable frame: {outcome['reason']}")
        self._compare_size(*outcome["shape"])
        pixels = self._ring.lend_slot(outcome["slot"], outcome["dtype"], tuple(outcome["shape"]))
        facts = {each.name: outcome[each.name] for each in fields(Frame) if each.name in outcome}
        # JSON knows no tuples.
        facts["header"] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in facts["header"].items()
        }
        self._add_subframe_origin(facts["header"], pixels.shape)
        facts["header"][ARRIVED_KEY] = outcome["arrived_monotonic_s"]
        facts["camera"] = camera_mode(facts["header"])
        return Frame(pixels=pixels, **facts)

    def _compare_size(self, height_px: int, width_px: int) -> None:
        """Say, once for each size, where a frame is not as large as configured and ordered."""
        wanted = [side * self._share / self._binning for side in self._size_px]
        off_px = max(abs(width_px - wanted[0]), abs(height_px - wanted[1]))
        is_other = off_px > max(_ROUNDED_PX, _ROUNDED_SHARE * max(wanted))
        if is_other and self._said_size_px != (width_px, height_px):
            self._said_size_px = width_px, height_px
            self._messages.append(
                f"a frame has {width_px} x {height_px} pixels, not {wanted[0]:.0f} x"
                f" {wanted[1]:.0f}: correct optics.width_px and optics.height_px, or the camera's"
                " binning and subframe"
            )

    def _add_subframe_origin(self, header: dict[str, Any], shape: tuple[int, ...]) -> None:
        """Add the corner of a subframe to its header, in joined pixels: libindi does not give it.

        Not of a frame that is no such part: a driver that was started again reads all.
        """
        joined, window, own = header.get("XBINNING"), self._window, self._own_window
        if self._share == 1.0 or "XORGSUBF" in header or not isinstance(joined, int) or joined < 1:
            return
        if own is None or not window:
            return
        if all(
            abs(side - px * joined) < joined
            for side, px in zip(window[2:], shape[::-1], strict=True)
        ):
            header["XORGSUBF"], header["YORGSUBF"] = (
                (window[n] - own[n]) // joined for n in (0, 1)
            )

    def abort(self) -> None:
        """Abort the exposure under way; it yields no frame."""
        self._awaited = None
        self.process.request("abort", self._order_s)

    def take_messages(self) -> tuple[str, ...]:
        """Return the driver's messages since the last call; at most the latest 100.

        Messages sent before a frame are included once ``wait_frame`` has returned it. May be called
        from any thread.
        """
        return drain_messages(self._messages)

    def restart(self) -> None:
        """End the process, start a new one and connect."""
        self._awaited = None
        self.process.restart()

    def close(self) -> None:
        """Restore the driver's binning and window, end the process, release the shared memory."""
        if self.process.pid is not None:
            # Joined pixels first: drivers round what they read to what those fill.
            with contextlib.suppress(InstrumentError):
                if self._binning != 1:
                    self.set_binning(1)
            with contextlib.suppress(InstrumentError):
                if self._share < 1.0:
                    self.set_subframe(1.0)
        self.process.close()
        self._ring.close()

    def _on_event(self, message: dict[str, Any]) -> None:
        if message.get("event") == "message":
            self._messages.append(str(message["text"]))
        elif message.get("frame_id") == self._awaited and message.get("event") in (
            "frame",
            "failed",
        ):
            self._outcome = message
