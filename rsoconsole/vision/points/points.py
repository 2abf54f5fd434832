"""Points of light in a frame whose stars are trails: satellites that the telescope keeps pace with.

The frame is filtered by the image of a point as wide as the trails are, the trails are taken out,
and what stands out of the noise that trails of that brightness leave is a point. For a Gaussian
image its place and light are those of least squares.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background, resample
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.points.lone_pixels import is_shape_known, repair_lone_pixels
from rsoconsole.vision.points.trail_image import image_of_section
from rsoconsole.vision.points.trail_light import TrailLight, without_trails
from rsoconsole.vision.stars.star_list import StarList, StarTrail
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.stars.trail_section import measure_trail_section

MIN_SNR, SURE_SNR = 3.7, 5.0
"""SNR of points that other frames may confirm, and of those that one frame makes likely."""
MAX_POINTS = 2000
_LEVELS = np.array([-1e9, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1e9])
"""Limits of trail light, sigma, between which the noise is measured."""
_FEWEST_OF_LEVEL, _EVERY = 200, 3
_MEETING_SHARE = 0.6
"""Light of two trails' ends that meet, by that of the point, from which it may be only that."""
_MIN_PLACE_SIGMA_PX = 0.02
_BRIGHT_SNR, _WING_FWHM, _WING_SHARE = 60.0, 7.0, 0.05
"""SNR, reach by its width and share of a point whose wings give others beside it."""
_STAMP_PX = 3
_NARROW = 0.5
"""Width of the narrow weights that tell sharp lights, by that of a star."""
_MAX_SHARPNESS, _SHARP_SIGMAS = 1.35, 3.0
_DARK_SIGMA = 2.0
"""Largest light of trails, sigma, beside which the shape of a point is seen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointList:
    """Points of one frame, brightest first by SNR; arrays (n,)."""

    x_px: FloatArray
    """Column of the centroid; 0 is the centre of the left pixel."""
    y_px: FloatArray
    snr: FloatArray
    """Matched SNR, with the noise that trails leave at the place."""
    flux_adu: FloatArray
    flux_sigma_adu: FloatArray
    sigma_px: FloatArray
    """One sigma of the place along each axis, px."""
    is_trail_end: BoolArray
    """Whether ends of trails may be all of it: two that meet at the place, or one that comes from
    beyond the frame."""
    is_shape_known: bool
    """Whether points are wide enough in this frame to be told from single bad pixels."""
    fwhm_px: float
    trail: StarTrail
    """Trail of the stars, with the direction measured here."""
    lone_pixels: int
    """Number of single bright pixels that were left out."""

    def __len__(self) -> int:
        """Number of points."""
        return int(self.x_px.size)

    def sure(self) -> IndexArray:
        """Return the numbers of the points that one frame alone makes likely."""
        return np.flatnonzero(self.snr >= SURE_SNR)


def find_points(
    pixels: PixelArray,
    sky: Background,
    stars: StarList,
    *,
    saturation_adu: float = 65535.0,
    min_snr: float = MIN_SNR,
) -> PointList | None:
    """Find points among the trails of ``stars``; None where stars are no trails, or short ones."""
    if stars.trail is None:
        return None
    import cv2

    trail = stars.trail
    image = StarImage.gaussian(stars).without_trail()
    section = measure_trail_section(pixels, sky, stars, saturation_adu)
    if section is not None:
        image = image_of_section(section) or image
        trail = replace(trail, angle_deg=section.direction_deg)
    fwhm = image.fwhm_px
    sigma = fwhm / FWHM_PER_SIGMA
    height, width = pixels.shape
    light = pixels.astype(np.float32)
    light -= resample(sky.level, sky.cell_px, height, width)
    light /= resample(sky.noise, sky.cell_px, height, width)
    lone = repair_lone_pixels(light, image)
    filtered = cv2.GaussianBlur(light, (0, 0), sigma)
    filtered *= np.float32(2.0 * math.sqrt(math.pi) * sigma)
    left = without_trails(
        filtered, fwhm_px=fwhm, length_px=trail.length_px, direction_deg=trail.angle_deg
    )
    if left is None:
        return None
    noise = _noise_by_trails(left)
    row, column, snr = _peaks(left, noise, min_snr)
    x, y = _places(left, row, column, sigma)
    rim = math.ceil(fwhm)
    kept = (np.minimum(x, width - 1 - x) > rim) & (np.minimum(y, height - 1 - y) > rim)
    kept[kept] = ~_is_wing(x[kept], y[kept], snr[kept], fwhm)
    dark = left.trails[row, column] < _DARK_SIGMA
    shape_seen = np.flatnonzero(kept & dark)
    kept[shape_seen] = ~_is_sharp(light, image, x[shape_seen], y[shape_seen])
    chosen = np.flatnonzero(kept)[:MAX_POINTS]
    row, column, x, y, snr = row[chosen], column[chosen], x[chosen], y[chosen], snr[chosen]
    # Sigma of a pixel over the filter's answer to unit light.
    answer = float((image.shares / (image.sigmas_px**2 + sigma**2)).sum()) / (2.0 * math.pi)
    column_px, row_px = (np.rint(each).astype(np.intp) for each in (x, y))
    adu = sky.all_at(sky.noise, column_px, row_px) / (2.0 * math.sqrt(math.pi) * sigma * answer)
    peak = left.points[row, column].astype(np.float64)
    return PointList(
        x_px=x,
        y_px=y,
        snr=snr,
        flux_adu=peak * adu,
        flux_sigma_adu=peak * adu / snr,
        sigma_px=np.hypot(math.sqrt(2.0) * sigma / snr, _MIN_PLACE_SIGMA_PX),
        is_trail_end=left.meeting[row, column] > _MEETING_SHARE * peak,
        is_shape_known=is_shape_known(image),
        fwhm_px=fwhm,
        trail=replace(trail, fwhm_px=fwhm),
        lone_pixels=lone,
    )


def _noise_by_trails(left: TrailLight) -> tuple[FloatArray, FloatArray]:
    """Light of trails, and one sigma of what is left at pixels with that light of trails.

    Shot noise and what the medians leave of bright trails are in it.
    """
    trails = left.trails[::_EVERY, ::_EVERY].ravel()
    points = left.points[::_EVERY, ::_EVERY].ravel()
    inside = points != 0.0
    trails, points = trails[inside], points[inside]
    bin_of = np.digitize(trails, _LEVELS) - 1
    light, noise = [0.0], [1.0]
    for k in range(_LEVELS.size - 1):
        own = points[bin_of == k]
        if own.size >= _FEWEST_OF_LEVEL:
            middle = float(np.median(own))
            light.append(max(float(np.median(trails[bin_of == k])), light[-1] + 1e-3))
            spread = 1.4826 * float(np.median(np.abs(own - middle)))
            noise.append(max(spread, noise[-1]))
    if len(noise) > 1:
        noise[0] = noise[1]
    return np.array(light), np.array(noise)


def _peaks(
    left: TrailLight, noise: tuple[FloatArray, FloatArray], min_snr: float
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Rows, columns and SNR of the peaks of what is left, the surest first."""
    import cv2

    points = left.points
    largest = cv2.dilate(points, np.ones((3, 3), np.uint8))
    places = np.flatnonzero((points >= largest) & (points > min_snr * noise[1][0]))
    row, column = np.divmod(places, points.shape[1])
    snr = points[row, column] / np.interp(left.trails[row, column], *noise)
    inside = (row > 0) & (row < points.shape[0] - 1) & (column > 0)
    inside &= (column < points.shape[1] - 1) & (snr > min_snr)
    row, column, snr = row[inside], column[inside], snr[inside]
    order = np.argsort(-snr, kind="stable")
    return row[order], column[order], snr[order]


