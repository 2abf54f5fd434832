"""A single frame for comparison with the catalogue: its plate solution, its lines, its points."""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rsoconsole.base import FrameError, SolverError
from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver, exposure_time
from rsoconsole.orbits import (
    Candidate,
    CatalogueEntry,
    FieldCatalogue,
    FieldMatch,
    FieldOfView,
    LineMatch,
    StreakLine,
    match_field,
)
from rsoconsole.pipeline.comparison.look_back import SolvedField
from rsoconsole.pipeline.field.field_points import FramePoints, Mover, find_movers, frame_points
from rsoconsole.pipeline.field.point_light import PointMagnitude, point_light
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.pipeline.frame.measurement import frame_timing, measure, mid_exposure_utc_ns
from rsoconsole.pipeline.frame.plate import FixedPlateSource, PlateFinder
from rsoconsole.pipeline.frame.reduce import FrameReducer
from rsoconsole.pipeline.orbits.expected import catalogue_errors
from rsoconsole.pipeline.photometry.frame_photometry import FrameLight, photometry_of
from rsoconsole.records import (
    BelowTau,
    Detection,
    FloatArray,
    Frame,
    NotSolved,
    Solution,
    StreakLight,
)
from rsoconsole.sky import (
    ARCSEC_RAD,
    describe_field,
    direction_to_unit,
    pixel_to_sky,
    sky_to_pixel,
    unit_to_direction,
    wcs_from_cards,
)
from rsoconsole.vision import ConfidenceCurve, Network, StarList, find_stars, local_background

PlateMode = Literal["auto", "solve", "header"]
_HEADER_RMS_PX = 0.5
"""Assumed RMS of a header's plate solution, which states none, px."""
_BOX_SIGMA_DEG = 30.0
_FAINT_STRANGERS = 5.0
"""Fewest lines below tau that are nothing catalogued, as assumed for each faint line."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldFrame:
    """Frame with a time and a plate solution."""

    t_mid_utc_ns: int
    exposure_s: float
    width_px: int
    height_px: int
    solution: Solution
    plate_from: Literal["solved", "header"]
    detections: tuple[Detection, ...]
    """Accepted detections, then those below tau, which count only where an object explains one."""
    taken: int
    """Number of accepted detections, the first of ``detections``."""
    lines: tuple[StreakLine, ...]
    points: FramePoints
    notes: tuple[str, ...]
    lights: tuple[StreakLight | None, ...] = ()
    """Brightness of each of ``detections``; None where it was not measured."""

    def contains(self, u: FloatArray) -> np.ndarray:
        """True, (...,), for each unit vector (..., 3) that points into the frame."""
        x, y = sky_to_pixel(self.solution.wcs, *unit_to_direction(u))
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (x >= -0.5) & (x <= self.width_px - 0.5) & (y >= -0.5) & (y <= self.height_px - 0.5)
            )

    def point_magnitude(self, n: int, rate: FloatArray) -> PointMagnitude | None:
        """Magnitude of point ``n``, which moves by ``rate`` (3,), unit vectors a second.

        None where it was not measured.
        """
        points = self.points
        if points.light is None:
            return None
        way = 0.5 * self.exposure_s * np.stack([-rate, rate])
        u = points.u[n] + way
        u /= np.linalg.norm(u, axis=1)[:, None]
        x, y = sky_to_pixel(self.solution.wcs, *unit_to_direction(u))
        way_px = float(x[1] - x[0]), float(y[1] - y[0])
        return points.light.magnitude(n, (float(points.x_px[n]), float(points.y_px[n])), way_px)

    def field_of_view(self, config: Config) -> FieldOfView:
        """Return the field of view of the frame, in which catalogued objects are looked up."""
        wcs = self.solution.wcs
        x = np.array([-0.5, self.width_px - 0.5, -0.5, self.width_px - 0.5])
        y = np.array([-0.5, -0.5, self.height_px - 0.5, self.height_px - 0.5])
        corners = direction_to_unit(*pixel_to_sky(wcs, x, y))
        centre = direction_to_unit(self.solution.ra_icrs_deg, self.solution.dec_icrs_deg)
        scale_rad = self.solution.scale_arcsec_px * ARCSEC_RAD
        return FieldOfView(
            site=config.site.to_site(),
            t_mid_utc_ns=self.t_mid_utc_ns,
            exposure_s=self.exposure_s,
            centre=centre,
            radius_rad=float(np.arccos(np.clip(corners @ centre, -1.0, 1.0)).max()),
            area_rad2=self.width_px * self.height_px * scale_rad**2,
            contains=self.contains,
        )


class FieldPlateFinder(FixedPlateSource):
    """Finds the plate solution of a frame: by the solver, or from the frame's header."""

    def __init__(self, finder: PlateFinder | None, no_solver: str, mode: PlateMode) -> None:
        """``finder``: None where there is no solver; ``no_solver`` is then the reason why not."""
        self._finder, self._no_solver, self._mode = finder, no_solver, mode
        self.source: Literal["solved", "header"] = "solved"
        self.why_header = ""
        """Reason why the plate was not solved and the header's is used; empty where none was."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from the next frame on."""
        if self._finder is not None:
            self._finder.configure(config)

    def forget(self) -> None:
        """Forget the camera's last plate solution."""
        if self._finder is not None:
            self._finder.forget()

    def solve(self, frame: Frame, stars: StarList) -> Solution | NotSolved:
        """Return the plate solution of a frame, from the solver or the header as the mode says."""
        self.source, self.why_header = "solved", ""
        if self._mode == "header":
            return self._of_header(frame, "")
        if self._finder is None:
            solved: Solution | NotSolved = NotSolved(
                frame_id=frame.frame_id, reason=self._no_solver, ms=0.0
            )
        else:
            solved = self._finder.solve(frame, stars)
        has_plate = str(frame.header.get("CTYPE1", "")).startswith("RA---TAN")
        if isinstance(solved, Solution) or self._mode == "solve" or not has_plate:
            return solved
        return self._of_header(frame, solved.reason)

    def _of_header(self, frame: Frame, why: str) -> Solution | NotSolved:
        try:
            wcs = wcs_from_cards(frame.header)
            field = describe_field(wcs, frame.width_px, frame.height_px)
        except FrameError as error:
            return NotSolved(frame_id=frame.frame_id, reason=str(error), ms=0.0)
        self.source, self.why_header = "header", why
        return Solution(
            frame_id=frame.frame_id,
            wcs=wcs,
            ra_icrs_deg=field.ra_icrs_deg,
            dec_icrs_deg=field.dec_icrs_deg,
            scale_arcsec_px=field.scale_arcsec_px,
            rotation_deg=field.rotation_deg,
            is_flipped=field.is_flipped,
            matched=0,
            rms_arcsec=_HEADER_RMS_PX * field.scale_arcsec_px,
            path="full",
            ms=0.0,
        )


