"""One small picture a frame: enough to see a faint streak in a terminal."""

import numpy as np
import numpy.typing as npt

from rsoconsole.records import PixelArray

LONG_SIDE_PX = 582


def preview_of(pixels: PixelArray) -> npt.NDArray[np.uint8]:
    """Area-averaged to at most 582 px and stretched by asinh about the median; (h, w) uint8."""
    import cv2

    height, width = pixels.shape
    shrink = max(1.0, max(height, width) / LONG_SIDE_PX)
    size = (max(1, round(width / shrink)), max(1, round(height / shrink)))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    sample = small[::4, ::4]
    median = float(np.median(sample))
    noise = 1.4826 * float(np.median(np.abs(sample - median))) or 1.0
    stretched = np.arcsinh((small - median) / (2.0 * noise))
    low, high = -1.0, 4.0
    return np.asarray(np.clip((stretched - low) * (255.0 / (high - low)), 0, 255), dtype=np.uint8)
