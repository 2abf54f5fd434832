"""A benchmark of this machine: a frame goes through the program's own stages until time is up."""

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TypeAlias

from rsoconsole.base import SessionError, system_errors_as, write_durably
from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import SLEW_OVERHEAD_S
from rsoconsole.engine.doctor.doctor_system import free_bytes, nearest_existing
from rsoconsole.engine.machine.medium import disk_outlook
from rsoconsole.instruments import frame_from_bytes
from rsoconsole.pipeline import Cycle, Reduction, open_reducer, time_stage
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.session import compress_frame
from rsoconsole.tracking import Following
from rsoconsole.vision import threads_for

BUDGET_S = 22.0
"""Time for the rounds, s; drawing, loading and the first round take more on top."""
MAX_ROUNDS = 25
SPARE_BYTES = 500_000_000
"""Free disk below which writing is not measured, bytes."""
STAGES: Mapping[str, str] = {
    "read": "FITS bytes to pixels",
    "pattern": "offsets of rows and columns",
    "background": "sky and noise, and the bins of map and stars",
    "map": "what the network sees",
    "stars": "beside map and network where there is a second thread",
    "network": "proposes streaks",
    "lines": "along which light adds up",
    "fit": "verifies and measures them",
    "faint": "the same at full depth, where nothing else is found",
    "class": "says what they are",
    "solve": "in full, by the solver's process",
    "refit": "the last plate moved onto the stars, while nothing jumps",
    "filter": "measurement and track",
    "total": "last byte to the slew command, solved in full",
    "total refit": "the same while following",
    "light": "magnitudes, after the order",
    "compress": "the frame without loss, beside the loop",
    "disk": "written to session.root and waited for",
    "read back": "the compressed frame to pixels",
}
Times: TypeAlias = dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchStage:
    """One stage's times over all rounds."""

    stage: str
    median_ms: float
    least_ms: float
    largest_ms: float
    repeats: int


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchResult:
    """The measured times of all stages."""

    stages: tuple[BenchStage, ...]
    """Stages in the order of ``STAGES``; those that could not be measured are missing."""
    threads: int
    width_px: int
    height_px: int
    detections: int
    compressed_bytes: int
    notes: tuple[str, ...]
    limiting_mag: float | None = None
    """Magnitude of a star with an SNR of 5 in the frame; None where it was not measured."""

    def median_ms(self, stage: str) -> float | None:
        """Median time of one stage, ms; None where it was not measured."""
        return next((each.median_ms for each in self.stages if each.stage == stage), None)


def run_benchmark(
    config: Config,
    fits: bytes,
    *,
    report: Callable[[str], None] = lambda _: None,
    budget_s: float = BUDGET_S,
    most_rounds: int = MAX_ROUNDS,
) -> BenchResult:
    """Put a frame, as a camera gives it, through every stage again and again.

    At least one round is made, however slow the machine is. ``fits``: the frame's FITS bytes;
    ``report``: called with each step in words. Raises FrameError, ModelError or SolverError as the
    engine would, SessionError where nothing can be written.
    """
    report("loading network, star index and catalogue")
    with (
        open_reducer(config) as (reducer, _),
        _scratch_folder(nearest_existing(config.session.root)) as scratch,
    ):
        bench = _Bench(Cycle(reducer, config), scratch)
        rounds: list[Times] = []
        began_s = time.monotonic()
        while len(rounds) < most_rounds:
            round_began_s = time.monotonic()
            rounds.append(bench.round(fits))
            now_s = time.monotonic()
            report(f"round {len(rounds)}: {now_s - round_began_s:.1f} s")
            if now_s - began_s + (now_s - round_began_s) > budget_s:
                break
    # The first round loads what the others find loaded.
    counted = rounds[1:] if len(rounds) > 2 else rounds
    return BenchResult(
        stages=tuple(_stages(counted)),
        threads=threads_for(config.detector.threads),
        width_px=bench.size_px[0],
        height_px=bench.size_px[1],
        detections=bench.detections,
        compressed_bytes=bench.compressed_bytes,
        notes=tuple(dict.fromkeys(bench.notes)),
        limiting_mag=bench.limiting_mag,
    )


