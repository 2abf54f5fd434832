"""Plate solution of a frame or a part of it: the last one refitted, or a new one."""

import time
from dataclasses import dataclass, replace

from rsoconsole.base import SolverError
from rsoconsole.config import Config
from rsoconsole.instruments import MIN_STARS, PlateSolver, SolveHint
from rsoconsole.pipeline.frame.hints import header_hint, likely_hints, relaxed_hints, rescaled_hint
from rsoconsole.records import Detection, Detections, Frame, NotSolved, Solution, Wcs
from rsoconsole.sky import wrap_180
from rsoconsole.vision import StarList

MIN_PART_PX = 1_100
"""Shortest side of a part: fewer pixels have too few catalogue stars for the plate solution."""
MIN_SHARE = 0.25
"""Shortest side of a part, as a fraction of the frame's shorter side."""
MAX_SHARE = 0.7
"""Largest fraction of the frame's pixels in a part; a larger part is no faster than the whole."""
_GRID_PX = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePart:
    """Rectangle of a frame's pixels."""

    x0_px: int
    y0_px: int
    size_px: tuple[int, int]
    """Width and height."""

    def cut(self, frame: Frame) -> Frame:
        """Return the part as a frame; its pixels are a view of the frame's, not a copy."""
        width_px, height_px = self.size_px
        rows = slice(self.y0_px, self.y0_px + height_px)
        columns = slice(self.x0_px, self.x0_px + width_px)
        return replace(frame, pixels=frame.pixels[rows, columns])

    def to_part_plate(self, plate: Wcs) -> Wcs:
        """Return a plate solution of the frame, converted to the part's pixels."""
        return self._shifted(plate, -1)

    def to_frame_plate(self, plate: Wcs) -> Wcs:
        """Return a plate solution of the part, converted to the frame's pixels."""
        return self._shifted(plate, 1)

    def _shifted(self, plate: Wcs, sign: int) -> Wcs:
        return replace(
            plate,
            crpix_x_px=plate.crpix_x_px + sign * self.x0_px,
            crpix_y_px=plate.crpix_y_px + sign * self.y0_px,
        )

    def streaks_in_frame_px(self, found: Detections, frame: Frame) -> Detections:
        """Return the streaks that lie wholly in the part, converted to the frame's pixels."""
        whole = tuple(
            self.streak_in_frame_px(each) for each in found.detections if not each.is_clipped
        )
        return replace(
            found, width_px=frame.width_px, height_px=frame.height_px, detections=whole, rejected=()
        )

    def streak_in_frame_px(self, each: Detection) -> Detection:
        """Return a streak of the part, converted to the frame's pixels."""
        x, y = self.x0_px, self.y0_px
        left, top, right, bottom = each.box_px
        return replace(
            each,
            x_px=each.x_px + x,
            y_px=each.y_px + y,
            x_a_px=each.x_a_px + x,
            y_a_px=each.y_a_px + y,
            x_b_px=each.x_b_px + x,
            y_b_px=each.y_b_px + y,
            box_px=(left + x, top + y, right + x, bottom + y),
        )


