"""Plate solutions and detections of single frames under one configuration."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from rsoconsole.base import SolverError
from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver, series_name
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.pipeline.frame.frame_cautions import cautions
from rsoconsole.pipeline.frame.hints import WrongHint, header_hint, hint_with_overrides, wrong_hints
from rsoconsole.pipeline.frame.plate import PlateFinder
from rsoconsole.pipeline.photometry.frame_photometry import (
    FrameLight,
    light_streaks,
    photometry_of,
)
from rsoconsole.records import Detections, Frame, NotSolved, Photometry, Solution
from rsoconsole.vision import (
    ConfidenceCurve,
    Network,
    PointList,
    StarList,
    StreakDetector,
    find_points,
    find_stars,
)

log = logging.getLogger(__name__)

MAX_MASKED = 0.2
"""Largest fraction of a frame's pixels that may be masked: its stars are still found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveResult:
    """Plate solution of a frame, or the reason why it has none."""

    solution: Solution | NotSolved
    wrong: tuple[WrongHint, ...]
    index_missing: tuple[str, ...]
    notes: tuple[str, ...]


class FrameSolver:
    """Solves single frames in full; ``open`` starts the solver's process."""

    def __init__(self, solver: PlateSolver, config: Config) -> None:
        self._solver = solver
        self._config = config
        self._finder = PlateFinder(solver, config)
        self._calibration = Calibration(config)

    @classmethod
    @contextmanager
    def open(cls, config: Config) -> "Iterator[FrameSolver]":
        """Start the solver. Raises SolverError without index files."""
        with PlateSolver(config.solver.index_dirs, start_s=config.waits.process_s) as solver:
            yield cls(solver, config)

    def solve(
        self,
        frame: Frame,
        *,
        ra_icrs_deg: float | None = None,
        dec_icrs_deg: float | None = None,
        radius_deg: float | None = None,
        scale_arcsec_px: tuple[float, float] | None = None,
    ) -> SolveResult:
        """Solve a frame with its header's hints, or the values given here in place of them.

        A frame that is not solved with the hints is solved without them, within the same deadline.
        """
        prepared, calibrated = self._calibration.prepare(frame)
        stars = find_stars(prepared.pixels, saturation_adu=prepared.saturation_adu)
        hint = hint_with_overrides(
            header_hint(frame, self._config), ra_icrs_deg, dec_icrs_deg, radius_deg, scale_arcsec_px
        )
        solution = self._finder.solve_in_full(frame, stars, hint)
        wrong: tuple[WrongHint, ...] = ()
        missing: tuple[int, ...] = ()
        if isinstance(solution, Solution):
            wrong = wrong_hints(hint, solution, frame, self._config)
        else:
            missing = self._solver.missing_numbers_for_field(hint, frame.width_px, frame.height_px)
        warnings = (*calibrated, *cautions(frame, solution, self._config))
        return SolveResult(
            solution=solution,
            wrong=wrong,
            index_missing=tuple(series_name(number) for number in missing),
            notes=tuple(each.words for each in warnings if not each.kind.endswith(" hint")),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedFrame:
    """Streaks of a frame, their brightness, and cautions about the frame, a sentence each."""

    detections: Detections
    photometry: Photometry
    notes: tuple[str, ...]
    points: PointList | None = None
    """Points among the stars' trails; None where the stars are points themselves."""


class FrameDetector:
    """Detects streaks in single frames, which it calibrates first, and measures their light.

    Magnitudes need a plate: a frame with a streak is solved where its header has a direction.
    """

    def __init__(self, config: Config) -> None:
        """Raise ModelError when the network cannot be loaded."""
        settings = config.detector
        network = Network.load(settings.model, settings.threads)
        self._config = config
        self._detector = StreakDetector(network, settings, ConfidenceCurve.from_card(network.card))
        self._calibration = Calibration(config)
        self._open_solver = ExitStack()
        self._finder: PlateFinder | None = None
        self._has_no_solver = False

    def __enter__(self) -> "FrameDetector":
        """Return itself; the solver starts with the first frame that needs it."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the solver, if it was started."""
        self._open_solver.close()

    def detect(self, frame: Frame) -> DetectedFrame:
        """Return the detections of a frame, their light, and its cautions."""
        prepared, noted = self._calibration.prepare(frame)
        analysis = self._detector.analyse(prepared)
        found = analysis.detections
        # None without trails, at no cost.
        points = find_points(
            prepared.pixels,
            analysis.background,
            analysis.stars,
            saturation_adu=prepared.saturation_adu,
        )
        solution = self._solution(frame, analysis.stars) if found.detections else None
        light = FrameLight(
            frame=prepared,
            stars=analysis.stars,
            background=analysis.background,
            streaks=light_streaks(found, ()),
            solution=solution if isinstance(solution, Solution) else None,
        )
        notes = (*noted, *cautions(frame, None, self._config))
        return DetectedFrame(
            detections=found,
            photometry=photometry_of(light),
            notes=tuple(each.words for each in notes),
            points=points,
        )

    def _solution(self, frame: Frame, stars: StarList) -> Solution | NotSolved | None:
        """Solve a frame whose header has a direction; None for others and without index files."""
        if frame.pointing_ra_icrs_deg is None or self._has_no_solver:
            return None
        if self._finder is None:
            try:
                solver = self._open_solver.enter_context(
                    PlateSolver(
                        self._config.solver.index_dirs, start_s=self._config.waits.process_s
                    )
                )
            except SolverError as error:
                log.info("magnitudes are instrumental: %s", error)
                self._has_no_solver = True
                return None
            self._finder = PlateFinder(solver, self._config)
        return self._finder.solve(frame, stars)
