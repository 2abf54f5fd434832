"""What becomes of a frame on its way: delivered, late, failed, or never heard of."""

from typing import Literal

from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.simulator.world import FramesWorld

_STREAM = 37
Fate = Literal["delivered", "late", "failed", "dropped"]


def frame_fate(world: FramesWorld, seed: int, t_start_utc_ns: int) -> Fate:
    """The fate of the frame begun then; each at its stated rate."""
    rates: tuple[tuple[Fate, float], ...] = (
        ("dropped", world.dropped_rate),
        ("failed", world.failed_rate),
        ("late", world.late_rate),
    )
    if not any(rate for _, rate in rates):
        return "delivered"
    lot = frame_rng(seed, t_start_utc_ns, _STREAM).random()
    for fate, rate in rates:
        if lot < rate:
            return fate
        lot -= rate
    return "delivered"
