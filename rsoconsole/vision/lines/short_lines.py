"""Short streaks among the lights that the star search finds longer than wide.

Where stars are wide a streak may be three of their widths long: no sum of the line filter stands
out, and the network knows none so short. As a single light it is bright, and its moments give its
direction.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.lines.line_filter import CellLine
from rsoconsole.vision.stars.star_list import StarList

MAX_SHORT, _MAX_WHERE_SHARP = 12, 6
"""Largest numbers of short lines: with wide stars and with sharp ones."""
_ACROSS_FWHM, _SAME_DEG = 1.0, 15.0
"""Distance across, in widths, and turn up to which a light is a piece of a proposed line."""


def short_lines(
    stars: StarList, found: Sequence[CellLine], *, is_sharp: bool = False
) -> list[CellLine]:
    """Return the surest oblong lights of ``stars`` as lines, px.

    At most one lies on a line already in ``found``. ``is_sharp``: stars are sharp; fewer are
    returned.
    """
    most = _MAX_WHERE_SHARP if is_sharp else MAX_SHORT
    lights = stars.oblong
    if lights is None:
        return []
    lines: list[CellLine] = []
    left = [1] * len(found)
    columns = (lights.x_px, lights.y_px, lights.angle_deg, lights.half_px, lights.snr)
    for x, y, angle_deg, half, snr in np.stack(columns, axis=1).tolist():
        fwhm_px = stars.fwhm_at(x, y)
        if any(_is_part(x, y, angle_deg, line, fwhm_px) for line in lines):
            continue
        of_found = [i for i, line in enumerate(found) if _is_part(x, y, angle_deg, line, fwhm_px)]
        if any(left[i] == 0 for i in of_found):
            continue
        for i in of_found:
            left[i] -= 1
        angle = math.radians(angle_deg)
        dx, dy = half * math.cos(angle), half * math.sin(angle)
        lines.append(
            CellLine(x_a=x - dx, y_a=y - dy, x_b=x + dx, y_b=y + dy, snr=snr, is_light=True)
        )
        if len(lines) == most:
            break
    return lines


def interleaved_lines(found: Sequence[CellLine], short: Sequence[CellLine]) -> list[CellLine]:
    """Merge two lists of lines in turn, the best of each first.

    Only a limited number of lines is measured later.
    """
    pairs = itertools.zip_longest(found, short)
    return [line for pair in pairs for line in pair if line is not None]


def _is_part(x: float, y: float, angle_deg: float, line: CellLine, fwhm_px: float) -> bool:
    dx, dy = line.x_b - line.x_a, line.y_b - line.y_a
    length = max(math.hypot(dx, dy), 1e-6)
    off_x, off_y = x - 0.5 * (line.x_a + line.x_b), y - 0.5 * (line.y_a + line.y_b)
    along, across = abs(off_x * dx + off_y * dy) / length, abs(off_y * dx - off_x * dy) / length
    turn = line_angle_deg(angle_deg, math.degrees(math.atan2(dy, dx)) % 180.0)
    is_near = across < _ACROSS_FWHM * fwhm_px and along < 0.5 * length + fwhm_px
    return is_near and turn < _SAME_DEG
