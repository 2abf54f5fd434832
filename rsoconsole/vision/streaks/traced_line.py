"""What a traced line of light is like: ends, width, evenness."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_strip import (
    INTERPOLATED_VARIANCE,
    LineProfile,
    LineStrip,
    StripLine,
)
from rsoconsole.vision.lines.line_texture import (
    line_texture,
    surroundings_scatter_ratio,
)
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

CLIP = 5.0
"""Largest signal to noise of a part that counts when the line is searched: a star is no line."""
TIMES_LEVEL = 3.0
"""Brightness, over most of a line's, from which a place on it is another light."""
_EDGE_SNR, _HIDDEN_PX, _MAX_TRIALS = 6.0, 3.0, 160
_SMALLEST = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class LineTrace:
    """Line of light measured along itself, in pixels of the frame, 0-based.

    What describes its light is computed when it is asked for: most lines fail an earlier gate.
    """

    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    is_open: tuple[bool, bool]
    """True for end a, end b: the line leaves the frame there."""
    snr: float
    """Signal to noise of all the line's light, matched across; masked stars left out."""
    sigma_end_px: tuple[float, float]
    strip: LineStrip
    course: StripLine
    profile: LineProfile
    ends: tuple[float, float]
    """Places of both ends in the strip, px from its first column."""

    @property
    def sigma_across_px(self) -> float:
        """One sigma of the line's position across, at its middle, px."""
        return self.course.sigma_offset

    @property
    def sigma_angle_deg(self) -> float:
        """One sigma of the line's direction, deg."""
        return math.degrees(self.course.sigma_slope)

    @cached_property
    def width_px(self) -> float:
        """Full width at half maximum across, px."""
        columns = self.profile.columns[self._known]
        return _width(self.strip, columns, self.course, self.profile.sigma)

    @cached_property
    def confusion(self) -> float:
        """Scatter of the sky beside the line over its pixels' noise: above 1 by faint stars."""
        return surroundings_scatter_ratio(self.strip, self._known, self.course, self.profile.sigma)

    @property
    def lower_quartile_snr(self) -> float:
        """Signal to noise of the whole line if all parts were as bright as their lower quartile."""
        return self._texture[0]

    @property
    def roughness(self) -> float:
        """Scatter of the parts over their mean that no slow change or single period explains."""
        return self._texture[1]

    @cached_property
    def _known(self) -> BoolArray:
        return self.profile.is_known_between(*self.ends)

    @cached_property
    def _texture(self) -> tuple[float, float]:
        return line_texture(self.profile, self.ends, self.confusion)


def describe_line(
    strip: LineStrip,
    inside: slice,
    course: StripLine,
    profile: LineProfile,
) -> LineTrace | None:
    """Return the line whose lit columns are ``inside``; None where too little of it is seen.

    ``course``: of the line in the strip; ``profile``: its light.
    """
    if np.count_nonzero(profile.is_known[inside]) < 4:
        return None
    first, last, size = inside.start - 0.5, inside.stop - 0.5, profile.columns.size
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
    x_a, y_a = strip.at(a, float(course.at(a)))
    x_b, y_b = strip.at(b, float(course.at(b)))
    return LineTrace(
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        is_open=is_open,
        snr=float(light.sum() / math.sqrt((profile.error[known] ** 2).sum())),
        sigma_end_px=(sigma_a, sigma_b),
        strip=strip,
        course=course,
        profile=profile,
        ends=(a, b),
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
    # A step that is looked for far and wide is known no better than that.
    trial = edge + np.linspace(-reach, reach, min(4 * math.ceil(reach), _MAX_TRIALS) + 1)
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
    most = max(CLIP, TIMES_LEVEL * median_of(ridge))
    total = np.bincount(bins - low, np.clip(values, -CLIP, most)[good].astype(np.float64))
    used = count > 0
    place = 0.5 * (np.arange(count.size) + low)[used]
    value, weight = total[used] / count[used], count[used]
    widths = sigma * np.exp(np.linspace(math.log(0.3), math.log(5.0), 45))
    shapes = np.exp(-0.5 * (place / widths[:, None]) ** 2)
    # With a level of its own: the sky's error is no light.
    flat = shapes - (shapes @ weight / weight.sum())[:, None]
    gains = np.maximum(flat @ (weight * value), 0.0) ** 2 / np.maximum(flat**2 @ weight, _SMALLEST)
    best = float(widths[int(np.argmax(gains))])
    return FWHM_PER_SIGMA * math.sqrt(max(best**2 - INTERPOLATED_VARIANCE, 0.05))
