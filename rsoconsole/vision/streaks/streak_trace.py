"""Measurement of a line of light of any length, however its brightness varies.

The pixels about a proposed line are turned so that it runs along the rows; summed across with the
frame's own point-spread function as weight they make a profile along it. It gives:

- course of the line: from the middles of its parts
- ends: from the edges of the lit stretch
- line or stars in a row: from the darkest parts, and from the variation of the light that no slow
  change and no single period explains
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_or_points import (
    line_over_points_chi2,
    line_texture,
    surroundings_scatter_ratio,
    trail_along_line_px,
)
from rsoconsole.vision.lines.line_strip import (
    INTERPOLATED_VARIANCE,
    MIN_KNOWN,
    OFF_PX,
    LineProfile,
    LineStrip,
    StripLine,
    cut_out_strip,
    gaussian_weights,
    profile_of,
    subtract_sky_beside,
)
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_list import StarList, StarTrail
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_PARTS = 16
_LIT = 0.4
_CLIP = 5.0
"""Largest signal to noise of a part that counts when the line is searched: a star is no line."""
_TIMES_TYPICAL, _MAX_SLOPE = 1.5, 0.45
_ENOUGH_COLUMNS = 24
_TIMES_LEVEL, _OUT_SIGMA, _MAX_OUT = 3.0, 5.0, 0.4
_EDGE_SNR, _HIDDEN_PX = 6.0, 3.0
_BRIGHT_SIGMA, _NEARER, _MAX_LOOKS = 6.0, 1e-3, 3
_NOT_NOISE = 2.5
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class LineTrace:
    """Line of light measured along itself, in pixels of the frame, 0-based."""

    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    is_open: tuple[bool, bool]
    """True for end a, end b: the line leaves the frame there."""
    width_px: float
    """Full width at half maximum across, px."""
    snr: float
    """Signal to noise of all the line's light, matched across; masked stars left out."""
    sigma_end_px: tuple[float, float]
    sigma_across_px: float
    """One sigma of the line's position across, at its middle, px."""
    sigma_angle_deg: float
    lower_quartile_snr: float
    """Signal to noise of the whole line if all its parts were as bright as their lower quartile."""
    roughness: float
    """Scatter of the parts over their mean that no slow change and no single period explains."""
    confusion: float
    """Scatter of the sky beside the line over the noise of its pixels: above 1 by faint stars."""
    beyond: float
    """Median light beyond an end over the mean light of the line, at the brighter end."""
    over_points: float
    """Chi-square that one line explains better than a few stars in a row; for a short one."""


def trace_line(
    pixels: PixelArray,
    sky: Background,
    ends: Ends,
    stars: StarList,
    psf_fwhm_px: float,
    *,
    off_px: float = OFF_PX,
) -> LineTrace | None:
    """Measure the light of a line proposed between ``ends`` (x_a, y_a, x_b, y_b).

    ``pixels`` (height, width), ADU. ``off_px``: largest distance of the true line from the proposed
    one, at its middle and at its ends. None where no line stands out there.
    """
    sigma = math.sqrt((psf_fwhm_px / FWHM_PER_SIGMA) ** 2 + INTERPOLATED_VARIANCE)
    strip = cut_out_strip(pixels, sky, ends, stars, sigma)
    found, goes_on = _looked(strip, ends, sigma, off_px, stars.trail)
    for _ in range(_MAX_LOOKS):
        if found is None or not goes_on:
            break
        ends = found.x_a_px, found.y_a_px, found.x_b_px, found.y_b_px
        strip = cut_out_strip(pixels, sky, ends, stars, sigma)
        further, goes_on = _looked(strip, ends, sigma, off_px, stars.trail)
        if further is None or further.snr < found.snr:
            break
        found = further
    return found


