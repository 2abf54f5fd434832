"""One exposure's plate and field, with the image motion and the blur that a world names."""

import math
from dataclasses import replace

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.simulator.camera import (
    FWHM_PER_SIGMA,
    FieldContent,
    ImageMotion,
    SensorModel,
    distorted,
    east_px,
    image_motion,
    image_shift_px,
    shifted,
)
from rsoconsole.simulator.scene.world_scene import ring_variance_px2
from rsoconsole.simulator.world import World
from rsoconsole.sky import tan_wcs


def plate_of(
    world: World,
    sensor: SensorModel,
    boresight_icrs_deg: tuple[float, float],
    rotation_deg: float,
    is_flipped: bool,
) -> Wcs:
    """Where the pixels look while the image stands where it should."""
    wcs = tan_wcs(
        *boresight_icrs_deg,
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=rotation_deg,
        is_flipped=is_flipped,
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    return distorted(wcs, world.optics.distortion)


def plate_in_motion(  # noqa: PLR0917 - drawn the way it is spoken: of what, when, how long
    world: World,
    plate: Wcs,
    scale_arcsec_px: float,
    key: tuple[int, int],
    exposure_s: float,
    since_night_s: float,
    mount_path_arcsec: FloatArray | None,
) -> tuple[Wcs, ImageMotion | None]:
    """The plate where the image stood in the mean, and how it moved about that.

    ``key``: the night's seed and the exposure's start.
    """
    mount_px = None if mount_path_arcsec is None else image_shift_px(plate, *mount_path_arcsec)
    east = east_px(plate)
    found = image_motion(world, *key, exposure_s, since_night_s, scale_arcsec_px, east, mount_px)
    if found is None:
        return plate, None
    motion, mean_px = found
    return shifted(plate, mean_px), motion


def blurred(
    content: FieldContent, world: World, sensor: SensorModel, motion: ImageMotion | None
) -> FieldContent:
    """The field out of focus and in motion, as far as the world says so."""
    ring_px = world.focus.ring_px
    if motion is None and ring_px == 0.0:
        return content
    moving_px2 = 0.0 if motion is None else motion.variance_px2
    sigma_px = content.fwhm_px / FWHM_PER_SIGMA
    reach_px = 0.5 * math.hypot(sensor.width_px, sensor.height_px)
    return replace(
        content,
        defocus_px=ring_px,
        stands=None if motion is None else motion.stands(sigma_px, reach_px),
        blur_variance_px2=moving_px2 + ring_variance_px2(ring_px),
    )
