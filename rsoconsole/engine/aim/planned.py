"""What is planned: the next exposure, and a place where the telescope might go."""

from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.engine.aim.instrument_controller import NS
from rsoconsole.engine.aim.search import Direction
from rsoconsole.reasons import SlewRefusal
from rsoconsole.records import SlewCommand

IsRefused = Callable[[SlewCommand, int], SlewRefusal | None]
"""Why the limits forbid a slew, held there until an instant; None when they do not."""

SLEW_OVERHEAD_S = 3.0
"""What a slew is assumed to take beside its way and settling: a slow mount is waited for."""

FLIP_WAY_DEG = 190.0
"""How far the declination axis turns to change sides near the equator; the other a little less."""

CLOCKS_APART_NS = 10 * NS


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The next exposure."""

    t_start_utc_ns: int
    t_mid_utc_ns: int
    slew: SlewCommand | None
    refused: tuple[tuple[SlewCommand, SlewRefusal], ...] = ()
    """Slews that were wanted and why they are not done; each place is named once, but all of
    them where nothing is left to search."""
    blocked: SlewRefusal | None = None
    """Why the telescope does not go where the track is; None when nothing keeps it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ahead:
    """Where the exposure after the planned one would look, as things stand now."""

    direction: Direction
    lead: Direction
    """Where the lead then is."""
    t_mid_utc_ns: int
    reason: str
    is_slew: bool
    """Whether the mount would move for it."""
    way_deg: float
    """From where it looks before."""