def _looked(
    strip: LineStrip | None, ends: Ends, sigma: float, off_px: float, trail: StarTrail | None
) -> tuple[LineTrace | None, bool]:
    """Trace of one look at a strip, and True where the light goes on at the strip's end."""
    if strip is None:
        return None, False
    length = length_of(ends)
    columns = np.arange(strip.values.shape[1])
    # Where the frame cuts the strip its middle is not the line's.
    first = (ends[0] - strip.x0_px) * strip.dx + (ends[1] - strip.y0_px) * strip.dy
    inside = (columns >= first) & (columns <= first + length)
    if np.count_nonzero(inside) < 4:
        return None, False
    _mask_bright(strip, inside, sigma, off_px)
    course = _course(strip, columns, inside, sigma, off_px)
    subtract_sky_beside(strip, course, sigma)
    lit = 0.0, 0.0
    for _ in range(2):
        profile = profile_of(strip, course, sigma)
        stretch = _lit_stretch(profile, course.middle, 0.5 * length)
        if stretch is None:
            return None, False
        lit = stretch
        _mask_what_stands_out(strip, profile, lit)
        inside = (columns >= lit[0]) & (columns <= lit[1])
        length = max(lit[1] - lit[0], 1.0)
        course = _better(strip, columns, inside, course, sigma)
    rim = FWHM_PER_SIGMA * sigma
    goes_on = (lit[0] < rim and not strip.is_cut[0]) or (
        lit[1] > columns[-1] - rim and not strip.is_cut[1]
    )
    profile = profile_of(strip, course, sigma)
    return _described(strip, inside, course, profile, trail), goes_on


def _mask_bright(strip: LineStrip, inside: BoolArray, sigma: float, off_px: float) -> None:
    """Mask pixels far brighter than most of the line, and a star's width about them.

    Stars that touch another light are on no list. Where they are much of the line they are its
    flashes and stay.
    """
    import cv2

    ridge = cv2.blur(strip.values, (3, 1))
    near = slice(max(round(strip.reach - off_px), 0), round(strip.reach + off_px) + 1)
    known = np.where(strip.is_good[near], ridge[near], -np.inf)[:, inside].max(axis=0)
    known = known[np.isfinite(known)]
    if known.size < _ENOUGH_COLUMNS // 2:
        return
    typical = median_of(known)
    is_bright = (ridge > max(_TIMES_LEVEL * typical, typical + _BRIGHT_SIGMA)) & strip.is_good
    side = 2 * round(FWHM_PER_SIGMA * sigma) + 1
    about = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    is_bright = cv2.dilate(is_bright.astype(np.uint8), about) > 0
    if np.count_nonzero(is_bright[near].any(axis=0) & inside) < _MAX_OUT * inside.sum():
        strip.is_good[is_bright] = False


def _mask_what_stands_out(strip: LineStrip, profile: LineProfile, lit: tuple[float, float]) -> None:
    """Mask points on the line far brighter than most of it: stars that are on no list."""
    inside = profile.is_known_between(*lit)
    if np.count_nonzero(inside) < _ENOUGH_COLUMNS:
        return
    typical = max(median_of(profile.light[inside]), 0.0)
    window = max(round(FWHM_PER_SIGMA * profile.sigma), 1)
    kernel = np.full(window, 1.0 / window)
    calm = np.convolve(profile.light, kernel, mode="same")
    noise = median_of(profile.error[inside]) / math.sqrt(window)
    bright = calm > max(_TIMES_LEVEL * typical, typical + _OUT_SIGMA * noise)
    bright = np.convolve(bright, np.ones(2 * window + 1), mode="same") > 0.5
    if np.count_nonzero(bright & inside) < _MAX_OUT * np.count_nonzero(inside):
        strip.is_good[:, bright] = False


