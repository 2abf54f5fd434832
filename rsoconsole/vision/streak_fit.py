"""A streak measured on the raw frame: its line, its two ends, and how well they are known.

The midpoint of the two ends is the satellite's place at mid-exposure whatever its brightness did
meanwhile. A proposal's box says where to look; the fit says what is there, or why it is no streak.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.background import Background
from rsoconsole.vision.stars import FWHM_PER_SIGMA, StarList
from rsoconsole.vision.streak_beside import Axes
from rsoconsole.vision.streak_blink import flash_period_px
from rsoconsole.vision.streak_model import Line
from rsoconsole.vision.streak_robust import Measured, fit_robustly, uneven_share
from rsoconsole.vision.streak_search import Box, Cutout, Guess, cut_out, find_line
from rsoconsole.vision.streak_stretch import Ends, find_ends

MIN_SNR = 7.0
_MARGIN_PX = 16.0
_LOOKS = 4
_LONGEST_PX = 1000.0
_CLIPPED_SIGMA_PX = 100.0
_NARROWEST, _WIDEST = (0.6, 0.78, 2.0), (2.2, 1.5, 10.0)
"""Width relative to the stars': the gate at its widest, the gate of a bright streak, and how much
that is opened over the signal to noise."""
_SHORTEST, _SHORTEST_GUESS = 5.0, 3.5
"""Length relative to the stars' width, of the fit and of the first guess."""
_MAX_SIGMA_SHARE = 0.2
_MIN_LIT_SHARE = 0.6
_MAX_UNEVEN_SHARE, _MAX_UNEVEN_GUESS, _SUSPICIOUS_UNEVEN = 0.35, 0.45, 0.2
_FAINTEST_GUESS = 0.65
_MAX_FLICKER = 0.6
_FLOOR_PX = 0.005
"""What remains of a pixel's own shape in a perfect frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakFit:
    """A measured streak; pixels of the raw frame, 0-based."""

    x_px: float
    """Midpoint between the ends; of the visible part where clipped."""
    y_px: float
    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    length_px: float
    width_px: float
    """Full width at half maximum across."""
    snr: float
    """Of the whole streak, matched."""
    sigma_along_px: float
    """Of the midpoint; large where clipped, as nothing is known along the streak then."""
    sigma_across_px: float
    is_clipped: bool
    flicker: float = 0.0
    """Share by which the light changes from one width of the seeing to the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoStreak:
    """Why a proposal is not a streak; what was measured of it, if anything."""

    reason: str
    fit: StreakFit | None = None


def fit_streak(
    pixels: PixelArray,
    sky: Background,
    box: Box,
    *,
    stars: StarList | None = None,
    psf_fwhm_px: float | None = None,
    ends: Box | None = None,
) -> StreakFit | NoStreak:
    """Measure the streak in ``box`` (x0, y0, x1, y1), or say why there is none.

    ``ends`` (x_a, y_a, x_b, y_b) is a first guess at the ends. ``stars`` are masked. The width
    of the stars is taken from ``stars`` unless ``psf_fwhm_px`` is given. The covariance is that
    of least squares with the source's own noise measured from the residuals.
    """
    fwhm = psf_fwhm_px or (stars.median_fwhm_px if stars is not None else 2.5)
    psf_sigma = fwhm / FWHM_PER_SIGMA
    looked = _look(pixels, sky, box, ends=ends, stars=stars, psf_sigma=psf_sigma)
    if isinstance(looked, NoStreak):
        return looked
    cutout, guess, stretch = looked
    hopeless = _hopeless(stretch, fwhm)
    if hopeless is not None:
        return NoStreak(reason=hopeless)
    is_clipped_a = _leaves_frame(cutout, guess, stretch.u_a, 1.5 * fwhm)
    is_clipped_b = _leaves_frame(cutout, guess, stretch.u_b, 1.5 * fwhm)
    start = Line(
        u_a=None if is_clipped_a else stretch.u_a,
        u_b=None if is_clipped_b else stretch.u_b,
        offset=0.0,
        slope=0.0,
        sigma=psf_sigma,
        amplitudes=stretch.amplitudes,
        knot_range=(stretch.u_a, stretch.u_b),
    )
    axes = _axes(cutout, guess)
    uneven = uneven_share(cutout, axes, start)
    not_one = _not_one_light(cutout, axes, start, uneven)
    if not_one is not None:
        return NoStreak(reason=not_one)
    fitted = fit_robustly(cutout, axes, start, stretch, psf_sigma)
    if fitted is None:
        if uneven > _MAX_UNEVEN_SHARE:
            return NoStreak(reason=_in_a_row(uneven))
        return NoStreak(reason="no line fits the light in the box")
    fit = _describe(cutout, guess, fitted, stretch)
    reason = _fault(
        fit, stretch, fitted.fit.line, fwhm, uneven_share(cutout, axes, fitted.fit.line)
    )
    return fit if reason is None else NoStreak(reason=reason, fit=fit)