class _Bench:
    """Stages of one machine, with the results of the last round."""

    def __init__(self, cycle: Cycle, scratch: Path) -> None:
        self._cycle = cycle
        self._scratch = scratch
        self.size_px = 0, 0
        self.detections = 0
        self.compressed_bytes = 0
        self.notes: list[str] = []
        self.limiting_mag: float | None = None

    def round(self, fits: bytes) -> Times:
        """Run every stage once; the detector's stages twice, and their mean counts."""
        times: Times = {}
        self._cycle.forget_plate()
        first, frame = self._look(fits, times, "total")
        second, _ = self._look(fits, times, "total refit")
        for name in first:
            times[name] = 0.5 * (first[name] + second[name])
        self._record(frame, times)
        return times

    def _look(self, fits: bytes, times: Times, total: str) -> tuple[Times, Frame]:
        """Process a frame, from its bytes to the fold; the plate solution is timed separately."""
        own: Times = {}
        began_s = time.perf_counter()
        frame = frame_from_bytes(fits, 1, "bench.fits")
        own["read"] = (time.perf_counter() - began_s) * 1e3
        reduction = self._cycle.run(frame, Following()).reduction
        spent_ms = times[total] = (time.perf_counter() - began_s) * 1e3
        own |= reduction.detections.stage_ms
        reduce_ms = sum(reduction.stage_ms.values())
        own["filter"] = max(spent_ms - own["read"] - reduce_ms, 0.0)
        self._plate(reduction, times)
        with time_stage(own, "light"):
            self.limiting_mag = self._cycle.photometry(reduction).limiting_mag
        self.size_px = frame.width_px, frame.height_px
        self.detections = len(reduction.detections.detections)
        if not self.detections:
            self.notes.append("the streak was not detected: following takes a little longer")
        return own, frame

    def _plate(self, reduction: Reduction, times: Times) -> None:
        solution = reduction.solution
        if isinstance(solution, Solution):
            name = "solve" if solution.path == "full" else "refit"
            times[name] = reduction.stage_ms["solve"]
        elif isinstance(solution, NotSolved):
            self.notes.append(f"not solved: {solution.reason}")

    def _record(self, frame: Frame, times: Times) -> None:
        with time_stage(times, "compress"):
            content = compress_frame(frame)
        self.compressed_bytes = len(content)
        with time_stage(times, "read back"):
            frame_from_bytes(content, 1, "bench.fits")
        try:
            if free_bytes(self._scratch) < SPARE_BYTES:
                self.notes.append("the disk is nearly full: writing was not measured")
                return
            path = self._scratch / "frame.fits"
            with time_stage(times, "disk"):
                write_durably(path, content)
            path.unlink()
        except OSError as error:
            self.notes.append(f"the disk was not measured: {error.strerror or error}")


@contextmanager
def _scratch_folder(place: Path) -> Iterator[Path]:
    """Yield a folder on the recording's disk, removed afterwards."""
    remedy = "): give yourself the right to, or set session.root"
    with system_errors_as(SessionError, f"nothing can be written in {place} (", remedy):
        folder = tempfile.TemporaryDirectory(dir=place, prefix=".bench-")
    with folder as name:
        yield Path(name)


def _stages(rounds: list[Times]) -> Iterator[BenchStage]:
    for name in STAGES:
        times_ms = [each[name] for each in rounds if name in each]
        if times_ms:
            yield BenchStage(
                stage=name,
                median_ms=median(times_ms),
                least_ms=min(times_ms),
                largest_ms=max(times_ms),
                repeats=len(times_ms),
            )


SIDEREAL_DEG_S = 15.041 / 3600.0
"""Rate of a geostationary satellite among the stars, and of the mount between frames, deg/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSummary:
    """The times and sizes of one configured cycle, computed from the measured times."""

    exposure_s: float
    cadence_s: float
    processing_s: float
    """Time from the frame's last byte to the slew command, with a full plate solution, s."""
    slew_s: float
    """Time of a slew to a geostationary satellite's next position, settling included, s."""
    shortest_cadence_s: float
    """Shortest cadence at the configured exposure, s."""
    longest_exposure_s: float
    """Longest exposure at the configured cadence, s; negative where none is short enough."""
    recording_s: float | None
    """Time to compress and write a frame, s; None where not measured, or frames are not kept."""
    disk_mb_s: float | None
    frame_mb: float
    """Compressed size of a frame, MB."""
    night_mb: float
    is_held: bool
    is_recorded: bool

    @property
    def is_fast_enough(self) -> bool:
        """True where the machine keeps to the configured cadence and can record all frames."""
        return self.is_held and self.is_recorded


