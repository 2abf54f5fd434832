"""Points that move through several frames. Pure.

A point found at its place on the sky in one frame only is not a star. Such points are linked into
movers (``tracking.link``): at least three points on a straight line at constant speed, where chance
is an unlikely explanation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbits import StreakLine
from rsoconsole.pipeline.field.point_light import PointLight
from rsoconsole.pipeline.frame.measurement import AIR_ARCSEC_ROOT_S, frame_timing
from rsoconsole.records import Detection, FloatArray, Frame, Solution
from rsoconsole.sky import ARCSEC_RAD, direction_to_unit, pixel_to_sky, unit_to_direction
from rsoconsole.tracking import MotionPrior, TangentPlane, link_points
from rsoconsole.vision import StarList
from rsoconsole.words import NS_PER_S

WINDOW = 8
"""Number of successive frames whose points are linked together."""
FEWEST = 3
"""Fewest points of a mover: any two points lie on a line."""
SURE = 0.9
_POINT_FWHM = 2.5
"""Motion in an exposure, in widths of a star, beyond which an object draws a streak."""
_SAME_SIGMAS = 4.0
"""Sigmas within which two points are at one place."""
_MAX_POINTS = 40
_POINT_PX = 0.2
_ALIKE = 0.03
"""Share of its speed by which a mover may change from one window of frames to the next."""
_MIN_BENT = 5
"""Fewest points with which a path is fitted as a parabola."""
_TURN_SHARE = 0.002
"""Largest bend of a path from a straight line at constant speed, as a share of its length."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FramePoints:
    """Point-like lights of a frame, brightest first; arrays of n."""

    u: FloatArray
    """Directions as unit vectors, (n, 3)."""
    t_utc_ns: np.ndarray
    """Mid-exposure of each point's row of pixels."""
    x_px: FloatArray
    y_px: FloatArray
    snr: FloatArray
    sigma_arcsec: float
    """Sigma of a point's position on each axis."""
    fwhm_arcsec: float
    exposure_s: float
    centre: FloatArray
    """Unit vector (3,) of the frame's centre."""
    area_arcsec2: float
    light: PointLight | None = None
    """Brightness of the points; None where it was not measured."""

    def __len__(self) -> int:
        return len(self.snr)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mover:
    """Object seen as a point that moves through several frames."""

    points: tuple[tuple[int, int], ...]
    """(index of the frame, index of the point in it), in order of time."""
    probability: float
    """Probability that its points are of one object, and not aligned by chance."""
    rate_arcsec_s: float
    position_angle_deg: float
    """Position angle of its motion at the middle of its path, from north through east."""
    t_mid_utc_ns: int
    span_s: float
    line: StreakLine
    """Line from its first point to its last, for the catalogue."""


def frame_points(  # noqa: PLR0917 - what a frame is made of
    stars: StarList,
    solution: Solution,
    t_mid_utc_ns: int,
    frame: Frame,
    detections: Sequence[Detection],
    config: Config,
) -> FramePoints:
    """Return the point sources of a frame, also slightly elongated ones, off its streaks."""
    x, y, snr = stars.x_px, stars.y_px, stars.snr
    if stars.oblong is not None and len(stars.oblong.x_px):
        more = stars.oblong
        apart = np.hypot(more.x_px[:, None] - x, more.y_px[:, None] - y)
        is_new = np.ones(len(more.x_px), bool)
        if apart.size:
            is_new = apart.min(axis=1) > stars.median_fwhm_px
        x, y = np.append(x, more.x_px[is_new]), np.append(y, more.y_px[is_new])
        snr = np.append(snr, more.snr[is_new])
    is_own = np.ones(len(x), bool)
    for each in detections:
        if each.length_px < _POINT_FWHM * stars.median_fwhm_px:
            continue
        is_own &= _from_streak_px(each, x, y) > stars.median_fwhm_px + each.width_px
    x, y, snr = x[is_own], y[is_own], snr[is_own]
    exposure_s = frame.exposure_s or 0.0
    air = AIR_ARCSEC_ROOT_S / math.sqrt(max(exposure_s, 0.01))
    plate = solution.rms_arcsec / math.sqrt(max(solution.matched, 1))
    scale = solution.scale_arcsec_px
    line_time_us = frame_timing(frame, config.exposure).line_time_us
    row_ns = np.rint(y * line_time_us * 1e3).astype(np.int64)
    return FramePoints(
        u=direction_to_unit(*pixel_to_sky(solution.wcs, x, y)),
        t_utc_ns=t_mid_utc_ns + row_ns,
        x_px=x,
        y_px=y,
        snr=snr,
        sigma_arcsec=math.sqrt((_POINT_PX * scale) ** 2 + air**2 + plate**2),
        fwhm_arcsec=stars.median_fwhm_px * scale,
        exposure_s=exposure_s,
        centre=direction_to_unit(solution.ra_icrs_deg, solution.dec_icrs_deg),
        area_arcsec2=frame.width_px * frame.height_px * scale**2,
    )