class FieldReader:
    """Reads single frames: plate solution, lines and points of each."""

    def __init__(self, reducer: FrameReducer, plate: FieldPlateFinder, config: Config) -> None:
        self._reducer, self._plate, self._config = reducer, plate, config
        self._calibration = Calibration(config)

    def read(self, frame: Frame) -> FieldFrame:
        """Reduce one frame. Raises FrameError where its time or its plate solution is missing."""
        t_mid_utc_ns = mid_exposure_utc_ns(frame, self._config.exposure)
        if t_mid_utc_ns is None or frame.exposure_s is None:
            raise FrameError(
                f"{frame.name}: no time of exposure: {exposure_time(frame.header).fault}; what"
                " crossed is found by start and exposure time alone"
            )
        even, _ = self._calibration.prepare(frame)
        sky = local_background(even.pixels)
        stars = find_stars(even.pixels, sky, max_stars=1500, saturation_adu=even.saturation_adu)
        reduction = self._reducer.reduce(frame)
        solution = reduction.solution
        if solution is None:
            solution = self._plate.solve(frame, stars)
        if isinstance(solution, NotSolved):
            raise FrameError(f"{frame.name}: no plate: {solution.reason}")
        taken = reduction.detections.detections
        faint = tuple(
            each.detection
            for each in reduction.detections.rejected
            if isinstance(each.reason, BelowTau) and each.detection.method == "line"
        )
        points = frame_points(stars, solution, t_mid_utc_ns, frame, taken, self._config)
        solved = SolvedField(frame=even, stars=stars, solution=solution)
        places_px = np.stack([points.x_px, points.y_px], axis=1)
        strangers = max(_FAINT_STRANGERS, float(len(faint)))
        lines = [sky_line(each, solution, frame, self._config) for each in taken]
        lines += [
            replace(sky_line(each, solution, frame, self._config), strangers=strangers)
            for each in faint
        ]
        notes = [each.words for each in reduction.cautions]
        if self._plate.why_header:
            notes.append(f"not solved ({self._plate.why_header}): the header's plate is taken")
        return FieldFrame(
            t_mid_utc_ns=t_mid_utc_ns,
            exposure_s=frame.exposure_s,
            width_px=frame.width_px,
            height_px=frame.height_px,
            solution=solution,
            plate_from=self._plate.source,
            detections=(*taken, *faint),
            taken=len(taken),
            lines=tuple(lines),
            points=replace(points, light=point_light(solved, sky, places_px)),
            notes=tuple(notes),
            lights=_lights_of(reduction.light, solution, (*taken, *faint)),
        )


