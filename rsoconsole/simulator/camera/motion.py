"""Motion of the whole image while the shutter is open: drift, worm, wind, air, a settling mount.

Stars and satellites share the motion. Its mean over the exposure is a shift of the boresight and
is subtracted; the rest spreads every star about the pixel that the plate gives.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera.rendering import frame_rng

if TYPE_CHECKING:
    # Training draws moving images in an environment without pydantic.
    from rsoconsole.simulator.world.world import World

AIR_TAU_S = 0.05
WIND_TAU_S = 0.3
DRIFT_EXPOSURE_S = 10.0
_MAX_STEPS = 800
_CELL_PX = 0.5
_WIND, _AIR, _WORM = 20, 21, 22


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageMotion:
    """Displacement of the image at equal steps of time from opening to closing; arrays (m,)."""

    dx_px: FloatArray
    dy_px: FloatArray
    turn_rad: FloatArray
    """Rotation about the middle of the frame, from +x towards +y."""

    @property
    def variance_px2(self) -> float:
        """Variance of the displacement over the exposure, mean of both axes."""
        return float(0.5 * (np.var(self.dx_px) + np.var(self.dy_px)))

    def displace_points(
        self, share: FloatArray, x_px: FloatArray, y_px: FloatArray, centre_px: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the pixels x, y (n,) to which the motion displaces points of the still image.

        ``share``: (n,) elapsed fraction of the exposure at each point, 0 to 1. ``centre_px``:
        middle of the frame, about which the image rotates.
        """
        nodes = np.linspace(0.0, 1.0, len(self.dx_px))
        turn = np.interp(share, nodes, self.turn_rad)
        rx, ry = x_px - centre_px[0], y_px - centre_px[1]
        x = centre_px[0] + rx * np.cos(turn) - ry * np.sin(turn)
        y = centre_px[1] + rx * np.sin(turn) + ry * np.cos(turn)
        return x + np.interp(share, nodes, self.dx_px), y + np.interp(share, nodes, self.dy_px)

    def positions_with_dwell(self, disc_sigma_px: float, reach_px: float) -> FloatArray:
        """Return the image's positions during the exposure, with the time spent there, (4, n).

        Rows: dx and dy (px), rotation (rad), fraction of the exposure. Positions that a seeing disc
        of ``disc_sigma_px`` does not resolve are merged. ``reach_px``: distance from the frame's
        middle to its corner, where a rotation moves the image most.
        """
        share = np.full(len(self.dx_px), 1.0)
        share[[0, -1]] = 0.5
        axes = (self.dx_px, self.dy_px, self.turn_rad)
        places = np.stack([np.interp(*_quarters(at)) for at in axes])
        share = np.interp(*_quarters(share))
        share /= share.sum()
        # A trail as short as the disc keeps its finest form; a long one only has to be smooth.
        coarse_px = max(_CELL_PX, 1.2 * disc_sigma_px)
        cell_px = float(np.clip(0.35 * math.sqrt(self.variance_px2), _CELL_PX, coarse_px))
        in_px = places * np.array([1.0, 1.0, reach_px])[:, None]
        _, group = np.unique(np.rint(in_px / cell_px), axis=1, return_inverse=True)
        weight = np.bincount(group.ravel(), share)
        means = [np.bincount(group.ravel(), share * at) / weight for at in places]
        return np.stack([*means, weight])


def image_motion(  # noqa: PLR0917 - drawn the way it is spoken: of what, when, how long
    world: "World",
    seed: int,
    t_start_utc_ns: int,
    exposure_s: float,
    since_night_s: float,
    scale_arcsec_px: float,
    east_px: FloatArray,
    mount_px: FloatArray | None = None,
) -> tuple[ImageMotion, FloatArray] | None:
    """Return the image's motion about its mean in one exposure, and that mean (dx, dy) in px.

    None for a still image. ``since_night_s``: seconds from the night's start to the exposure's.
    ``east_px``: (2,) unit vector towards east in pixels. ``mount_px``: (2, k) displacement of the
    image by creep and jumps of the mount, px, at equal steps of time; None: no such
    displacement.
    """
    stars, seeing = world.stars, world.seeing
    is_moving = stars.drift_px or stars.periodic_arcsec or world.wind.rms_px
    is_moving = is_moving or seeing.image_motion_arcsec or world.optics.rotation_deg_h
    if not is_moving and (mount_px is None or not np.any(mount_px)):
        return None
    steps = int(np.clip(math.ceil(exposure_s / (0.5 * AIR_TAU_S)), 40, _MAX_STEPS)) + 1
    share = np.linspace(0.0, 1.0, steps)
    angle = math.radians(stars.drift_angle_deg)
    trail = stars.drift_px * exposure_s / DRIFT_EXPOSURE_S * (share - 0.5)
    path = np.outer([math.cos(angle), math.sin(angle)], trail)
    if stars.periodic_arcsec:
        phase = frame_rng(seed, _WORM).uniform(0.0, 2.0 * np.pi)
        turns = (since_night_s + share * exposure_s) / stars.periodic_s
        worm = stars.periodic_arcsec / scale_arcsec_px * np.sin(2.0 * np.pi * turns + phase)
        path += np.outer(east_px, worm)
    step_s = exposure_s / (steps - 1)
    for sigma_px, tau_s, stream in (
        (world.wind.rms_px, WIND_TAU_S, _WIND),
        (seeing.image_motion_arcsec / scale_arcsec_px, AIR_TAU_S, _AIR),
    ):
        if sigma_px:
            rng = frame_rng(seed, t_start_utc_ns, stream)
            path += sigma_px * _wander(rng, steps, step_s / tau_s)
    if mount_px is not None:
        nodes = np.linspace(0.0, 1.0, mount_px.shape[1])
        path += np.stack([np.interp(share, nodes, axis) for axis in mount_px])
    turn_rad = math.radians(world.optics.rotation_deg_h) / 3600.0 * exposure_s * (share - 0.5)
    mean = np.trapezoid(path, dx=1.0 / (steps - 1), axis=1)
    path -= mean[:, None]
    return ImageMotion(dx_px=path[0], dy_px=path[1], turn_rad=turn_rad), mean


def _wander(rng: np.random.Generator, steps: int, step_taus: float) -> FloatArray:
    """Stationary random walk of unit sigma, (2, steps), that forgets itself after one tau.

    Source: Ornstein-Uhlenbeck process, exact for any step; Gillespie 1996.
    """
    kept = math.exp(-step_taus)
    fresh = rng.standard_normal((2, steps))
    path = np.empty((2, steps))
    path[:, 0] = fresh[:, 0]
    for step in range(1, steps):
        path[:, step] = kept * path[:, step - 1] + math.sqrt(1.0 - kept**2) * fresh[:, step]
    return path


def _quarters(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of four values a step, places of the given values, and these."""
    nodes = np.arange(len(values), dtype=np.float64)
    fine = np.linspace(0.0, len(values) - 1.0, 4 * (len(values) - 1) + 1)
    return fine, nodes, values
