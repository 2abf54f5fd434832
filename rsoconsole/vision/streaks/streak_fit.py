"""Measurement of a streak on the raw frame: its line, its two ends, and their errors.

The midpoint of the two ends is the satellite's place at mid-exposure however its brightness varied,
as long as both ends are seen. A proposal's box gives the place to search; the fit gives the streak
there, or the reason why there is none.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray, NotAStreak, PixelArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Box, Ends, box_about
from rsoconsole.vision.lines.streak_search import (
    Cutout,
    LineGuess,
    LitPart,
    cut_out,
    find_ends,
    find_line,
)
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.streaks._streak_model import LineFit, StreakModel
from rsoconsole.vision.streaks._streak_robust import (
    Axes,
    fit_robustly,
    uneven_share,
    without_star_beyond_end,
)
from rsoconsole.vision.streaks.broken_line import continues_beyond_end, is_broken_line
from rsoconsole.vision.streaks.streak_evenness import lumpiness_and_bend

MIN_SNR = 7.0
MARGIN_PX = 16.0
_LOOKS = 4
_LARGEST_CUTOUT_PX = 1_000_000
_SECOND_ORDER = 0.4
_HOPELESS = 1e3
_CLIPPED_SIGMA_PX = 100.0
_NARROWEST, _WIDEST = 0.6, 2.2
"""Limits of the width relative to the stars'."""
_SHORTEST = 5.0
"""Least length relative to the stars' width."""
_MAX_SIGMA_SHARE = 0.1
_MIN_LIT_SHARE = 0.6
_MAX_UNEVEN_SHARE = 0.35
_UNSURE_PX = 0.5
"""Sigma along, px, from which a second fit from the first one's ends is worth its time."""
AS_CHAINS_FWHM = 25.0
"""Length in star widths up to which a line may be a cosmic ray or a chain of stars."""
MAX_UNEVEN = 1.5
"""Unevenness above which a short line is patchy."""
_FAINT_SNR = 40.0
"""Signal to noise above which dark gaps may be a satellite's own: it tumbles."""
_FLOOR_PX = 0.005
"""Error that a pixel's own shape leaves in a perfect frame, px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakFit:
    """Measured streak, in pixels of the raw frame, 0-based."""

    x_px: float
    """Column of the midpoint between the ends; of the visible part where the streak is clipped."""
    y_px: float
    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    length_px: float
    width_px: float
    """Full width at half maximum across, px."""
    snr: float
    """Matched signal to noise of the whole streak."""
    sigma_along_px: float
    """One sigma of the midpoint along, px; large where clipped."""
    sigma_across_px: float
    is_clipped: bool
    is_crossing: bool = False
    """True where neither end is in the frame."""
    sigma_angle_deg: float | None = None
    bend: float = 0.0
    lumpiness: float = 0.0
    """How much its path (``bend``) and its light vary beyond noise; 0 for longer streaks."""

    @property
    def unevenness(self) -> float:
        """Larger of bend and lumpiness."""
        return max(self.bend, self.lumpiness)


@dataclass(frozen=True, slots=True, kw_only=True)
class NoStreak:
    """Rejection of a proposal as no streak: the reason, and the measurement if there is one."""

    reason: NotAStreak
    fit: StreakFit | None = None


def fit_streak(
    pixels: PixelArray,
    sky: Background,
    box: Box,
    *,
    stars: StarList | None = None,
    psf_fwhm_px: float | None = None,
    ends: Ends | None = None,
) -> StreakFit | NoStreak:
    """Measure the streak in ``box`` (x0, y0, x1, y1), or return the reason why there is none.

    - stars: are masked; they also give the width of a star there
    - psf_fwhm_px: width of a star, instead of that from ``stars`` (2.5 px without either)
    - ends: first guess at the ends (x_a, y_a, x_b, y_b)

    The covariance is that of least squares, with the source's own noise measured from the
    residuals.
    """
    middle = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    fwhm = psf_fwhm_px or (stars.fwhm_at(*middle) if stars is not None else 2.5)
    psf_sigma = fwhm / FWHM_PER_SIGMA

    def measured(about: Box, guess: Ends | None) -> StreakFit | NoStreak:
        return _fit_once(pixels, sky, about, stars=stars, fwhm=fwhm, ends=guess)

    fit = measured(box, ends)
    if isinstance(fit, NoStreak):
        return fit
    if fit.sigma_along_px > _UNSURE_PX and not fit.is_clipped:
        # A star near an end is told from it by a guess that is nearly right.
        nearer = measured(box, _ends_of(fit))
        if isinstance(nearer, StreakFit) and nearer.sigma_along_px < fit.sigma_along_px:
            fit = nearer
    goes_on = _goes_on(pixels, sky, fit, psf_sigma)
    if any(goes_on):
        further = _extended(fit, goes_on)
        again = measured(box_about(further, box), further)
        # Light parted from this by a gap is another's.
        if isinstance(again, StreakFit) and not is_broken_line(
            pixels, sky, _ends_of(again), psf_sigma
        ):
            if any(_goes_on(pixels, sky, again, psf_sigma)):
                return NoStreak(reason=NotAStreak(kind="longer trail"), fit=again)
            fit = again
    return _seen_again(pixels, sky, fit, stars, fwhm)


def _seen_again(
    pixels: PixelArray, sky: Background, fit: StreakFit, stars: StarList | None, fwhm: float
) -> StreakFit | NoStreak:
    """Check the fit against the light along it, which may be no streak's."""
    ends, psf_sigma = _ends_of(fit), fwhm / FWHM_PER_SIGMA
    reason = None
    if fit.length_px < AS_CHAINS_FWHM * fwhm:
        cutout = cut_out(pixels, sky, box_about(ends), MARGIN_PX, stars)
        lumpiness, bend = lumpiness_and_bend(cutout, ends, psf_sigma, fit.snr)
        fit = replace(fit, bend=bend, lumpiness=lumpiness)
    if fit.unevenness > MAX_UNEVEN:
        reason = NotAStreak(kind="patchy")
    elif fit.snr < _FAINT_SNR and is_broken_line(pixels, sky, ends, psf_sigma):
        reason = NotAStreak(kind="dark in between")
    return fit if reason is None else NoStreak(reason=reason, fit=fit)


