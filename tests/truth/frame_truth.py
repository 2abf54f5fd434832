"""What the simulated observatory wrote of its frames, read back."""

import json

from rsoconsole.simulator.camera.truth import FrameTruth, SatelliteTruth, TrafficTruth


def truth_from_json(text: str) -> FrameTruth:
    """The record that ``FrameTruth.to_json`` wrote."""
    table = json.loads(text)
    satellites = tuple(SatelliteTruth(**each) for each in table.pop("satellites"))
    traffic = tuple(
        TrafficTruth(
            kind=each["kind"], start_px=tuple(each["start_px"]), end_px=tuple(each["end_px"])
        )
        for each in table.pop("traffic")
    )
    return FrameTruth(**table, satellites=satellites, traffic=traffic)
