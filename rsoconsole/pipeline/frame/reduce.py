"""One frame to measurements: detect, solve, measure. The engine and every replay run this."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver
from rsoconsole.pipeline.comparison.fixed_light import FrameComparison, RecordedComparison
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.pipeline.frame.frame_cautions import Caution, cautions
from rsoconsole.pipeline.frame.measurement import measure_detections
from rsoconsole.pipeline.frame.plate import FixedPlateSource, PlateFinder, middle_part
from rsoconsole.pipeline.photometry.frame_photometry import FrameLight, light_streaks
from rsoconsole.records import (
    BelowTau,
    ChartStar,
    Detections,
    Frame,
    Measurement,
    Missed,
    NotSolved,
    Solution,
)
from rsoconsole.vision import (
    ConfidenceCurve,
    Network,
    Proposer,
    PsfMemory,
    StarList,
    StreakDetector,
    median_of,
)
from rsoconsole.words import text


@dataclass(frozen=True, slots=True, kw_only=True)
class Glance:
    """Streaks and plate solution of the middle of a frame, in the whole frame's pixels."""

    detections: Detections
    solution: Solution


BRIGHTEST_STARS = slice(20, 60)
CHART_STARS = 60
"""Number of a frame's brightest stars that are kept for its chart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """Result of the reduction of one frame."""

    detections: Detections
    solution: Solution | NotSolved | None
    """Plate solution; None where none was wanted."""
    measurements: tuple[Measurement, ...]
    star_count: int
    fwhm_px: float | None
    """FWHM of the frame's own stars; None where they are too few."""
    absence: str
    """Reason why the frame has no measurement; ``cycle.miss_reasons`` adds the cause of a miss."""
    stage_ms: dict[str, float] = field(default_factory=dict)
    cautions: tuple[Caution, ...] = ()
    chart_stars: tuple[ChartStar, ...] = ()
    """The frame's brightest stars, the brightest first."""
    light: FrameLight | None = None
    """What ``photometry_of`` measures, once the order is given."""


