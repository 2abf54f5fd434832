"""A frame's streaks as a DS9 region file, in ICRS degrees.

Red lines are streaks that the track took, yellow ones others; circles stand on their ends, a cross
on the measured midpoint, and the green dashed ellipse is where the track expected its object, 3
sigma. DS9 counts an ellipse's angle from its first axis, which at angle 0 lies along right
ascension, anticlockwise with north up and east left. Source of the form: the DS9 reference manual.
"""

import math
import re

import numpy as np

from rsoconsole.export.frames import FrameOnRecord
from rsoconsole.export.rows import MeasuredRow
from rsoconsole.records import TrackState
from rsoconsole.sky import wrap_360
from rsoconsole.tracking.filters import sky_covariance_arcsec2

HEAD = (
    "# Region file format: DS9 version 4.1\n"
    'global font="helvetica 10 normal roman" select=1 edit=0 move=0 delete=1 include=1\n'
    "icrs\n"
)
SIGMAS = 3.0
END_ARCSEC = 3.0
SMALLEST_ARCSEC = 0.01


def to_regions(frame: FrameOnRecord) -> str:
    """The file's text; a frame without anything to show gives its head alone."""
    lines = [line for row in frame.rows for line in _streak(row)]
    if frame.predicted is not None:
        lines.append(_ellipse(frame.predicted))
    return HEAD + "".join(line + "\n" for line in lines)


def _streak(row: MeasuredRow) -> list[str]:
    colour = "red" if row.is_taken else "yellow"
    words = f"{'taken' if row.is_taken else row.not_taken_because or 'not followed'}"
    text = _braced(f"{row.confidence:.2f} {words}")
    lines = []
    a, b = (row.ra_a_icrs_deg, row.dec_a_icrs_deg), (row.ra_b_icrs_deg, row.dec_b_icrs_deg)
    if a[0] is not None and a[1] is not None and b[0] is not None and b[1] is not None:
        ends = f"{_place(a[0], a[1])},{_place(b[0], b[1])}"
        lines.append(f"line({ends}) # line=0 0 color={colour} text={text}")
        for ra_deg, dec_deg in ((a[0], a[1]), (b[0], b[1])):
            lines.append(f'circle({_place(ra_deg, dec_deg)},{END_ARCSEC:.1f}") # color={colour}')
    lines.append(f"point({_place(row.ra_icrs_deg, row.dec_icrs_deg)}) # point=cross color={colour}")
    return lines


def _ellipse(state: TrackState) -> str:
    covariance = sky_covariance_arcsec2(state)
    variances, axes = np.linalg.eigh(covariance)
    east, north = axes[:, 1]
    position_angle_deg = math.degrees(math.atan2(east, north))
    long_arcsec, short_arcsec = (
        max(SIGMAS * math.sqrt(max(float(v), 0.0)), SMALLEST_ARCSEC) for v in variances[::-1]
    )
    angle_deg = wrap_360(position_angle_deg + 90.0) % 180.0
    return (
        f'ellipse({_place(state.x[0], state.x[2])},{long_arcsec:.3f}",{short_arcsec:.3f}",'
        f"{angle_deg:.3f}) # color=green dash=1 text={_braced('predicted, 3 sigma')}"
    )


def _place(ra_deg: float, dec_deg: float) -> str:
    return f"{wrap_360(ra_deg):.8f},{dec_deg:+.8f}"


def _braced(text: str) -> str:
    """As DS9 writes text: in braces, which cannot stand inside, nor anything beyond ASCII."""
    plain = text.encode("ascii", "replace").decode()
    return "{" + re.sub(r"[{}\s]+", " ", plain).strip() + "}"