def _lights_of(
    light: FrameLight | None, solution: Solution, streaks: tuple[Detection, ...]
) -> tuple[StreakLight | None, ...]:
    """Brightness of a frame's streaks, in their order."""
    if light is None or not streaks:
        return (None,) * len(streaks)
    named = tuple((str(n), each) for n, each in enumerate(streaks))
    found = photometry_of(replace(light, streaks=named, solution=solution)).streaks
    by_name = {each.measurement_id: each for each in found}
    return tuple(by_name.get(name) for name, _ in named)


@contextmanager
def open_field_reader(config: Config, mode: PlateMode) -> Iterator[FieldReader]:
    """Open a reader of single frames for the time of the context.

    ``mode``: where the plate solutions come from. Raises ModelError when the network cannot be
    loaded, SolverError without index files where the plates have to be solved.
    """
    network = Network.load(config.detector.model, config.detector.threads)
    curve = ConfidenceCurve.from_card(network.card)
    with ExitStack() as stack:
        finder, why = None, ""
        if mode != "header":
            try:
                solver = stack.enter_context(
                    PlateSolver(config.solver.index_dirs, start_s=config.waits.process_s)
                )
                finder = PlateFinder(solver, config)
            except SolverError as error:
                if mode == "solve":
                    raise
                why = str(error)
        plate = FieldPlateFinder(finder, why, mode)
        yield FieldReader(FrameReducer(network, curve, plate, config), plate, config)


def sky_line(detection: Detection, solution: Solution, frame: Frame, config: Config) -> StreakLine:
    """Return a detection as a line on the sky."""
    x = np.array([detection.x_a_px, detection.x_b_px, detection.x_px])
    y = np.array([detection.y_a_px, detection.y_b_px, detection.y_px])
    a, b, middle = direction_to_unit(*pixel_to_sky(solution.wcs, x, y))
    scale_rad = solution.scale_arcsec_px * ARCSEC_RAD
    measured = measure(detection, solution, frame, config.exposure, measurement_id="")
    sigma_deg = detection.sigma_angle_deg
    if detection.method == "box":
        sigma_deg = _BOX_SIGMA_DEG
    elif sigma_deg is None:
        across_px = max(detection.sigma_across_px, 0.1)
        sigma_deg = math.degrees(2.0 * across_px / max(detection.length_px, 1.0))
    is_end_a, is_end_b = _ends_within(detection, frame)
    east, both, north = (0.0, 0.0, 0.0) if measured is None else measured.cov_sky_arcsec2
    # A light of some width has ends less sure than its middle.
    length_px = 2.0 * detection.sigma_along_px + 0.5 * max(detection.width_px, 1.0)
    return StreakLine(
        a=a,
        b=b,
        middle=middle,
        is_end_a=is_end_a,
        is_end_b=is_end_b,
        is_ordered=False,
        after_s=detection.y_px * frame_timing(frame, config.exposure).line_time_us * 1e-6,
        cov_sky_rad2=(east * ARCSEC_RAD**2, both * ARCSEC_RAD**2, north * ARCSEC_RAD**2),
        sigma_direction_rad=math.radians(sigma_deg),
        sigma_length_rad=length_px * scale_rad,
    )


def _ends_within(detection: Detection, frame: Frame) -> tuple[bool, bool]:
    """True for each end that is the object's own; the frame's edge cuts the other."""
    if detection.kind == "streak":
        return True, True
    if detection.kind == "crossing":
        return False, False
    to_rim = [
        min(x, y, frame.width_px - 1 - x, frame.height_px - 1 - y)
        for x, y in ((detection.x_a_px, detection.y_a_px), (detection.x_b_px, detection.y_b_px))
    ]
    return to_rim[0] > to_rim[1], to_rim[0] <= to_rim[1]


