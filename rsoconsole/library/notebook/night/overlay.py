"""Marks over the preview of a frame: its streaks, and where the lead track was expected.

Coordinates are pixels of the whole frame, so that the preview may have any size.
"""

import math

from rsoconsole.library.notebook.night.svg import AMBER, GREEN, RED, escape_markup
from rsoconsole.night import NightFrame, is_measurement_of, uncertainty_ellipse_px
from rsoconsole.records import Detection, Measurement, NotSolved, Solution
from rsoconsole.sky import sky_to_pixel
from rsoconsole.words import count_words, short_name_of, streak_detail_words

_MARGIN = 0.012
"""Room between a streak and its box, as a share of the frame's width."""
_POINTS = 48


def overlay_svg(frame: NightFrame) -> str:
    """Return an SVG to lay over a frame's preview; empty where the frame's size is not known."""
    taken, followed = frame.taken, frame.lead_measured
    if taken is None or taken.width_px <= 0 or taken.height_px <= 0:
        return ""
    width, height = taken.width_px, taken.height_px
    found = frame.detected_streaks
    parts = [_expected(frame, width)]
    parts += [_streak(each, width, is_followed=is_measurement_of(each, followed)) for each in found]
    parts += [_by_hand(m, width) for m in frame.measurements if m.source == "operator"]
    label = frame_caption(frame)
    return (
        f'<svg viewBox="-0.5 -0.5 {width} {height}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape_markup(label)}" '
        'style="position:absolute;inset:0;width:100%;height:100%">'
        f"{''.join(parts)}</svg>"
    )


def frame_caption(frame: NightFrame) -> str:
    """Describe a frame in one line: exposure, plate solution, streaks, measurement."""
    taken, followed = frame.taken, frame.lead_measured
    if taken is None:
        return "no frame yet"
    parts = [f"frame {frame.frame_id:04d}"]
    if taken.exposure_s is not None:
        parts.append(f"{taken.exposure_s:g} s")
    if isinstance(frame.solution, NotSolved):
        parts.append(f"not solved: {frame.solution.reason}")
    elif isinstance(frame.solution, Solution):
        parts.append(f"{frame.solution.matched} stars, {frame.solution.rms_arcsec:.2f}″")
    if frame.detections is not None:
        count = len(frame.detections.detections)
        parts.append(count_words(count, "streak") if count else "no streak")
    if followed is not None:
        parts.append(f"followed with confidence {followed.confidence:.2f}")
    return " · ".join(parts)


def _streak(detection: Detection, frame_width: int, *, is_followed: bool) -> str:
    """A box about a streak with its confidence; the followed one solid, others dashed."""
    room = _MARGIN * frame_width
    x_0 = min(detection.x_a_px, detection.x_b_px) - room
    y_0 = min(detection.y_a_px, detection.y_b_px) - room
    width = abs(detection.x_a_px - detection.x_b_px) + 2.0 * room
    height = abs(detection.y_a_px - detection.y_b_px) + 2.0 * room
    what = "followed" if is_followed else "detected"
    parts = (what, f"confidence {detection.confidence:.2f}", *streak_detail_words(detection))
    label = f"{detection.confidence:.2f} {short_name_of(detection)}".rstrip()
    colour, dash = (RED, "") if is_followed else (AMBER, ' stroke-dasharray="5 4"')
    size = 0.034 * frame_width
    return (
        f'<rect x="{x_0:.0f}" y="{y_0:.0f}" width="{width:.0f}" height="{height:.0f}" fill="none" '
        f'stroke="{colour}" stroke-width="1.6" vector-effect="non-scaling-stroke"{dash}>'
        f"<title>{escape_markup(', '.join(parts))}</title></rect>"
        f'<text x="{x_0 + width + 0.6 * room:.0f}" y="{y_0 + height:.0f}" fill="{colour}" '
        f'font-size="{size:.0f}" font-family="sans-serif">{escape_markup(label)}</text>'
    )


def _by_hand(measurement: Measurement, frame_width: int) -> str:
    r = 1.5 * _MARGIN * frame_width
    x, y = measurement.x_px, measurement.y_px
    return (
        f'<path d="M{x - r:.0f} {y:.0f}L{x:.0f} {y - r:.0f}L{x + r:.0f} {y:.0f}L{x:.0f} '
        f'{y + r:.0f}Z" fill="none" stroke="{RED}" stroke-width="1.6" '
        'vector-effect="non-scaling-stroke"><title>marked by hand</title></path>'
    )


def _expected(frame: NightFrame, frame_width: int) -> str:
    """A cross where the track was expected, and its 3 sigma."""
    track, solution = frame.predicted, frame.solution
    if track is None or not isinstance(solution, Solution):
        return ""
    x, y = (float(v) for v in sky_to_pixel(solution.wcs, track.x[0], track.x[2]))
    if not (math.isfinite(x) and math.isfinite(y)):
        return ""
    r = _MARGIN * frame_width
    style = f'fill="none" stroke="{GREEN}" stroke-width="1.2" vector-effect="non-scaling-stroke"'
    outline = " ".join(
        f"{a:.0f},{b:.0f}" for a, b in uncertainty_ellipse_px(track, solution, _POINTS)
    )
    return (
        f'<path d="M{x - r:.0f} {y:.0f}H{x + r:.0f}M{x:.0f} {y - r:.0f}V{y + r:.0f}" {style}>'
        "<title>expected here</title></path>"
        f'<polygon points="{outline}" {style} stroke-dasharray="2 2">'
        "<title>expected within 3 σ</title></polygon>"
    )