def _places(
    left: TrailLight, row: IndexArray, column: IndexArray, sigma_px: float
) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel places in the frame: the top of a Gaussian of the filtered width through a peak."""
    peak = left.points[row, column]

    def log_light(down: int, across: int) -> Float32Array:
        near = left.points[row + down, column + across]
        return np.asarray(np.log(np.maximum(near, np.float32(0.05) * peak)))

    by_column = 0.5 * (log_light(0, 1) - log_light(0, -1))
    by_row = 0.5 * (log_light(1, 0) - log_light(-1, 0))
    slopes = left.frame_slopes(by_column, by_row)
    dx, dy = (np.clip(2.0 * sigma_px**2 * each, -1.0, 1.0) for each in slopes)
    x, y = left.frame_places(column.astype(np.float64), row.astype(np.float64))
    return x + dx, y + dy


def _is_wing(x_px: FloatArray, y_px: FloatArray, snr: FloatArray, fwhm_px: float) -> BoolArray:
    """Whether each point is noise in the wings of one much brighter; the brightest come first."""
    is_wing = np.zeros(x_px.size, bool)
    reach = _WING_FWHM * fwhm_px
    for n in np.flatnonzero(snr > _BRIGHT_SNR):
        if is_wing[n]:
            continue
        away = np.hypot(x_px - x_px[n], y_px - y_px[n])
        share = _WING_SHARE * np.maximum(1.0 - away / reach, 0.1)
        is_wing |= (away > 0.0) & (away < reach) & (snr < share * snr[n])
    return is_wing


def _is_sharp(
    light: Float32Array, image: StarImage, x_px: FloatArray, y_px: FloatArray
) -> BoolArray:
    """Whether each light is surely sharper than a point's image: bad pixels side by side."""
    if not x_px.size:
        return np.zeros(0, bool)
    column, row = np.rint(x_px).astype(np.intp), np.rint(y_px).astype(np.intp)
    side = np.arange(-_STAMP_PX, _STAMP_PX + 1)
    height, width = light.shape
    ys = np.clip(row[:, None, None] + side[:, None], 0, height - 1)
    xs = np.clip(column[:, None, None] + side, 0, width - 1)
    stamps = light[ys, xs]
    r2 = (xs - x_px[:, None, None]) ** 2 + (ys - y_px[:, None, None]) ** 2
    star = image.at(xs - x_px[:, None, None], ys - y_px[:, None, None])
    sigma = image.fwhm_px / FWHM_PER_SIGMA
    wide = np.exp(-0.5 * r2 / sigma**2)
    narrow = np.exp(-0.5 * r2 / (_NARROW * sigma) ** 2)
    usual = (star * narrow).sum((1, 2)) / (star * wide).sum((1, 2))
    weights = narrow / usual[:, None, None]
    in_wide, in_narrow = (stamps * wide).sum((1, 2)), (stamps * weights).sum((1, 2))
    noise = np.sqrt(((weights - _MAX_SHARPNESS * wide) ** 2).sum((1, 2)))
    return np.asarray(in_narrow - _MAX_SHARPNESS * in_wide > _SHARP_SIGMAS * noise)