def _goes_on(
    pixels: PixelArray, sky: Background, fit: StreakFit, psf_sigma: float
) -> tuple[bool, bool]:
    """True at each end where there is light beyond it like that between both."""
    x_a, y_a, x_b, y_b = _ends_of(fit)
    return (
        continues_beyond_end(pixels, sky, (x_b, y_b, x_a, y_a), psf_sigma),
        continues_beyond_end(pixels, sky, (x_a, y_a, x_b, y_b), psf_sigma),
    )


def _ends_of(fit: StreakFit) -> Ends:
    return fit.x_a_px, fit.y_a_px, fit.x_b_px, fit.y_b_px


def _extended(fit: StreakFit, goes_on: tuple[bool, bool]) -> Ends:
    """Extend the line's ends by half its length where the light goes on."""
    dx, dy = 0.5 * (fit.x_b_px - fit.x_a_px), 0.5 * (fit.y_b_px - fit.y_a_px)
    more_a, more_b = (float(each) for each in goes_on)
    return (
        fit.x_a_px - more_a * dx,
        fit.y_a_px - more_a * dy,
        fit.x_b_px + more_b * dx,
        fit.y_b_px + more_b * dy,
    )


def _fit_once(
    pixels: PixelArray,
    sky: Background,
    box: Box,
    *,
    stars: StarList | None,
    fwhm: float,
    ends: Ends | None,
) -> StreakFit | NoStreak:
    psf_sigma = fwhm / FWHM_PER_SIGMA
    looked = _look(pixels, sky, box, ends=ends, stars=stars, psf_sigma=psf_sigma)
    if isinstance(looked, NoStreak):
        return looked
    cutout, guess, stretch = looked
    is_clipped_a = _leaves_frame(cutout, guess, stretch.u_a, 1.5 * fwhm)
    is_clipped_b = _leaves_frame(cutout, guess, stretch.u_b, 1.5 * fwhm)
    start = StreakModel(
        u_a=None if is_clipped_a else stretch.u_a,
        u_b=None if is_clipped_b else stretch.u_b,
        offset=0.0,
        slope=0.0,
        sigma=psf_sigma,
        amplitudes=stretch.amplitudes,
        knot_range=(stretch.u_a, stretch.u_b),
    )
    axes = _axes(cutout, guess)
    fitted = fit_robustly(cutout, axes, start, stretch, psf_sigma)
    if fitted is None:
        return NoStreak(reason=NotAStreak(kind="no line"))
    fitted = without_star_beyond_end(cutout, axes, start, stretch, fitted)
    fit = _describe(cutout, guess, fitted, stretch)
    reason = _fault(fit, stretch, fitted, fwhm, uneven_share(cutout, axes, fitted))
    return fit if reason is None else NoStreak(reason=reason, fit=fit)