def _course(
    strip: LineStrip, columns: IndexArray, inside: BoolArray, sigma: float, off_px: float
) -> StripLine:
    """Find the line on which the limited light of a proposal's parts adds up to most."""
    import cv2

    middle = float(columns[inside].mean())
    good = strip.is_good.astype(np.float32)
    weight = cv2.getGaussianKernel(2 * math.ceil(3.0 * sigma) + 1, sigma).astype(np.float32)
    parts = np.array_split(columns[inside], min(_PARTS, max(int(inside.sum()) // 6, 1)))
    lights, places = [], []
    for part in parts:
        chosen = good[:, part[0] : part[-1] + 1]
        known = np.maximum(chosen.sum(axis=1), 1.0)
        row = (strip.values[:, part[0] : part[-1] + 1] * chosen).sum(axis=1) / np.sqrt(known)
        smooth = cv2.filter2D(row[:, None], -1, weight, borderType=cv2.BORDER_REFLECT_101)[:, 0]
        smooth /= float(np.sqrt((weight**2).sum()))
        lights.append(smooth)
        places.append(float(part.mean()))
    light, place = np.array(lights), np.array(places)
    # Of a bright line all that is near it would be alike: most of its parts tell how bright it is.
    typical = median_of(light.max(axis=1))
    light = np.clip(light, -2.0, max(_CLIP, _TIMES_TYPICAL * typical))
    half = max(0.5 * float(inside.sum()), 1.0)
    offsets = np.arange(-off_px, off_px + 0.25, 0.5)
    slopes = np.arange(-off_px, off_px + 0.25, 0.5) / max(half, off_px / _MAX_SLOPE)
    rows = offsets[:, None, None] + slopes[:, None] * (place - middle) + strip.reach
    rows = np.clip(np.rint(rows), 0, light.shape[1] - 1).astype(np.intp)
    total = light[np.arange(place.size), rows].sum(axis=-1)
    # Of courses alike, the one nearest to what was proposed.
    far = np.abs(offsets)[:, None] / off_px + np.abs(slopes) / max(float(slopes[-1]), _SMALLEST)
    total = total - _NEARER * np.abs(total).max() * far
    best = np.unravel_index(int(np.argmax(total)), total.shape)
    return StripLine(middle, float(offsets[best[0]]), float(slopes[best[1]]), 0.5, 0.5 / half)


def _lit_stretch(profile: LineProfile, middle: float, half: float) -> tuple[float, float] | None:
    """First and last column of the stretch whose light above a share of its level is most."""
    typical: float | None = None
    span = (middle - half, middle + half)
    for _ in range(2):
        inside = profile.is_known_between(*span)
        if np.count_nonzero(inside) < 4:
            return None
        noise = median_of(profile.error[inside])
        limit = 6.0 * noise if typical is None else max(2.5 * typical, _NOT_NOISE * noise)
        typical = float(np.mean(np.minimum(profile.light[inside], limit)))
        if typical <= 0.0:
            return None
        # A star is held down to the line's own light; what noise does must not be, one-sidedly.
        limit = max(2.0 * typical, _NOT_NOISE * noise)
        gain = np.minimum(profile.light, limit) - _LIT * typical
        total = np.concatenate([[0.0], np.cumsum(np.where(profile.is_known, gain, 0.0))])
        end = int(np.argmax(total - np.minimum.accumulate(total)))
        start = int(np.argmin(total[: end + 1]))
        if end - start < 4:
            return None
        span = (float(start), float(end - 1))
    return span


def _better(
    strip: LineStrip, columns: IndexArray, inside: BoolArray, course: StripLine, sigma: float
) -> StripLine:
    """Fit the line through the middles of the lit parts, with its errors."""
    middle = float(columns[inside].mean())
    start = StripLine(
        middle, float(course.at(middle)), course.slope, course.sigma_offset, course.sigma_slope
    )
    v = np.arange(-strip.reach, strip.reach + 1)[:, None]
    chosen = columns[inside]
    parts = np.array_split(np.arange(chosen.size), min(_PARTS, max(chosen.size // 6, 1)))
    centres = [float(chosen[part].mean()) - middle for part in parts]
    for _ in range(3):
        weight = gaussian_weights(strip, chosen, start, sigma)
        nominal = np.einsum("ij,ij->j", weight, weight)
        weight *= strip.is_good[:, chosen]
        # What a mask leaves of a column is a star's wing, not the line.
        weight *= np.einsum("ij,ij->j", weight, weight) > MIN_KNOWN * nominal
        values = strip.values[:, chosen]
        off = (v - start.at(chosen)).astype(np.float32)
        moment = np.einsum("ij,ij,ij->j", weight, off, values).astype(np.float64)
        spread = np.einsum("ij,ij,ij->j", weight, weight, off**2).astype(np.float64)
        light = np.einsum("ij,ij->j", weight, values).astype(np.float64)
        place, off_by, error = [], [], []
        known = np.einsum("ij,ij->j", weight, weight).astype(np.float64)
        typical = max(float(light.sum()) / max(float(known.sum()), _SMALLEST), _SMALLEST)
        for part, centre in zip(parts, centres, strict=True):
            # Matched to the slope of the profile: moment of g'(v) over that of g g'' .
            slope2 = float(spread[part].sum())
            if slope2 <= 0.0:
                continue
            place.append(centre)
            amplitude = max(
                float(light[part].sum()) / max(float(known[part].sum()), _SMALLEST), 0.3 * typical
            )
            off_by.append(float(moment[part].sum()) / slope2 / amplitude * sigma**2)
            error.append(sigma**2 / (amplitude * math.sqrt(slope2)))
        if not place:
            return start
        offsets, errors = np.clip(np.array(off_by), -2.0 * sigma, 2.0 * sigma), np.array(error)
        # A part that a star pulls away says little.
        robust = (
            errors**2 + np.maximum(np.abs(offsets - np.median(offsets)) - 3.0 * errors, 0.0) ** 2
        )
        w, u = 1.0 / robust, np.array(place)
        s0, s1, s2 = float(w.sum()), float(w @ u), float(w @ u**2)
        det = s0 * s2 - s1**2
        if len(place) < 3 or det <= _SMALLEST * s0 * max(s2, 1.0):
            shift, turn = float(w @ offsets) / s0, 0.0
            errors_of = (1.0 / math.sqrt(s0), start.sigma_slope)
        else:
            p0, p1 = float(w @ offsets), float(w @ (offsets * u))
            shift, turn = (s2 * p0 - s1 * p1) / det, (s0 * p1 - s1 * p0) / det
            errors_of = (math.sqrt(s2 / det), math.sqrt(s0 / det))
        start = StripLine(middle, start.offset + shift, start.slope + turn, *errors_of)
        if abs(shift) < 0.02:
            break
    return start


def _described(
    strip: LineStrip,
    inside: BoolArray,
    course: StripLine,
    profile: LineProfile,
    trail: StarTrail | None,
) -> LineTrace | None:
    lit = profile.columns[inside]
    if np.count_nonzero(inside & profile.is_known) < 4:
        return None
    first, last, size = float(lit[0]) - 0.5, float(lit[-1]) + 0.5, profile.columns.size
    rim = 1.5 * FWHM_PER_SIGMA * profile.sigma
    is_open = (strip.is_cut[0] and first < rim, strip.is_cut[1] and last > size - 1 - rim)
    a, sigma_a = (-0.5, 0.0) if is_open[0] else _edge(profile, first, 1, last - first)
    b, sigma_b = (size - 0.5, 0.0) if is_open[1] else _edge(profile, last, -1, last - first)
    known = profile.is_known_between(a, b)
    if b - a < 3.0 or np.count_nonzero(known) < 4:
        return None
    light = profile.light[known]
    if light.sum() <= 0.0:
        return None
    scatter = surroundings_scatter_ratio(strip, known, course, profile.sigma)
    quartile, roughness = line_texture(profile, (a, b), scatter)
    drawn_px = 0.0
    if trail is not None:
        angle_deg = math.degrees(math.atan2(strip.dy, strip.dx) + math.atan(course.slope))
        turn = line_angle_deg(angle_deg % 180.0, trail.angle_deg)
        drawn_px = trail_along_line_px(trail.length_px, turn, trail.fwhm_px)
    x_a, y_a = strip.at(a, float(course.at(a)))
    x_b, y_b = strip.at(b, float(course.at(b)))
    return LineTrace(
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        is_open=is_open,
        width_px=_width(strip, profile.columns[known], course, profile.sigma),
        snr=float(light.sum() / math.sqrt((profile.error[known] ** 2).sum())),
        sigma_end_px=(sigma_a, sigma_b),
        sigma_across_px=course.sigma_offset,
        sigma_angle_deg=math.degrees(course.sigma_slope),
        lower_quartile_snr=quartile,
        roughness=roughness,
        confusion=scatter,
        beyond=_beyond(profile, (a, b), float(light.mean()), is_open),
        over_points=line_over_points_chi2(profile, (a, b), scatter, drawn_px),
    )


def _edge(profile: LineProfile, place: float, sense: int, length: float) -> tuple[float, float]:
    """Place where the light begins (``sense`` 1) or ends (-1) near a given one, and its sigma.

    The step, blurred as stars are, that explains most of the light about it; its height is free.
    """
    from scipy.special import erf

    sigma, inner, edge = profile.sigma, profile.columns * float(sense), place * sense
    near = (inner > edge) & (inner < edge + max(8.0 * sigma, 20.0)) & profile.is_known
    if not near.any():
        return place, 0.25 * length
    noise = median_of(profile.error[near])
    amplitude = max(float(profile.light[near].mean()), 0.2 * noise)
    # As far to either side as shows the step for sure.
    window = (_EDGE_SNR * noise / amplitude) ** 2
    window = min(max(window, 4.0 * sigma + 4.0), max(0.4 * length, 8.0))
    reach = min(window, 0.25 * length + 4.0)
    used = (np.abs(inner - edge) < window + reach) & profile.is_known
    if np.count_nonzero(used) < 5:
        return place, 0.25 * length
    u, light, weight = inner[used], profile.light[used], 1.0 / profile.error[used] ** 2
    trial = edge + np.linspace(-reach, reach, 4 * math.ceil(reach) + 1)
    shape = 0.5 * (1.0 + erf((u - trial[:, None]) / (math.sqrt(2.0) * sigma)))
    norm = np.maximum((shape**2) @ weight, _SMALLEST)
    height = np.maximum((shape @ (weight * light)) / norm, 0.0)
    gain = height**2 * norm
    best = int(np.argmax(gain))
    # Two sigma to either side: of a faint step the likelihood is no parabola.
    close = gain >= gain[best] - 4.0
    spread = 0.25 * float(trial[close].max() - trial[close].min())
    # Where a star hides it, it is anywhere behind it.
    is_near = np.abs(inner - trial[best]) < _HIDDEN_PX + 2.0 * sigma
    hidden = float(np.count_nonzero(is_near & ~profile.is_known)) / math.sqrt(12.0)
    return float(trial[best]) * sense, max(spread, hidden, 0.1)


def _width(strip: LineStrip, columns: IndexArray, course: StripLine, sigma: float) -> float:
    """Full width at half maximum of the light across, of the Gaussian that fits it best."""
    v = np.arange(-strip.reach, strip.reach + 1)[:, None]
    off = v - course.at(columns)
    near = np.abs(off) < min(6.0 * sigma + 2.0, strip.reach)
    good = near & strip.is_good[:, columns]
    bins = np.rint(2.0 * off[good]).astype(np.int64)
    low = int(bins.min()) if bins.size else 0
    count = np.bincount(bins - low).astype(np.float64)
    values = strip.values[:, columns]
    ridge = values[
        np.clip(np.rint(strip.reach + course.at(columns)), 0, 2 * strip.reach).astype(int),
        np.arange(columns.size),
    ]
    # A star beside the line is none of its width.
    most = max(_CLIP, _TIMES_LEVEL * median_of(ridge))
    total = np.bincount(bins - low, np.clip(values, -_CLIP, most)[good].astype(np.float64))
    used = count > 0
    place = 0.5 * (np.arange(count.size) + low)[used]
    value, weight = total[used] / count[used], count[used]
    widths = sigma * np.exp(np.linspace(math.log(0.3), math.log(5.0), 45))
    gains = []
    for each in widths:
        shape = np.exp(-0.5 * (place / each) ** 2)
        # With a level of its own: the sky's error is no light.
        mean = (weight @ shape) / weight.sum()
        flat = shape - mean
        norm = float(weight @ flat**2)
        gains.append(max(float(weight @ (flat * value)), 0.0) ** 2 / max(norm, _SMALLEST))
    best = float(widths[int(np.argmax(gains))])
    return FWHM_PER_SIGMA * math.sqrt(max(best**2 - INTERPOLATED_VARIANCE, 0.05))


def _beyond(
    profile: LineProfile, ends: tuple[float, float], typical: float, is_open: tuple[bool, bool]
) -> float:
    """Median light beyond the ends over the level, on the brighter side; 0: none is seen."""
    most, reach = 0.0, 6.0 + max(0.3 * (ends[1] - ends[0]), 30.0)
    for away, is_out in (
        (ends[0] - profile.columns, is_open[0]),
        (profile.columns - ends[1], is_open[1]),
    ):
        part = (away > 6.0) & (away < reach) & profile.is_known
        if not is_out and np.count_nonzero(part) >= 12:
            most = max(most, median_of(profile.light[part]) / typical)
    return most
