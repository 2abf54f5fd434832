"""What measured times mean for a night: which cadence the machine holds, what the disk takes."""

from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.engine.aim import SLEW_OVERHEAD_S
from rsoconsole.engine.doctor.bench import BenchResult
from rsoconsole.engine.machine import disk_outlook

SIDEREAL_DEG_S = 15.041 / 3600.0
"""What a satellite that keeps its slot moves among the stars, and the mount from frame to frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSummary:
    """One configured cycle, added up with what was measured."""

    exposure_s: float
    cadence_s: float
    processing_s: float
    """Last byte to slew command, solved in full."""
    slew_s: float
    """To where a satellite in its slot will be, settled."""
    shortest_cadence_s: float
    """At the configured exposure."""
    longest_exposure_s: float
    """At the configured cadence; negative where even none would be in time."""
    recording_s: float | None
    """To compress and write a frame; None where it was not measured, or none is kept."""
    disk_mb_s: float | None
    frame_mb: float
    """Compressed."""
    night_mb: float
    is_held: bool
    is_recorded: bool

    @property
    def is_enough(self) -> bool:
        """Whether the machine holds what is configured."""
        return self.is_held and self.is_recorded


def judge(config: Config, result: BenchResult, free_bytes: int, now_utc_ns: int) -> BenchSummary:
    """Add a cycle up: shutter, exposure, read-out, processing, slew.

    The recording runs beside the loop, but it shares the processor: it counts as kept up only
    where it and the processing fit into one cadence together.
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
    """For a person to read, with what to do where it is not enough."""
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
