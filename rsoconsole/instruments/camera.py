"""The camera port over a child process; frames come through shared memory."""

from pathlib import Path
from typing import Any

from rsoconsole.config import IndiConfig, OpticsConfig
from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.frame_ring import FrameRing
from rsoconsole.instruments.indi_process import IndiProcess
from rsoconsole.records import Frame

_ORDER_S = 12.0
_BYTES_PER_PIXEL = 4
_FRAME_FIELDS = (
    "frame_id",
    "name",
    "t_start_utc_ns",
    "exposure_s",
    "scale_arcsec_px",
    "pointing_ra_icrs_deg",
    "pointing_dec_icrs_deg",
    "saturation_adu",
    "header",
)


class IndiCamera:
    """A camera behind INDI; one exposure at a time."""

    def __init__(self, config: IndiConfig, optics: OpticsConfig, log_path: Path) -> None:
        """Describe the camera; ``start`` connects."""
        # Room for float32, though cameras give uint16: untouched pages cost nothing.
        self._ring = FrameRing.create(optics.width_px * optics.height_px * _BYTES_PER_PIXEL)
        self._awaited: int | None = None
        self._outcome: dict[str, Any] | None = None
        self.process = IndiProcess(
            name="camera",
            module="rsoconsole.instruments.camera_child",
            settings={
                "host": config.host,
                "port": config.port,
                "device": config.camera,
                "ring": self._ring.descriptor,
                "slot_bytes": self._ring.slot_bytes,
            },
            log_path=log_path,
            on_event=self._on_event,
            descriptors=(self._ring.descriptor,),
        )

    def start(self) -> None:
        """Make the process and connect. Raises InstrumentError."""
        self.process.start()

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        """Open the shutter; returns once the camera has taken the order."""
        self._outcome, self._awaited = None, frame_id
        self.process.request("expose", _ORDER_S, exposure_s=exposure_s, frame_id=frame_id)

    def wait_frame(self, timeout_s: float) -> Frame:
        """The frame of the exposure under way, within ``timeout_s`` of wall time."""
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
                f"camera gave no frame in {timeout_s:.0f} s: check its USB power; "
                "its connection has been started afresh"
            )
        outcome = self._outcome
        assert outcome is not None
        if outcome["event"] == "failed":
            raise InstrumentError(f"the camera gave no usable frame: {outcome['reason']}")
        pixels = self._ring.copy(outcome["slot"], outcome["dtype"], tuple(outcome["shape"]))
        facts = {field: outcome[field] for field in _FRAME_FIELDS}
        # JSON knows no tuples.
        facts["header"] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in facts["header"].items()
        }
        return Frame(pixels=pixels, **facts)

    def abort(self) -> None:
        """Give up the exposure under way; its frame never comes."""
        self._awaited = None
        self.process.request("abort", _ORDER_S)

    def restart(self) -> None:
        """A fresh process and a fresh connection."""
        self._awaited = None
        self.process.restart()

    def close(self) -> None:
        """End the process and release the shared memory."""
        self.process.close()
        self._ring.close()

    def _on_event(self, message: dict[str, Any]) -> None:
        if message.get("frame_id") == self._awaited and message.get("event") in ("frame", "failed"):
            self._outcome = message
