"""What a recorded frame would have shown under another tau or header latency. Pure."""

from dataclasses import replace

from rsoconsole.config import Config, ExposureConfig
from rsoconsole.pipeline.cycle import Shown
from rsoconsole.pipeline.frame import at_its_row, measure, shutter_time
from rsoconsole.reasons import BelowTau
from rsoconsole.records import Rejection, Solution, measurement_id_of


def at_instant(shown: Shown, t_mid_utc_ns: int, exposure: ExposureConfig) -> Shown:
    """The same measurements at the frame's mid-exposure: another where its latency is tried."""
    shutter = shutter_time(shown.taken, exposure)
    moved = tuple(at_its_row(m, t_mid_utc_ns, shutter) for m in shown.measurements)
    return shown if moved == shown.measurements else replace(shown, measurements=moved)


def at_tau(shown: Shown, config: Config) -> Shown:
    """What the frame would have shown at the configured tau, most confident first.

    The detector keeps what passed its gates and lay below tau, so nothing is guessed; without a
    plate solution a candidate is detected and not measured, as ever.
    """
    tau = config.detector.tau
    found = shown.detections
    numbered = {
        number: r.detection
        for number, r in enumerate(found.rejected, start=len(found.detections))
        if isinstance(r.reason, BelowTau) and r.detection.confidence > tau
    }
    admitted = list(numbered.values())
    kept = [d for d in found.detections if d.confidence > tau]
    too_faint = [
        Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=tau))
        for d in found.detections
        if d.confidence <= tau
    ]
    measurements = [m for m in shown.measurements if m.source == "operator" or m.confidence > tau]
    if isinstance(shown.solution, Solution):
        made = (
            measure(
                detection,
                shown.solution,
                shown.taken,
                config.exposure,
                measurement_id=measurement_id_of(found.frame_id, number),
            )
            for number, detection in numbered.items()
        )
        measurements += [m for m in made if m is not None]
    # Sorting is stable: what was measured keeps its order.
    detections = sorted((*kept, *admitted), key=lambda d: -d.confidence)
    rejected = [r for r in found.rejected if r.detection not in admitted]
    rejected = sorted((*rejected, *too_faint), key=lambda r: -r.detection.confidence)
    return replace(
        shown,
        detections=replace(found, detections=tuple(detections), rejected=tuple(rejected)),
        measurements=tuple(sorted(measurements, key=lambda m: -m.confidence)),
    )