CROSSED = 0.05
"""Least probability with which an object counts as having crossed the frame."""
TAKEN = 0.5
"""Least probability with which an object counts as seen in the frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameMatches:
    """Lines of one frame matched with the catalogued objects in its field."""

    frame: FieldFrame
    candidates: tuple[Candidate, ...]
    match: FieldMatch
    detections: tuple[Detection, ...]
    """Detections of ``match.lines``: the accepted ones, and those below tau that are identified."""
    lights: tuple[StreakLight | None, ...]
    """Brightness of each of them; None where it was not measured."""
    compared: int
    too_old: int
    without_place: tuple[CatalogueEntry, ...] = ()
    """Objects for which SGP4 has no place then."""

    @property
    def crossing_indices(self) -> tuple[int, ...]:
        """Indices in ``candidates`` of objects that crossed the frame, likeliest first.

        An object counts from a probability of ``CROSSED`` on, to have crossed or to have been
        seen.
        """
        chances = [
            max(each.chance, taken)
            for each, taken in zip(self.candidates, self.match.taken, strict=True)
        ]
        order = sorted(range(len(chances)), key=lambda n: (-chances[n], n))
        return tuple(n for n in order if chances[n] >= CROSSED)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MoverMatches:
    """One moving point and the catalogued objects that match it."""

    mover: Mover
    candidates: tuple[Candidate, ...]
    matched: LineMatch


class CatalogueMatcher:
    """Matches one frame after another with one catalogue."""

    def __init__(self, config: Config, entries: Sequence[CatalogueEntry]) -> None:
        self._config = config
        self._catalogue = FieldCatalogue(entries, catalogue_errors(config.catalogue))

    def match_frame(self, frame: FieldFrame) -> FrameMatches:
        """Match the lines of one frame with the catalogued objects in its field."""
        view = frame.field_of_view(self._config)
        candidates = self._catalogue.candidates(view)
        match = match_field(view, candidates, frame.lines)
        kept = [
            n
            for n, each in enumerate(match.lines)
            if n < frame.taken or each.verdict == "identified"
        ]
        lines = tuple(match.lines[n] for n in kept)
        taken = [0.0] * len(candidates)
        for choice in (choice for each in lines for choice in each.choices):
            if choice.candidate is not None:
                taken[choice.candidate] += choice.probability
        return FrameMatches(
            frame=frame,
            candidates=candidates,
            match=FieldMatch(lines=lines, taken=tuple(min(each, 1.0) for each in taken)),
            detections=tuple(frame.detections[n] for n in kept),
            lights=tuple(frame.lights[n] if frame.lights else None for n in kept),
            compared=self._catalogue.compared_count,
            too_old=self._catalogue.too_old_count,
            without_place=self._catalogue.without_place,
        )

    def match_movers(self, frames: Sequence[FieldFrame]) -> tuple[MoverMatches, ...]:
        """Find the points that move through the frames, and match them with the catalogue.

        ``frames``: in order of time.
        """
        found = find_movers([each.points for each in frames])
        answers: dict[int, MoverMatches] = {}
        groups: dict[tuple[int, int], list[int]] = {}
        for place, mover in enumerate(found):
            groups.setdefault((mover.points[0][0], mover.points[-1][0]), []).append(place)
        for (first, last), places in groups.items():
            movers = [found[n] for n in places]
            middle = frames[(first + last) // 2]
            view = _view_of(movers, middle.field_of_view(self._config))
            candidates = self._catalogue.candidates(view)
            match = match_field(view, candidates, [each.line for each in movers])
            for n, mover, matched in zip(places, movers, match.lines, strict=True):
                answers[n] = MoverMatches(mover=mover, candidates=candidates, matched=matched)
        return tuple(answers[n] for n in range(len(found)))


def _view_of(movers: Sequence[Mover], frame: FieldOfView) -> FieldOfView:
    """Return the field of view of the frames from the first point to the last, as one exposure."""
    longest = max(each.line.length_rad for each in movers)
    return replace(
        frame,
        t_mid_utc_ns=int(np.mean([each.t_mid_utc_ns for each in movers])),
        exposure_s=float(np.mean([each.span_s for each in movers])),
        radius_rad=frame.radius_rad + longest / 2.0,
    )