def middle_part(frame: Frame, reach_px: float) -> FramePart | None:
    """Part of a frame from its centre out to ``reach_px``; None where that is most of the frame."""
    least_px = max(MIN_PART_PX / 2.0, MIN_SHARE * min(frame.width_px, frame.height_px))
    half_px = max(reach_px, least_px)
    sides = [
        min(2 * int(half_px) // _GRID_PX * _GRID_PX, side)
        for side in (frame.width_px, frame.height_px)
    ]
    if sides[0] * sides[1] > MAX_SHARE * frame.width_px * frame.height_px:
        return None
    return FramePart(
        x0_px=(frame.width_px - sides[0]) // 2,
        y0_px=(frame.height_px - sides[1]) // 2,
        size_px=(sides[0], sides[1]),
    )


def relative_part(before: Frame, frame: Frame) -> FramePart | None:
    """Return the rectangle of ``frame`` in the pixels of ``before``, a frame of the same sensor.

    Where ``frame`` shows more of the sensor, the corner lies outside ``before``. None where the
    binnings differ, and where the headers do not give the corners.
    """
    one, other = before.camera, frame.camera
    if one is None or other is None or one.binning is None or one.binning != other.binning:
        return None
    smaller = one if before.width_px < frame.width_px else other
    if smaller.x0_px is None or smaller.y0_px is None:
        return None
    return FramePart(
        x0_px=(other.x0_px or 0) - (one.x0_px or 0),
        y0_px=(other.y0_px or 0) - (one.y0_px or 0),
        size_px=(frame.width_px, frame.height_px),
    )


MIN_S = 0.2
"""Shortest time left before the deadline, s, in which another search is started."""
_CLOUD_SHARE = 0.5
"""Share of the last plate's star count below which cloud hides the field."""
_CLOUD_TURNS = 4
"""Number of frames in a row that may be cloudy before hints that have held are doubted."""


class FixedPlateSource:
    """Returns a plate solution set from outside; base of the classes that find one."""

    solution: Solution | NotSolved | None = None
    """Plate solution that ``solve`` returns; None where none is wanted."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from the next frame on."""

    def forget(self) -> None:
        """Forget the last plate solution, because the camera has turned."""

    def solve(self, frame: Frame, stars: StarList) -> Solution | NotSolved | None:
        """Return the plate solution set in ``solution``, whatever the frame."""
        _ = frame, stars
        return self.solution

    def refit_part(self, frame: Frame, stars: StarList, part: FramePart) -> Solution | None:
        """Return None: a fixed plate solution is not refitted to a part of a frame."""
        _ = frame, stars, part
        return None


class PlateFinder(FixedPlateSource):
    """Finds plate solutions; keeps the last one, and the mount's pointing at its frame."""

    def __init__(self, solver: PlateSolver, config: Config) -> None:
        self._solver = solver
        self._config = config
        self._last: Solution | None = None
        self._last_frame: Frame | None = None
        self._last_stars = 0
        self._failures = 0
        self._scale_factor = 1.0
        """Ratio of the stars' scale to the header's, where the header's was wrong."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from the next frame on."""
        self._config = config

    def forget(self) -> None:
        """Forget the last plate solution: after a change of the pier's side it is of no use."""
        self._last = self._last_frame = None

    def solve(self, frame: Frame, stars: StarList) -> Solution | NotSolved:
        """Refit the last plate solution; where that fails, solve with the hints from the header.

        Where that fails too, weaker hints are tried, but only in the first, second, fourth,
        eighth... of successive unsolved frames, because such a search is slow and clouds last; in a
        frame with less than half of the last solution's stars, only from the fourth on. Such a
        search of a frame whose header has no position ends after ``solver.blind_deadline_s``, any
        other after ``solver.deadline_s``.
        """
        solution: Solution | NotSolved | None = self._refit(frame, stars)
        if solution is None:
            turn = self._failures + 1
            is_turn = turn & (turn - 1) == 0
            if self._last is not None and len(stars) < _CLOUD_SHARE * self._last_stars:
                is_turn &= turn >= _CLOUD_TURNS
            hint = rescaled_hint(header_hint(frame, self._config), self._scale_factor)
            solution = self.solve_in_full(frame, stars, hint, is_relaxed=is_turn)
        self._failures = self._failures + 1 if isinstance(solution, NotSolved) else 0
        if isinstance(solution, Solution):
            self._scale_factor = self._factor_of(frame, solution)
            self._last = solution
            if solution.path != "shift":
                self._last_stars = len(stars)
            # Only the pointing and the size are kept: a frame holds 33 MB.
            self._last_frame = replace(frame, pixels=frame.pixels[:0].copy())
        return solution

    def refit_part(self, frame: Frame, stars: StarList, part: FramePart) -> Solution | None:
        """Return the last plate solution refitted to part of a frame; None where it does not fit.

        ``stars``: in the part's pixels; the result is in the frame's. The stored plate solution
        does not change.
        """
        last = self._last
        if last is None:
            return None
        here = self._refit(frame, stars, part, replace(last, wcs=part.to_part_plate(last.wcs)))
        return None if here is None else replace(here, wcs=part.to_frame_plate(here.wcs))

    def _factor_of(self, frame: Frame, solution: Solution) -> float:
        """Correction of the header's scale: a wrong focal length costs one search in all."""
        if frame.scale_arcsec_px is None:
            return 1.0
        factor = solution.scale_arcsec_px / frame.scale_arcsec_px
        return 1.0 if abs(factor - 1.0) <= self._config.solver.scale_tolerance else factor

    def solve_in_full(
        self, frame: Frame, stars: StarList, hint: SolveHint, *, is_relaxed: bool = True
    ) -> Solution | NotSolved:
        """Solve a frame by its hint, then by others in the time left before the deadline.

        The others are what the header means where it is written in a frequent wrong form, then
        weaker ones.

        ``is_relaxed``: whether weaker hints are allowed. The deadline is
        ``solver.blind_deadline_s`` where they are and ``hint`` has no position, else
        ``solver.deadline_s``.
        """
        settings = self._config.solver
        started_s = time.monotonic()
        is_blind = hint.position_deg is None and is_relaxed
        deadline_s = settings.blind_deadline_s if is_blind else settings.deadline_s
        end_s = started_s + deadline_s
        first = found = self._attempt(frame, stars, hint, deadline_s)
        weaker: tuple[SolveHint, ...] = ()
        if is_relaxed and len(stars) >= MIN_STARS:
            weaker = (*likely_hints(hint, frame, self._config), *relaxed_hints(hint))
        attempts = 0
        for number, less in enumerate(weaker):
            left_s = end_s - time.monotonic()
            if isinstance(found, Solution) or left_s < MIN_S:
                break
            # The last one may take all that is left: it has no hints.
            found = self._attempt(frame, stars, less, left_s / (len(weaker) - number))
            attempts += 1
        ms = 1e3 * (time.monotonic() - started_s)
        if isinstance(found, Solution):
            return replace(found, ms=ms)
        words = first.reason if isinstance(first, NotSolved) else ""
        if attempts and attempts == len(weaker):
            words += "; nor without these hints"
        return NotSolved(frame_id=frame.frame_id, reason=words, ms=ms)

    def _attempt(
        self, frame: Frame, stars: StarList, hint: SolveHint, deadline_s: float
    ) -> Solution | NotSolved:
        try:
            return self._solver.solve(
                stars,
                frame_id=frame.frame_id,
                width_px=frame.width_px,
                height_px=frame.height_px,
                hint=hint,
                deadline_s=deadline_s,
                t_utc_ns=frame.t_mid_utc_ns,
            )
        except SolverError as error:
            # A solver that cannot be started now may be again at the next frame.
            return NotSolved(frame_id=frame.frame_id, reason=str(error), ms=0.0)

    def _refit(
        self,
        frame: Frame,
        stars: StarList,
        part: FramePart | None = None,
        last: Solution | None = None,
    ) -> Solution | None:
        last, before = last or self._last, self._last_frame
        size_px = (frame.width_px, frame.height_px) if part is None else part.size_px
        if last is None or before is None:
            return None
        if before.width_px != frame.width_px:
            between = relative_part(before, frame)
            if between is None:
                return None
            last = replace(last, wcs=between.to_part_plate(last.wcs))
        if before.pointing_ra_icrs_deg is None or before.pointing_dec_icrs_deg is None:
            return None
        if frame.pointing_ra_icrs_deg is None or frame.pointing_dec_icrs_deg is None:
            return None
        shift_deg = (
            float(wrap_180(frame.pointing_ra_icrs_deg - before.pointing_ra_icrs_deg)),
            frame.pointing_dec_icrs_deg - before.pointing_dec_icrs_deg,
        )
        return self._solver.refit_from(
            last,
            stars,
            frame_id=frame.frame_id,
            width_px=size_px[0],
            height_px=size_px[1],
            shift_deg=shift_deg,
            t_utc_ns=frame.t_mid_utc_ns,
            may_be_few=part is None,
        )