def find_movers(frames: Sequence[FramePoints]) -> tuple[Mover, ...]:
    """Find movers in frames in order of time; return them with the most probable first.

    A point belongs to one mover at most.
    """
    found: list[Mover] = []
    for window in _windows(len(frames)):
        begun = found
        found = []
        for each in _movers(frames, window):
            before = next((one for one in begun if _goes_on(one, each)), None)
            if before is None:
                found.append(each)
                continue
            begun = [one for one in begun if one is not before]
            sure = max(before.probability, each.probability)
            points = (*before.points, *each.points)
            found.append(_mover(frames, points, sure))
        found = [*begun, *found]
    return tuple(sorted(found, key=lambda each: (-len(each.points), -each.probability)))


def _windows(count: int) -> list[range]:
    """Return the windows of frames; a rest too short for its own window joins the one before."""
    starts = list(range(0, count, WINDOW)) or [0]
    if len(starts) > 1 and count - starts[-1] < FEWEST:
        starts.pop()
    ends = [*starts[1:], count]
    return [range(start, end) for start, end in zip(starts, ends, strict=True)]


def _goes_on(one: Mover, later: Mover) -> bool:
    """True where a mover of an earlier window continues as one of a later window."""
    a, b = one.line, later.line
    pace = (a.b - a.a) / one.span_s
    gap_s = (later.t_mid_utc_ns - one.t_mid_utc_ns) / NS_PER_S
    off = b.middle - a.middle - pace * gap_s
    turned = (b.b - b.a) / later.span_s - pace
    speed = float(np.linalg.norm(pace))
    least = float(np.hypot(a.sigma_length_rad / one.span_s, b.sigma_length_rad / later.span_s))
    return bool(
        np.linalg.norm(off) < _ALIKE * speed * gap_s + 4.0 * least * gap_s
        and np.linalg.norm(turned) < _ALIKE * speed + 4.0 * least
    )


