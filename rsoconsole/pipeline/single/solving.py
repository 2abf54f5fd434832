"""Plate solutions and detections of single frames under one configuration."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver, series_name
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.pipeline.frame.frame_cautions import cautions
from rsoconsole.pipeline.frame.hints import WrongHint, header_hint, hint_with_overrides, wrong_hints
from rsoconsole.pipeline.frame.plate import PlateFinder
from rsoconsole.records import Detections, Frame, NotSolved, Solution
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector, find_stars

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


class FrameDetector:
    """Detects streaks in single frames, which it calibrates first."""

    def __init__(self, config: Config) -> None:
        """Raise ModelError when the network cannot be loaded."""
        settings = config.detector
        network = Network.load(settings.model, settings.threads)
        self._config = config
        self._detector = StreakDetector(network, settings, ConfidenceCurve.from_card(network.card))
        self._calibration = Calibration(config)

    def detect(self, frame: Frame) -> tuple[Detections, tuple[str, ...]]:
        """Return the detections of a frame, and its cautions, a sentence each."""
        prepared, noted = self._calibration.prepare(frame)
        found = self._detector.analyse(prepared).detections
        notes = (*noted, *cautions(frame, None, self._config))
        return found, tuple(each.words for each in notes)