def summarise_bench(
    config: Config, result: BenchResult, free_bytes: int, now_utc_ns: int
) -> BenchSummary:
    """Compute one cycle: shutter, exposure, read-out, processing and slew.

    Recording runs beside the loop but uses the same processor: the machine can record only where
    recording and processing together fit into one cadence.
    """
    exposure, mount = config.exposure, config.mount
    totals_ms = (result.median_ms("total"), result.median_ms("total refit"))
    processing_s = max(ms for ms in totals_ms if ms is not None) / 1e3
    way_deg = exposure.cadence_s * SIDEREAL_DEG_S
    slew_s = SLEW_OVERHEAD_S + way_deg / mount.slew_rate_deg_s + mount.settle_s
    beside_s = exposure.start_latency_s + exposure.readout_s + processing_s + slew_s
    shortest_s = exposure.exposure_s + beside_s
    is_held = shortest_s <= exposure.cadence_s
    disk_ms, compress_ms = result.median_ms("disk"), result.median_ms("compress")
    recording_s = None
    if config.session.keep_frames != "none" and disk_ms is not None and compress_ms is not None:
        recording_s = (disk_ms + compress_ms) / 1e3
    cycle_s = max(exposure.cadence_s, shortest_s)
    outlook = disk_outlook(config, free_bytes, now_utc_ns, float(result.compressed_bytes))
    return BenchSummary(
        exposure_s=exposure.exposure_s,
        cadence_s=exposure.cadence_s,
        processing_s=processing_s,
        slew_s=slew_s,
        shortest_cadence_s=shortest_s,
        longest_exposure_s=exposure.cadence_s - beside_s,
        recording_s=recording_s,
        disk_mb_s=None if not disk_ms else result.compressed_bytes / 1e3 / disk_ms,
        frame_mb=result.compressed_bytes / 1e6,
        night_mb=outlook.bytes_a_night / 1e6,
        is_held=is_held,
        is_recorded=recording_s is None or recording_s + processing_s <= cycle_s,
    )


def summary_lines(summary: BenchSummary) -> list[str]:
    """Return the summary in lines, with what to do where the machine is too slow."""
    sum_words = (
        f"exposure {summary.exposure_s:g} s + processing {summary.processing_s:.2f} s + slew "
        f"{summary.slew_s:.1f} s + shutter and read-out = {summary.shortest_cadence_s:.1f} s"
    )
    what = f"exposures of {summary.exposure_s:g} s every {summary.cadence_s:g} s"
    if summary.is_held:
        spare_s = summary.cadence_s - summary.shortest_cadence_s
        lines = [f"{what}: held, {spare_s:.1f} s to spare ({sum_words})"]
    else:
        lines = [
            f"{what}: NOT held ({sum_words}): set exposure.cadence_s to at least "
            f"{summary.shortest_cadence_s:.1f}, or exposures shorter"
        ]
    longest = f"longest exposure at this cadence {summary.longest_exposure_s:.1f} s"
    if summary.longest_exposure_s <= 0.0:
        longest = "at this cadence there is no time to expose"
    lines.append(f"shortest cadence at this exposure {summary.shortest_cadence_s:.1f} s, {longest}")
    lines.append(_recording_line(summary))
    return lines


def _recording_line(summary: BenchSummary) -> str:
    night = f"up to {summary.night_mb:.0f} MB a night, {summary.frame_mb:.1f} MB a frame"
    if summary.recording_s is None:
        return f"recording: {night}; not measured, or no frames are kept"
    rate = "" if summary.disk_mb_s is None else f"; the disk takes {summary.disk_mb_s:.0f} MB/s"
    words = f"{night}{rate}; {summary.recording_s:.2f} s to compress and write a frame"
    if summary.is_recorded:
        return f"recording: kept up, {words}"
    return (
        f"recording: NOT kept up, {words}: frames would be given up; set session.root to a faster "
        "disk, or session.keep_frames to detected"
    )
