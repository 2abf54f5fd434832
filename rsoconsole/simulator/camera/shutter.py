"""When a frame was really exposed, and what its header and its operator say of that.

Four clocks meet here. The camera's driver notes the start of an exposure by the observatory's
clock and writes it into DATE-OBS, cut down where the world says so. The shutter opens later than
that (latency, bias, scatter), and the observatory's clock is not UTC. What is true of a
measurement is where the satellite was at the instant that the measurement names, by UTC: every
error of time is one of place, as in reality.
"""

from dataclasses import dataclass

from rsoconsole.simulator.world import World

NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueShutter:
    """What really happened."""

    t_open_utc_ns: int
    """Opening of the first row, true UTC."""
    line_time_s: float
    """Each row is exposed so much after the row above."""


def header_start_utc_ns(world: World, t_start_utc_ns: int) -> int:
    """What DATE-OBS says of an exposure that the driver began at this instant of its own clock."""
    step_ns = round(world.shutter.round_s * NS)
    return t_start_utc_ns if step_ns == 0 else t_start_utc_ns // step_ns * step_ns


def reported_start_utc_ns(world: World, t_start_utc_ns: int) -> int:
    """The opening as an operator has it who knows the header and the camera's latency."""
    return header_start_utc_ns(world, t_start_utc_ns) + round(world.known_latency_s * NS)


def clock_offset_s(world: World, t_utc_ns: int, t_night_utc_ns: int) -> float:
    """True UTC minus the observatory's clock, when that shows ``t_utc_ns``."""
    since_s = (t_utc_ns - t_night_utc_ns) / NS
    return world.clock.offset_s + world.clock.drift_ppm * 1e-6 * since_s


def scatter_sigma_s(world: World, own_s: float) -> float:
    """One sigma of the opening from frame to frame; ``own_s`` where the world does not say."""
    return own_s if world.shutter.scatter_s is None else world.shutter.scatter_s


def true_shutter(
    world: World, scatter_s: float, t_start_utc_ns: int, t_night_utc_ns: int
) -> TrueShutter | None:
    """What really happened when the driver began at ``t_start_utc_ns`` by the observatory's clock.

    None where no setting speaks of time: a scatter of milliseconds then is a shift along the
    streak.
    """
    shutter = world.shutter
    later_s = shutter.latency_s + shutter.bias_s
    later_s += clock_offset_s(world, t_start_utc_ns, t_night_utc_ns)
    is_plain = shutter.scatter_s is None and shutter.round_s == shutter.line_time_us == 0.0
    if is_plain and later_s == 0.0:
        return None
    return TrueShutter(
        t_open_utc_ns=t_start_utc_ns + round((later_s + scatter_s) * NS),
        line_time_s=shutter.line_time_us * 1e-6,
    )
