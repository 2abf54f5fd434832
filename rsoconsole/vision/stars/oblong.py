"""Lights that are longer than they are wide, or not drawn out as the stars are.

Blends, stars that are not quite round and galaxies are among them, pieces of streaks, and whole
streaks that are short.
"""

from dataclasses import dataclass

from rsoconsole.records import FloatArray

MOST_OBLONG = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Oblong:
    """One entry a light, the surest first."""

    x_px: FloatArray
    y_px: FloatArray
    angle_deg: FloatArray
    """x towards y, 0 to 180."""
    half_px: FloatArray
    """Half its length, roughly; what is longer than a few widths of a star may be longer still."""
    snr: FloatArray