def _look(
    pixels: PixelArray,
    sky: Background,
    box: Box,
    *,
    ends: Box | None,
    stars: StarList | None,
    psf_sigma: float,
) -> tuple[Cutout, Guess, Ends] | NoStreak:
    """Line and rough ends, further out each time the light runs into the cutout's rim."""
    margin = _MARGIN_PX + 6.0 * psf_sigma
    cutout = cut_out(pixels, sky, box, margin, stars)
    for _ in range(_LOOKS):
        guess = find_line(cutout, box, psf_sigma, ends)
        if guess is None:
            return NoStreak(reason="the box lies outside the frame")
        stretch = find_ends(cutout, guess, psf_sigma)
        if stretch is None:
            return NoStreak(reason="no ends found: nothing stands out of the sky along a line")
        looked = cutout, guess, stretch
        if not stretch.reaches_rim:
            break
        wider = cut_out(pixels, sky, _grown(box, stretch, guess), margin, stars)
        if wider.values.shape == cutout.values.shape:
            break
        if stretch.u_b - stretch.u_a > _LONGEST_PX:
            length_px = stretch.u_b - stretch.u_a
            return NoStreak(reason=f"no ends found: the light runs on for {length_px:.0f} px")
        cutout = wider
        box = _grown(box, stretch, guess)
        ends = _guess_ends(guess, stretch)
    else:
        return NoStreak(reason="no ends found: the light runs on and on")
    return looked


def _hopeless(stretch: Ends, psf_fwhm: float) -> str | None:
    """Why a first guess is not worth a fit, in words."""
    length_px, snr = stretch.u_b - stretch.u_a, stretch.matched_snr
    if snr < _FAINTEST_GUESS * MIN_SNR:
        return _too_faint(snr)
    if length_px < _SHORTEST_GUESS * psf_fwhm:
        return _too_faint(snr) if snr < MIN_SNR else _too_short(length_px)
    return None


def _not_one_light(cutout: Cutout, axes: Axes, start: Line, uneven: float) -> str | None:
    """What else than one streak lies along a guessed line, in words."""
    if uneven > _SUSPICIOUS_UNEVEN:
        period_px = flash_period_px(cutout, axes, start)
        if period_px is not None:
            return f"it flashes every {period_px:.0f} px: an aircraft"
    return _in_a_row(uneven) if uneven > _MAX_UNEVEN_GUESS else None


def _guess_ends(guess: Guess, stretch: Ends) -> Box:
    return (
        guess.x_px + guess.dx * stretch.u_a,
        guess.y_px + guess.dy * stretch.u_a,
        guess.x_px + guess.dx * stretch.u_b,
        guess.y_px + guess.dy * stretch.u_b,
    )


def _grown(box: Box, stretch: Ends, guess: Guess) -> Box:
    """The box and the stretch, with a quarter of the stretch's length beyond each end."""
    more = 0.25 * (stretch.u_b - stretch.u_a)
    x = [guess.x_px + guess.dx * u for u in (stretch.u_a - more, stretch.u_b + more)]
    y = [guess.y_px + guess.dy * u for u in (stretch.u_a - more, stretch.u_b + more)]
    return min(box[0], *x), min(box[1], *y), max(box[2], *x), max(box[3], *y)


def _axes(cutout: Cutout, guess: Guess) -> Axes:
    """u along and v across for every pixel of the cutout, (h, w) each."""
    height, width = cutout.values.shape
    x = np.arange(width) + (cutout.x0 - guess.x_px)
    y = (np.arange(height) + (cutout.y0 - guess.y_px))[:, None]
    return x * guess.dx + y * guess.dy, y * guess.dx - x * guess.dy


def _leaves_frame(cutout: Cutout, guess: Guess, u: float, reach_px: float) -> bool:
    x, y = guess.x_px + guess.dx * u, guess.y_px + guess.dy * u
    far_x, far_y = cutout.frame_width - 0.5 - reach_px, cutout.frame_height - 0.5 - reach_px
    return not (reach_px - 0.5 < x < far_x and reach_px - 0.5 < y < far_y)


