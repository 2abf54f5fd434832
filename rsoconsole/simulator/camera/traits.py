"""Sensor, optics and how the camera hangs on the telescope, as its driver knows them."""

from dataclasses import dataclass

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator.world import World

OWN_ROTATION_DEG = 1.7


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTraits:
    """What the driver tells of the camera; sizes and pitch are those of joined pixels."""

    width_px: int
    height_px: int
    pixel_um: float
    focal_length_mm: float
    binning: int = 1
    start_latency_s: float = 0.3
    """From the order to the opening of the shutter; DATE-OBS is the opening."""
    rotation_deg: float = OWN_ROTATION_DEG
    """Position angle of the array's +y axis with the telescope west of the pier."""
    is_flipped: bool = False


def camera_traits(optics: OpticsConfig, world: World) -> CameraTraits:
    """The camera of a telescope in a world."""
    angle = world.optics.camera_angle_deg
    return CameraTraits(
        width_px=optics.width_px,
        height_px=optics.height_px,
        pixel_um=optics.pixel_um,
        focal_length_mm=optics.focal_length_mm,
        binning=world.sensor.binning,
        rotation_deg=OWN_ROTATION_DEG if angle is None else angle,
    )
