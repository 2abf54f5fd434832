"""Drift of the stars through frames between which the mount was only to track them. Pure."""

import math

from rsoconsole.records import Solution
from rsoconsole.sky import separation_deg, wrap_180

MIN_RATE_ARCSEC_S, MIN_WAY_ARCSEC = 1.0, 10.0
"""Least rate and way of a drift that no mount's own error explains: worm gears, polar axes and
settling give some tenths of an arcsecond a second."""
MAX_RATE_ARCSEC_S = 72.0
"""Rate above which somebody has moved the mount: see ``FAST_DEG_S`` of a mount's motion."""
MAX_APART_S = 300.0
"""Longest time between two frames: beyond it a mount's slow errors add up."""
_AGAIN = 1.5
"""Factor between rates from which on another one is said."""
_NS = 1e9


class StarDrift:
    """Compares the plates of successive frames with the motion that was ordered: sidereal."""

    def __init__(self) -> None:
        self._moves = 0
        """Number of orders to move, and of moves by others, so far."""
        self._taken: tuple[int, int, int] = (0, 0, 0)
        """Frame, mid-exposure (UTC ns) and number of moves of the last frame taken."""
        self._solved: tuple[Solution, int, int] | None = None
        """Plate, mid-exposure and number of moves of the last solved frame."""
        self._said_arcsec_s = 0.0

    def note_move(self) -> None:
        """Note that the telescope moves, or was moved, otherwise than with the stars."""
        self._moves += 1

    def note_frame(self, frame_id: int, t_mid_utc_ns: int) -> None:
        """Note a frame that was taken without a move since the last ``note_move``."""
        self._taken = frame_id, t_mid_utc_ns, self._moves

    def drift_words(self, solution: Solution) -> str | None:
        """Return what the stars show of a solved frame and the one before; None: no drift, or said.

        Frames with a move between them are not compared.
        """
        before, (frame_id, t_mid_utc_ns, moves) = self._solved, self._taken
        if solution.frame_id != frame_id:
            return None
        self._solved = solution, t_mid_utc_ns, moves
        if before is None or before[2] != moves:
            return None
        first, first_utc_ns, _ = before
        apart_s = (t_mid_utc_ns - first_utc_ns) / _NS
        if not 0.0 < apart_s <= MAX_APART_S:
            return None
        here, there = ((plate.ra_icrs_deg, plate.dec_icrs_deg) for plate in (solution, first))
        way_arcsec = 3600.0 * separation_deg(*here, *there)
        rate_arcsec_s = way_arcsec / apart_s
        is_of_mount = MIN_RATE_ARCSEC_S <= rate_arcsec_s <= MAX_RATE_ARCSEC_S
        if not is_of_mount or way_arcsec < MIN_WAY_ARCSEC:
            self._said_arcsec_s = 0.0
            return None
        if self._said_arcsec_s / _AGAIN < rate_arcsec_s < self._said_arcsec_s * _AGAIN:
            return None
        self._said_arcsec_s = rate_arcsec_s
        cos_dec = math.cos(math.radians(here[1]))
        east = 3600.0 * float(wrap_180(here[0] - there[0])) * cos_dec / apart_s
        north = 3600.0 * (here[1] - there[1]) / apart_s
        return (
            f"the mount drifts by {rate_arcsec_s:.1f}″/s against the stars ({east:+.1f}″/s RA·cosδ,"
            f" {north:+.1f}″/s δ), by frames {first.frame_id} and {solution.frame_id}: it was to"
            " track them. Look at its tracking rate and its alignment"
        )