class FrameReducer:
    """Reduces frames by detector and plate finder, in the order of Algorithm 1."""

    def __init__(
        self,
        network: Proposer,
        curve: ConfidenceCurve,
        plate: FixedPlateSource,
        config: Config,
        *,
        calibration: Calibration | None = None,
        comparison: FrameComparison | RecordedComparison | None = None,
    ) -> None:
        """``calibration``: one made for the same configuration; None: a new one.

        ``comparison``: None for ``FrameComparison``, with the frame before and the shipped stars.
        """
        self._network = network
        self._curve = curve
        self._memory = PsfMemory()
        self._detector = StreakDetector(network, config.detector, curve, self._memory)
        self._glancer = StreakDetector(network, config.detector, curve, is_quick=True)
        self._plate = plate
        self._comparison = comparison or FrameComparison()
        self._config = config
        self._calibration = calibration or Calibration(config)

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from the next frame on."""
        self._config = config
        if not self._calibration.has_masters_of(config):
            self._calibration = Calibration(config)
        self._detector = StreakDetector(self._network, config.detector, self._curve, self._memory)
        self._glancer = StreakDetector(self._network, config.detector, self._curve, is_quick=True)
        self._plate.configure(config)

    def make_ready(self) -> None:
        """Read the master frames now, so that the first frame does not wait for them."""
        self._calibration.make_ready(self._config)

    def forget_plate(self) -> None:
        """Forget the last plate solution: the next frame is solved in full."""
        self._plate.forget()

    def glance(self, frame: Frame, reach_px: float) -> Glance | None:
        """Return streaks and plate solution found in the middle of a frame, before it is reduced.

        The middle reaches ``reach_px`` from the centre. None where the middle is not much smaller
        than the frame, has no streak, or has stars that do not fit the last plate solution.
        """
        middle = middle_part(frame, reach_px)
        if middle is None:
            return None
        even, _ = self._calibration.prepare(frame)
        analysis = self._glancer.analyse(middle.cut(even))
        found = middle.streaks_in_frame_px(analysis.detections, frame)
        if not found.detections:
            return None
        solution = self._plate.refit_part(frame, analysis.stars, middle)
        return None if solution is None else Glance(detections=found, solution=solution)

    def reduce(self, frame: Frame) -> Reduction:
        """Return detections, solution and measurements of one frame.

        The plate is solved where something was detected, below tau too, or where the header gives a
        direction: it costs little and shows where the telescope really points. With the solution
        the streaks are compared with the frame before and the star catalogue. A detection in an
        unsolved frame makes no measurement: the mount's reported position never replaces a
        solution.
        """
        stage_ms: dict[str, float] = {}
        with time_stage(stage_ms, "detect"):
            even, noted = self._calibration.prepare(frame)
            analysis = self._detector.analyse(even)
        found = analysis.detections
        judging = ("network", "fit", "faint", "judge", "class")
        network_ms = sum(found.stage_ms.get(each, 0.0) for each in judging)
        stage_ms["process"] = stage_ms["detect"] - network_ms
        stage_ms["detect"] = network_ms
        solution: Solution | NotSolved | None = None
        faint = any(isinstance(each.reason, BelowTau) for each in found.rejected)
        if found.detections or faint or frame.pointing_ra_icrs_deg is not None:
            with time_stage(stage_ms, "solve"):
                solution = self._plate.solve(frame, analysis.stars)
        measurements: tuple[Measurement, ...] = ()
        before = self._comparison.before
        if isinstance(solution, Solution):
            with time_stage(stage_ms, "compare"):
                found = self._comparison.compared_detections(even, analysis, solution)
            measurements = measure_detections(found, solution, frame, self._config.exposure)
        star_count = len(analysis.stars.x_px)
        is_measured = analysis.stars.width_source == "measured" and star_count > 0
        fwhm_px = analysis.stars.median_fwhm_px if is_measured else None
        return Reduction(
            detections=replace(
                found,
                star_count=star_count,
                star_fwhm_px=fwhm_px,
                star_flux_adu=typical_flux_adu(analysis.stars),
                background_adu=median_of(analysis.background.level),
            ),
            solution=solution,
            measurements=measurements,
            star_count=star_count,
            fwhm_px=fwhm_px,
            absence=text(miss_from_frame_records(found, solution, frame.t_mid_utc_ns)),
            stage_ms=stage_ms,
            cautions=(*noted, *cautions(frame, solution, self._config)),
            chart_stars=brightest_stars(analysis.stars),
            light=FrameLight(
                frame=even,
                stars=analysis.stars,
                background=analysis.background,
                streaks=light_streaks(found, measurements),
                solution=solution if isinstance(solution, Solution) else None,
                before=before,
            ),
        )


def typical_flux_adu(stars: StarList) -> float | None:
    """Return the median flux of the 20th to 60th brightest star; None where there are fewer.

    Cloud lowers it before stars disappear. The very brightest stars are left out: they are
    saturated, and so few that each one entering the field would change the median.
    """
    if len(stars) < BRIGHTEST_STARS.stop:
        return None
    return median_of(stars.flux[BRIGHTEST_STARS])


def brightest_stars(stars: StarList) -> tuple[ChartStar, ...]:
    """Return the brightest ``CHART_STARS`` stars, or all where there are fewer."""
    columns = (stars.x_px, stars.y_px, stars.flux)
    return tuple(map(ChartStar, *(column[:CHART_STARS].tolist() for column in columns)))


def miss_from_frame_records(
    found: Detections, solution: Solution | NotSolved | None, t_mid_utc_ns: int | None
) -> Missed:
    """Return the reason why a frame has no measurement, from its own records alone.

    ``t_mid_utc_ns``: mid-exposure; None for a frame without a time.
    """
    if not found.detections:
        return Missed(kind="no detection")
    if isinstance(solution, NotSolved):
        return Missed(kind="not solved", detail=solution.reason)
    return Missed(kind="no time" if t_mid_utc_ns is None else "not measured")


@contextmanager
def time_stage(stage_ms: dict[str, float], stage: str) -> Iterator[None]:
    """Measure the time of the context's body, ms, and store it as ``stage_ms[stage]``."""
    started_s = time.perf_counter()
    yield
    stage_ms[stage] = (time.perf_counter() - started_s) * 1e3


@contextmanager
def open_reducer(config: Config) -> Iterator[tuple[FrameReducer, str]]:
    """Open a reducer; yield it with the network's SHA-256.

    Raises ModelError when the network cannot be loaded, SolverError without index files.
    """
    network = Network.load(config.detector.model, config.detector.threads)
    curve = ConfidenceCurve.from_card(network.card)
    with PlateSolver(config.solver.index_dirs, start_s=config.waits.process_s) as solver:
        yield (
            FrameReducer(network, curve, PlateFinder(solver, config), config),
            str(network.card["sha256"]),
        )