def _movers(frames: Sequence[FramePoints], window: range) -> list[Mover]:
    chosen = [frames[n] for n in window]
    left = [_no_stars(n, chosen) for n in range(len(chosen))]
    if sum(map(len, left)) < FEWEST:
        return []
    middle = chosen[len(chosen) // 2]
    ra_deg, dec_deg = unit_to_direction(middle.centre)
    plane = TangentPlane.at(float(ra_deg), float(dec_deg))
    places = [_on(plane, each.u[kept]) for each, kept in zip(chosen, left, strict=True)]
    t_ns = [int(np.median(each.t_utc_ns)) if len(each) else None for each in chosen]
    usable = [n for n, t in enumerate(t_ns) if t is not None and len(left[n])]
    if len(usable) < FEWEST:
        return []
    since = t_ns[usable[0]] or 0
    t_s = [((t_ns[n] or 0) - since) / NS_PER_S for n in usable]
    known = MotionPrior(
        sigma=max(each.sigma_arcsec for each in chosen),
        area=max(each.area_arcsec2 for each in chosen),
        largest_speed=min(
            _POINT_FWHM * each.fwhm_arcsec / max(each.exposure_s, 1e-3) for each in chosen
        ),
        false_points=max(float(np.median([len(left[n]) for n in usable])), 0.5),
    )
    tracklets = link_points(t_s, [places[n] for n in usable], known)
    made = []
    for each in tracklets:
        points = [(usable[frame], int(left[usable[frame]][n])) for frame, n in each.points]
        span_s = t_s[each.points[-1][0]] - t_s[each.points[0][0]]
        moved = math.hypot(each.x_rate, each.y_rate) * span_s
        if len(points) < FEWEST or each.probability < SURE or moved < 2.0 * _same(chosen):
            continue
        made.append(_mover(frames, [(window.start + n, i) for n, i in points], each.probability))
    return made


def _same(frames: Sequence[FramePoints]) -> float:
    """Return the distance, in arcsec, within which two points are at one place."""
    worst = max(each.sigma_arcsec for each in frames)
    return max(_SAME_SIGMAS * math.sqrt(2.0) * worst, *(each.fwhm_arcsec for each in frames))


def _no_stars(number: int, frames: Sequence[FramePoints]) -> np.ndarray:
    """Return the indices of one frame's points at whose places no other frame has one."""
    from scipy.spatial import KDTree

    own = frames[number]
    is_alone = np.ones(len(own), bool)
    reach = _same(frames) * ARCSEC_RAD
    for other, frame in enumerate(frames):
        if other != number and len(frame) and len(own):
            is_alone &= ~np.isfinite(KDTree(frame.u).query(own.u, distance_upper_bound=reach)[0])
    return np.flatnonzero(is_alone)[:_MAX_POINTS]


def _mover(
    frames: Sequence[FramePoints], points: Sequence[tuple[int, int]], probability: float
) -> Mover:
    t = np.array([frames[frame].t_utc_ns[n] for frame, n in points], np.int64)
    seen = np.array([frames[frame].u[n] for frame, n in points])
    sigma = max(frames[frame].sigma_arcsec for frame, _ in points)
    ra_deg, dec_deg = unit_to_direction(seen[len(points) // 2])
    plane = TangentPlane.at(float(ra_deg), float(dec_deg))
    t_mid = int((t[0] + t[-1]) // 2)
    since_s = (t - t_mid) / NS_PER_S
    span_s = float(since_s[-1] - since_s[0])
    terms = 3 if len(points) >= _MIN_BENT else 2
    rows = np.stack([(since_s / span_s) ** n for n in range(terms)], axis=-1)
    fitted = np.linalg.lstsq(rows, _on(plane, seen), rcond=None)[0]
    at = np.array([since_s[0], 0.0, since_s[-1]]) / span_s
    places = np.stack([at**n for n in range(terms)], axis=-1) @ fitted
    u = [_off(plane, place) for place in places]
    # What a degree from where the plane touches would change: east and north are the point's own.
    east = np.array([-u[1][1], u[1][0], 0.0])
    north = np.cross(u[1], east / np.linalg.norm(east))
    step = (u[2] - u[0]) / span_s / ARCSEC_RAD
    along_east, along_north = float(step @ east / np.linalg.norm(east)), float(step @ north)
    speed = math.hypot(along_east, along_north)
    length = speed * span_s
    bend = _TURN_SHARE * length
    sigma2 = ((sigma**2 + bend**2) / len(points)) * ARCSEC_RAD**2
    slope = math.hypot(sigma, bend) * math.sqrt(12.0 / len(points)) / max(length, 1.0)
    return Mover(
        points=tuple(points),
        probability=probability,
        rate_arcsec_s=speed,
        position_angle_deg=math.degrees(math.atan2(along_east, along_north)) % 360.0,
        t_mid_utc_ns=t_mid,
        span_s=span_s,
        line=StreakLine(
            a=u[0],
            b=u[2],
            middle=u[1],
            is_end_a=True,
            is_end_b=True,
            is_ordered=True,
            after_s=0.0,
            cov_sky_rad2=(sigma2, 0.0, sigma2),
            sigma_direction_rad=slope,
            sigma_length_rad=slope * length * ARCSEC_RAD,
        ),
    )


def _on(plane: TangentPlane, u: FloatArray) -> FloatArray:
    """Return places on a tangent plane, (n, 2) arcsec east and north."""
    u = np.reshape(u, (-1, 3))
    depth = u @ plane.towards
    return np.stack([u @ plane.east, u @ plane.north], axis=-1) / depth[:, None] / ARCSEC_RAD


def _off(plane: TangentPlane, place: FloatArray) -> FloatArray:
    """Return the unit vector of a place on a tangent plane."""
    east, north = place * ARCSEC_RAD
    line = plane.towards + east * plane.east + north * plane.north
    return np.asarray(line / np.linalg.norm(line))


def _from_streak_px(streak: Detection, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the distances of points from a streak, px."""
    a = np.array([streak.x_a_px, streak.y_a_px])
    way = np.array([streak.x_b_px, streak.y_b_px]) - a
    off = np.stack([x, y], axis=-1) - a
    share = np.clip(off @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
    return np.asarray(np.hypot(*(off - share[:, None] * way).T))
