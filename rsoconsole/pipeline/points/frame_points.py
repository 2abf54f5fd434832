"""Points of one frame for comparison with others: in pixels, or by plates where there are some."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import epoch, icrs_to_jnow, jnow_to_icrs, pixel_to_sky, sky_to_pixel
from rsoconsole.vision import PointList
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FramePoints:
    """Points of one frame, and where what keeps pace with the motion was in the first frame."""

    points: PointList
    t_mid_utc_ns: int
    """Mid-exposure, UTC ns."""
    size_px: tuple[int, int]
    """Columns and rows of the frame."""
    x_px: FloatArray
    """(n,) places to compare, px of the first frame."""
    y_px: FloatArray
    shift_px: tuple[float, float] = (0.0, 0.0)
    """Place of the frame's middle in the first frame less its own: how the pointing changed."""

    @classmethod
    def by_pixels(
        cls, points: PointList, t_mid_utc_ns: int, size_px: tuple[int, int]
    ) -> "FramePoints":
        """Return points to compare where they are on the sensor, for an unchanged pointing."""
        return cls(
            points=points,
            t_mid_utc_ns=t_mid_utc_ns,
            size_px=size_px,
            x_px=points.x_px,
            y_px=points.y_px,
        )


def compare_by_plates(
    frames: Sequence[FramePoints],
    plates: Sequence[Wcs],
    rates_deg_s: tuple[float, float] = (epoch.SIDEREAL_DEG_S, 0.0),
) -> list[FramePoints]:
    """Return the frames with their points' places in the first frame found by plates, one each.

    ``rates_deg_s``: motion that is followed, in right ascension and declination of date, deg/s;
    that of a telescope at rest unless given.
    """
    first_ns = frames[0].t_mid_utc_ns
    moved: list[FramePoints] = []
    for frame, wcs in zip(frames, plates, strict=True):
        middle = 0.5 * (frame.size_px[0] - 1), 0.5 * (frame.size_px[1] - 1)
        icrs = pixel_to_sky(
            wcs,
            np.append(frame.points.x_px, middle[0]),
            np.append(frame.points.y_px, middle[1]),
        )
        since_s = (frame.t_mid_utc_ns - first_ns) / NS_PER_S
        ra, dec = icrs_to_jnow(*icrs, frame.t_mid_utc_ns)
        then = jnow_to_icrs(ra - rates_deg_s[0] * since_s, dec - rates_deg_s[1] * since_s, first_ns)
        x, y = sky_to_pixel(plates[0], *then)
        shift = float(x[-1]) - middle[0], float(y[-1]) - middle[1]
        moved.append(replace(frame, x_px=x[:-1], y_px=y[:-1], shift_px=shift))
    return moved