def _describe(cutout: Cutout, guess: Guess, measured: Measured, stretch: Ends) -> StreakFit:
    """The fit in raw pixels; a clipped end stands where the line leaves the frame."""
    line, (end_a, end_b) = measured.fit.line, measured.ends
    is_clipped = end_a is None or end_b is None
    u_a = _rim(cutout, guess, line, stretch.u_a) if end_a is None else end_a.u
    u_b = _rim(cutout, guess, line, stretch.u_b) if end_b is None else end_b.u
    middle = 0.5 * (u_a + u_b)
    to_across = np.array([1.0, middle])
    across = max(float(to_across @ measured.fit.covariance @ to_across), 0.0)
    length = float(np.hypot(u_b - u_a, line.slope * (u_b - u_a)))
    xs, ys = _to_raw(guess, line, np.array([u_a, middle, u_b]))
    along = max(_CLIPPED_SIGMA_PX, length)
    if end_a is not None and end_b is not None:
        along = 0.5 * float(np.hypot(end_a.sigma_px, end_b.sigma_px))
    return StreakFit(
        x_px=float(xs[1]),
        y_px=float(ys[1]),
        x_a_px=float(xs[0]),
        y_a_px=float(ys[0]),
        x_b_px=float(xs[2]),
        y_b_px=float(ys[2]),
        length_px=length,
        width_px=FWHM_PER_SIGMA * line.sigma,
        snr=float(np.sqrt(np.sum(measured.fit.light**2)) / max(cutout.noise, 1e-9)),
        sigma_along_px=float(np.hypot(along, _FLOOR_PX)),
        sigma_across_px=float(np.hypot(across**0.5, _FLOOR_PX)),
        is_clipped=is_clipped,
        flicker=measured.fit.noise.flicker(line.sigma),
    )


def _to_raw(guess: Guess, line: Line, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    v = line.offset + line.slope * u
    return guess.x_px + u * guess.dx - v * guess.dy, guess.y_px + u * guess.dy + v * guess.dx


def _rim(cutout: Cutout, guess: Guess, line: Line, u: float) -> float:
    """u, near the given one, at which the line leaves the frame."""
    candidates = []
    dx, dy = guess.dx - line.slope * guess.dy, guess.dy + line.slope * guess.dx
    x0, y0 = guess.x_px - line.offset * guess.dy, guess.y_px + line.offset * guess.dx
    for start, rate, size in ((x0, dx, cutout.frame_width), (y0, dy, cutout.frame_height)):
        if abs(rate) > 1e-9:
            candidates += [(edge - start) / rate for edge in (-0.5, size - 0.5)]
    return min(candidates, key=lambda at: abs(at - u))


def _too_faint(snr: float) -> str:
    return f"too faint: signal to noise {snr:.1f}, {MIN_SNR:.0f} needed"


def _in_a_row(uneven: float) -> str:
    return f"uneven over {100 * uneven:.0f} % of its length: stars in a row"


def _too_short(length_px: float) -> str:
    return f"too short: {length_px:.1f} px, hardly longer than a star is wide"


def _fault(fit: StreakFit, stretch: Ends, line: Line, psf_fwhm: float, uneven: float) -> str | None:
    """The first gate that the fit does not pass, in words; None where it passes all."""
    ratio = fit.width_px / psf_fwhm
    narrowest = max(_NARROWEST[0], _NARROWEST[1] - _NARROWEST[2] / max(fit.snr, 1.0))
    widest = min(_WIDEST[0], _WIDEST[1] + _WIDEST[2] / max(fit.snr, 1.0))
    reason = None
    if max(line.amplitudes) <= 0:
        reason = "darker than the sky"
    elif fit.snr < MIN_SNR:
        reason = _too_faint(fit.snr)
    elif ratio < narrowest:
        reason = f"narrower than a star ({fit.width_px:.1f} of {psf_fwhm:.1f} px): a cosmic ray"
    elif ratio > widest:
        reason = (
            f"wider than a star ({fit.width_px:.1f} of {psf_fwhm:.1f} px): an aircraft or glare"
        )
    elif fit.length_px < _SHORTEST * psf_fwhm:
        reason = _too_short(fit.length_px)
    elif uneven > _MAX_UNEVEN_SHARE:
        reason = _in_a_row(uneven)
    elif fit.flicker > _MAX_FLICKER:
        percent = 100.0 * fit.flicker
        reason = f"its light changes by {percent:.0f} % within a star's width: stars in a row"
    elif not fit.is_clipped and fit.sigma_along_px > _MAX_SIGMA_SHARE * fit.length_px:
        reason = "no ends found: they fade into the sky or lie behind stars"
    elif stretch.lit_share < _MIN_LIT_SHARE:
        reason = f"only {100 * stretch.lit_share:.0f} % of its length is lit: not one streak"
    return reason
