"""A frame as INDI's camera drivers write it: a plain FITS file in memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.simulator.world.world import FramesWorld, World

_BLOCK = 2880

Card = str | int | float | bool


def fits_bytes(pixels: npt.NDArray[np.uint16], cards: Mapping[str, Card]) -> bytearray:
    """A single-image FITS file of (height, width) uint16, stored as int16 with BZERO 32768.

    Keys of at most eight characters; text without quotes. Source: FITS standard 4.0.
    """
    height_px, width_px = pixels.shape
    lines = [
        _card("SIMPLE", True),
        _card("BITPIX", 16),
        _card("NAXIS", 2),
        _card("NAXIS1", width_px),
        _card("NAXIS2", height_px),
        _card("EXTEND", True),
        _card("BZERO", 32768),
        _card("BSCALE", 1),
        *(_card(key, value) for key, value in cards.items()),
        "END".ljust(80),
    ]
    header = "".join(lines).encode("ascii")
    header += b" " * (-len(header) % _BLOCK)
    size = len(header) + pixels.size * 2
    file = bytearray(size + -size % _BLOCK)
    file[: len(header)] = header
    data = np.frombuffer(file, dtype=">u2", count=pixels.size, offset=len(header))
    # Subtracting 32768 from an unsigned value is turning over its top bit.
    np.bitwise_xor(pixels.ravel(), np.uint16(0x8000), out=data, casting="unsafe")
    return file


def _card(key: str, value: Card) -> str:
    if isinstance(value, bool):
        text = f"{'T' if value else 'F':>20}"
    elif isinstance(value, int):
        text = f"{value:>20d}"
    elif isinstance(value, float):
        text = f"{value:>20.10G}"
    else:
        text = f"'{value:<8}'"
    return f"{key:<8}= {text}"[:80].ljust(80)


_STREAM = 37
Fate = Literal["delivered", "late", "failed", "dropped"]


def draw_frame_delivery(world: FramesWorld, seed: int, t_start_utc_ns: int) -> Fate:
    """Draw how a frame is delivered: delivered, late, failed or dropped, at the world's rates.

    The result depends only on the seed and on ``t_start_utc_ns``, the start of the exposure.
    """
    rates: tuple[tuple[Fate, float], ...] = (
        ("dropped", world.dropped_rate),
        ("failed", world.failed_rate),
        ("late", world.late_rate),
    )
    if not any(rate for _, rate in rates):
        return "delivered"
    lot = frame_rng(seed, t_start_utc_ns, _STREAM).random()
    for fate, rate in rates:
        if lot < rate:
            return fate
        lot -= rate
    return "delivered"


OWN_ROTATION_DEG = 1.7


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTraits:
    """Properties of the camera that its driver reports; sizes are in binned pixels."""

    width_px: int
    height_px: int
    pixel_um: float
    focal_length_mm: float
    binning: int = 1
    start_latency_s: float = 0.3
    """Time from the client's request to the opening of the shutter, which DATE-OBS states."""
    rotation_deg: float = OWN_ROTATION_DEG
    """Position angle of the array's +y axis while the telescope is west of the pier."""
    is_flipped: bool = False


def camera_traits(optics: OpticsConfig, world: World) -> CameraTraits:
    """The camera of this telescope, with the world's binning and camera angle."""
    angle = world.optics.camera_angle_deg
    return CameraTraits(
        width_px=optics.width_px,
        height_px=optics.height_px,
        pixel_um=optics.pixel_um,
        focal_length_mm=optics.focal_length_mm,
        binning=world.sensor.binning,
        rotation_deg=OWN_ROTATION_DEG if angle is None else angle,
    )