def _look(
    pixels: PixelArray,
    sky: Background,
    box: Box,
    *,
    ends: Ends | None,
    stars: StarList | None,
    psf_sigma: float,
) -> tuple[Cutout, LineGuess, LitPart] | NoStreak:
    """Find line and rough ends, further out each time the light runs into the cutout's rim."""
    margin = MARGIN_PX + 6.0 * psf_sigma
    cutout = cut_out(pixels, sky, box, margin, stars)
    looked: tuple[Cutout, LineGuess, LitPart] | None = None
    for _ in range(_LOOKS):
        guess = find_line(cutout, box, psf_sigma, ends)
        if guess is None:
            return NoStreak(reason=NotAStreak(kind="outside the frame"))
        stretch = find_ends(cutout, guess, psf_sigma)
        if stretch is None:
            return NoStreak(reason=NotAStreak(kind="nothing stands out"))
        looked = cutout, guess, stretch
        if not stretch.reaches_rim:
            break
        wider = cut_out(pixels, sky, _grown(box, stretch, guess), margin, stars)
        if wider.values.shape == cutout.values.shape:
            break
        if wider.values.size > _LARGEST_CUTOUT_PX:
            return NoStreak(reason=NotAStreak(kind="runs on far"))
        cutout = wider
        box = _grown(box, stretch, guess)
        ends = _guess_ends(guess, stretch)
    return looked or NoStreak(reason=NotAStreak(kind="runs on"))


def _guess_ends(guess: LineGuess, stretch: LitPart) -> Ends:
    return (
        guess.x_px + guess.dx * stretch.u_a,
        guess.y_px + guess.dy * stretch.u_a,
        guess.x_px + guess.dx * stretch.u_b,
        guess.y_px + guess.dy * stretch.u_b,
    )


def _grown(box: Box, stretch: LitPart, guess: LineGuess) -> Box:
    """Box about the box and the stretch, with a quarter of the stretch beyond each end."""
    more = 0.25 * (stretch.u_b - stretch.u_a)
    further = replace(stretch, u_a=stretch.u_a - more, u_b=stretch.u_b + more)
    return box_about(_guess_ends(guess, further), box)


def _axes(cutout: Cutout, guess: LineGuess) -> Axes:
    """Coordinates u along and v across for every pixel of the cutout, (h, w) each."""
    height, width = cutout.values.shape
    x = np.arange(width) + (cutout.x0 - guess.x_px)
    y = (np.arange(height) + (cutout.y0 - guess.y_px))[:, None]
    return x * guess.dx + y * guess.dy, y * guess.dx - x * guess.dy


def _leaves_frame(cutout: Cutout, guess: LineGuess, u: float, reach_px: float) -> bool:
    x, y = guess.x_px + guess.dx * u, guess.y_px + guess.dy * u
    far_x, far_y = cutout.frame_width - 0.5 - reach_px, cutout.frame_height - 0.5 - reach_px
    return not (reach_px - 0.5 < x < far_x and reach_px - 0.5 < y < far_y)


