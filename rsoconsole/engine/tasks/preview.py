"""Two small pictures of each frame: the whole frame, and a close-up at full resolution."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rsoconsole.pipeline import Reduction
from rsoconsole.records import Frame, PixelArray, Solution, Wcs
from rsoconsole.sky import sky_to_pixel
from rsoconsole.tracking import Following

LONG_SIDE_PX = 466
STEPS = 0xF8
"""Mask of the grey levels kept of 256: steps of a third of the noise's sigma."""
CLOSEUP_PX = (256, 192)
"""Columns and rows of a close-up: it shows a geostationary streak of 10 s and sky around it."""


def preview_of(pixels: PixelArray) -> npt.NDArray[np.uint8]:
    """Return the frame as a small picture of at most 466 px; (h, w) uint8.

    Averaged over areas, and stretched by asinh around the median.
    """
    import cv2

    height, width = pixels.shape
    shrink = max(1.0, max(height, width) / LONG_SIDE_PX)
    size = (max(1, round(width / shrink)), max(1, round(height / shrink)))
    return _stretched(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


class CloseupPlaces:
    """Chooses the pixel position of a frame's close-up.

    It is on the lead track's streak, else where the lead track was predicted, else on the likeliest
    streak. A frame that was not solved uses the last known plate.
    """

    def __init__(self) -> None:
        self._last: tuple[Wcs, float, float] | None = None
        """Last plate, and the mount's reported pointing then, ICRS degrees."""

    def of(
        self, frame: Frame, reduction: Reduction, following: Following
    ) -> tuple[float, float] | None:
        """Return the position (x, y; px) of a frame's close-up; None: there is nothing to show."""
        wcs = self._plate_of(frame, reduction)
        found, taken, track = reduction.detections, following.lead_measured, following.track
        if taken is not None and taken.frame_id == found.frame_id:
            return taken.x_px, taken.y_px
        if track is not None and wcs is not None:
            x_px, y_px = (float(v) for v in sky_to_pixel(wcs, track.x[0], track.x[2]))
            if 0.0 <= x_px < found.width_px and 0.0 <= y_px < found.height_px:
                return x_px, y_px
        candidates = [*found.detections, *(each.detection for each in found.rejected)]
        best = max(candidates, key=lambda d: d.confidence, default=None)
        return None if best is None else (best.x_px, best.y_px)

    def _plate_of(self, frame: Frame, reduction: Reduction) -> Wcs | None:
        """Return the frame's own plate, else the last one moved by the mount's reported motion."""
        ra, dec = frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg
        if isinstance(reduction.solution, Solution):
            wcs = reduction.solution.wcs
            self._last = None if ra is None or dec is None else (wcs, ra, dec)
            return wcs
        if self._last is None or ra is None or dec is None:
            return None
        wcs, ra_then, dec_then = self._last
        return replace(
            wcs,
            crval_ra_deg=(wcs.crval_ra_deg + ra - ra_then) % 360.0,
            crval_dec_deg=wcs.crval_dec_deg + dec - dec_then,
        )


def cut_closeup(
    pixels: PixelArray, x_px: float, y_px: float
) -> tuple[tuple[int, int], npt.NDArray[np.uint8]]:
    """Return a piece of the frame around a position, at full resolution.

    Returned are (first column, first row) and the pixels, (h, w) uint8. At the frame's edge the
    piece is moved inwards; of a frame smaller than the piece it is all.
    """
    height, width = pixels.shape
    columns, rows = min(CLOSEUP_PX[0], width), min(CLOSEUP_PX[1], height)
    x0 = int(min(max(round(x_px - columns / 2.0), 0), width - columns))
    y0 = int(min(max(round(y_px - rows / 2.0), 0), height - rows))
    return (x0, y0), _stretched(pixels[y0 : y0 + rows, x0 : x0 + columns])


def _stretched(pixels: PixelArray) -> npt.NDArray[np.uint8]:
    """Stretch by asinh about the median, from 2 sigma below it to 55 above."""
    small = pixels.astype(np.float32)
    sample = small[::4, ::4]
    median = float(np.median(sample))
    noise = 1.4826 * float(np.median(np.abs(sample - median))) or 1.0
    stretched = np.arcsinh((small - median) / (2.0 * noise))
    low, high = -1.0, 4.0
    codes = np.clip((stretched - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
    return np.asarray(codes & np.uint8(STEPS))
