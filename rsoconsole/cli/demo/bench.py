"""``doctor --bench``: measures the exposure and cadence that this machine can hold."""

from dataclasses import asdict
from typing import Any

from rsoconsole.cli.words import output
from rsoconsole.config import Config
from rsoconsole.words import NS_PER_S, count_words, utc_ns_to_iso

_BESIDE_DEG = 0.05
"""Error of the header's direction, like that of a mount."""
BUSY_SHARE = 0.5
"""Fraction of cores busy with other programs above which the figures are too pessimistic."""


def run_bench(config: Config, *, json_: bool) -> None:
    """Measure this machine; exit 1 if it cannot hold the configured exposure and cadence."""
    from rsoconsole.engine import (
        STAGES,
        free_bytes,
        load_share,
        machine_identity,
        read_machine,
        read_recording_medium,
        run_benchmark,
        summarise_bench,
        summary_lines,
        troubles_of,
    )
    from rsoconsole.instruments import utc_now_ns

    here, busy, before = machine_identity(), load_share(), read_machine()
    medium = read_recording_medium(config.session.root)
    output.print_to_stderr(
        f"drawing a frame of {config.optics.width_px} x {config.optics.height_px} px"
    )
    fits = draw_bench_frame(config)
    result = run_benchmark(config, fits, report=output.print_to_stderr)
    after = read_machine()
    summary = summarise_bench(config, result, free_bytes(config.session.root), utc_now_ns())
    notes = list(result.notes)
    if busy > BUSY_SHARE:
        notes.append(f"other programs had {busy:.0%} of the cores when it began: repeat it alone")
    notes += [f"{trouble.words}: {trouble.remedy}" for trouble in troubles_of(after)]
    if json_:
        machine: dict[str, Any] = asdict(here) | {
            "threads": result.threads,
            "load_share": busy,
            "temperature_before_c": before.cpu_temperature_c,
            "temperature_after_c": after.cpu_temperature_c,
            "recording_medium": medium.kind,
            "width_px": result.width_px,
            "height_px": result.height_px,
            "detections": result.detections,
            "limiting_mag": result.limiting_mag,
            "notes": notes,
        }
        output.emit_json({"kind": "machine", **machine})
        for stage in result.stages:
            output.emit_json({"kind": "stage", **asdict(stage)})
        output.emit_json({"kind": "verdict", **asdict(summary), "ok": summary.is_fast_enough})
    else:
        output.say(here.words)
        output.say(
            f"{result.width_px} x {result.height_px} px, {count_words(result.threads, 'thread')}, "
            f"{count_words(result.detections, 'streak')} detected, {_depth(result.limiting_mag)}"
            "session.root on "
            f"{medium.kind}{f' {medium.device}' if medium.device else ''}"
            + _heat(before.cpu_temperature_c, after.cpu_temperature_c)
        )
        output.say("the frame is drawn as of a 12-bit camera; 16 bits take about twice the disk")
        output.say(f"{'stage':12} {'median':>9} {'least':>9} {'largest':>9}  ms")
        for stage in result.stages:
            output.say(
                f"{stage.stage:12} {stage.median_ms:9.1f} {stage.least_ms:9.1f} "
                f"{stage.largest_ms:9.1f}  {STAGES[stage.stage]}"
            )
        output.say(f"rounds counted: {max(stage.repeats for stage in result.stages)}")
        output.say(*summary_lines(summary), *(f"note: {note}" for note in notes))
    output.exit_if(not summary.is_fast_enough, "this machine does not hold what is configured")


def _depth(limiting_mag: float | None) -> str:
    return "" if limiting_mag is None else f"stars to {limiting_mag:.1f} mag, "


def _heat(before_c: float | None, after_c: float | None) -> str:
    if before_c is None or after_c is None:
        return ""
    return f", {before_c:.0f} °C before and {after_c:.0f} after"


def draw_bench_frame(config: Config) -> bytes:
    """Return a simulated frame of the configured optics and exposure as a FITS file's bytes.

    A satellite is in its middle.
    """
    import numpy as np

    from rsoconsole.orbits import Satellite
    from rsoconsole.simulator import DEFAULT_SCENARIO, Card, Scene, fits_bytes, scenario_named

    optics, exposure_s = config.optics, config.exposure.exposure_s
    scene = Scene(scenario_named(DEFAULT_SCENARIO), seed=1, optics=optics)
    # Its own brightness changes begin later in this night.
    t_start_utc_ns = scene.scenario.t_start_utc_ns + 60 * NS_PER_S
    t_mid = np.array([t_start_utc_ns + round(exposure_s * NS_PER_S / 2)])
    target = scene.scenario.target
    assert target is not None
    place = Satellite(target.element_set, target.standard_magnitude).astrometric_place(
        scene.site, t_mid
    )
    ra_deg, dec_deg = float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0])
    pixels, _ = scene.expose(ra_deg, dec_deg, 2.0, False, t_start_utc_ns, exposure_s)
    cards: dict[str, Card] = {
        "EXPTIME": exposure_s,
        "DATE-OBS": utc_ns_to_iso(t_start_utc_ns, 6).rstrip("Z"),
        "XPIXSZ": optics.pixel_um,
        "YPIXSZ": optics.pixel_um,
        "FOCALLEN": optics.focal_length_mm,
        "RA": ra_deg + _BESIDE_DEG,
        "DEC": dec_deg + _BESIDE_DEG,
        "INSTRUME": "bench",
        "FRAME": "Light",
    }
    return bytes(fits_bytes(pixels, cards))