def _describe(cutout: Cutout, guess: LineGuess, fit: LineFit, stretch: LitPart) -> StreakFit:
    """Return the fit in raw pixels; a clipped end stands where the line leaves the frame."""
    line = fit.line
    is_clipped = line.u_a is None or line.u_b is None
    u_a = _rim(cutout, guess, line, stretch.u_a) if line.u_a is None else line.u_a
    u_b = _rim(cutout, guess, line, stretch.u_b) if line.u_b is None else line.u_b
    middle = 0.5 * (u_a + u_b)
    to_across = np.array([0.5 * line.slope, 0.5 * line.slope, 1.0, middle])
    to_along = np.array([0.5, 0.5, 0.0, 0.0])
    along = max(float(to_along @ fit.covariance @ to_along), 0.0) * _beyond_parabola(fit)
    along += 0.25 * sum(fit.hidden_variance)
    across = max(float(to_across @ fit.covariance @ to_across), 0.0)
    length = float(np.hypot(u_b - u_a, line.slope * (u_b - u_a)))
    xs, ys = _to_raw(guess, line, np.array([u_a, middle, u_b]))
    return StreakFit(
        x_px=float(xs[1]),
        y_px=float(ys[1]),
        x_a_px=float(xs[0]),
        y_a_px=float(ys[0]),
        x_b_px=float(xs[2]),
        y_b_px=float(ys[2]),
        length_px=length,
        width_px=FWHM_PER_SIGMA * line.sigma,
        snr=float(np.sqrt(np.sum(fit.model**2)) / max(cutout.noise, 1e-9)),
        sigma_along_px=(
            max(_CLIPPED_SIGMA_PX, length) if is_clipped else float(np.hypot(along**0.5, _FLOOR_PX))
        ),
        sigma_across_px=float(np.hypot(across**0.5, _FLOOR_PX)),
        is_clipped=is_clipped,
        is_crossing=line.u_a is None and line.u_b is None,
        sigma_angle_deg=math.degrees(max(float(fit.covariance[3, 3]), 0.0) ** 0.5),
    )


def _beyond_parabola(fit: LineFit) -> float:
    """Factor on the variance along: an end known worse than its blur has no parabolic chi2.

    The coefficient was measured on synthetic streaks with a peak of 1 to 3 sigma.
    """
    worst = max(fit.covariance[0, 0], fit.covariance[1, 1]) / fit.line.sigma**2
    return float(1.0 + _SECOND_ORDER * min(worst, _HOPELESS)) ** 2


def _to_raw(guess: LineGuess, line: StreakModel, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    v = line.offset + line.slope * u
    return guess.x_px + u * guess.dx - v * guess.dy, guess.y_px + u * guess.dy + v * guess.dx


def _rim(cutout: Cutout, guess: LineGuess, line: StreakModel, u: float) -> float:
    """u, near the given one, at which the line leaves the frame."""
    candidates = []
    dx, dy = guess.dx - line.slope * guess.dy, guess.dy + line.slope * guess.dx
    x0, y0 = guess.x_px - line.offset * guess.dy, guess.y_px + line.offset * guess.dx
    for start, rate, size in ((x0, dx, cutout.frame_width), (y0, dy, cutout.frame_height)):
        if abs(rate) > 1e-9:
            candidates += [(edge - start) / rate for edge in (-0.5, size - 0.5)]
    return min(candidates, key=lambda at: abs(at - u))


def _fault(
    fit: StreakFit, stretch: LitPart, line_fit: LineFit, psf_fwhm: float, uneven: float
) -> NotAStreak | None:
    """The first gate that the fit does not pass; None where it passes all."""
    ratio = fit.width_px / psf_fwhm
    reason = None
    if min(line_fit.line.amplitudes) <= 0 and max(line_fit.line.amplitudes) <= 0:
        reason = NotAStreak(kind="darker than the sky")
    elif fit.snr < MIN_SNR:
        reason = NotAStreak(kind="too faint", value=fit.snr, limit=MIN_SNR)
    elif ratio < _NARROWEST:
        reason = NotAStreak(kind="too narrow", value=fit.width_px, limit=psf_fwhm)
    elif ratio > _WIDEST:
        reason = NotAStreak(kind="too wide", value=fit.width_px, limit=psf_fwhm)
    elif fit.length_px < _SHORTEST * psf_fwhm:
        reason = NotAStreak(kind="too short", value=fit.length_px)
    elif not fit.is_clipped and fit.sigma_along_px > _MAX_SIGMA_SHARE * fit.length_px:
        reason = NotAStreak(kind="no ends")
    elif stretch.lit_share < _MIN_LIT_SHARE:
        reason = NotAStreak(kind="unlit", value=stretch.lit_share)
    elif uneven > _MAX_UNEVEN_SHARE:
        reason = NotAStreak(kind="uneven", value=uneven)
    return reason
