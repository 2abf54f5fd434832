"""Johnson magnitudes from Tycho-2's: approximate and linear, valid for -0.2 < BT - VT < 1.8.

Source: Tycho-2's documentation (CDS I/259, note 7); ESA SP-1200 vol. 1, section 1.3.
"""

from typing import TypeVar

from rsoconsole.records import FloatArray

JOHNSON_MIN_COLOUR_MAG, JOHNSON_MAX_COLOUR_MAG = -0.2, 1.8
"""BT - VT between which the relations hold."""

Mag = TypeVar("Mag", float, FloatArray)


def johnson_v_mag(vt_mag: Mag, colour_mag: Mag) -> Mag:
    """Johnson V of a star of Tycho VT and colour BT - VT, mag; NaN where the colour is."""
    return vt_mag - 0.090 * colour_mag


def johnson_b_minus_v_mag(colour_mag: Mag) -> Mag:
    """Johnson B - V of a star of colour BT - VT, mag."""
    return 0.850 * colour_mag
