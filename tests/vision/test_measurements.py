"""What becomes of one light that the star search proposes, drawn by NumPy alone."""

import math

import numpy as np

from rsoconsole.records import Frame
from rsoconsole.vision import PointImage, find_stars, local_background
from rsoconsole.vision.detector._candidates import FrameCandidates, merged_proposals
from rsoconsole.vision.lines.line_filter import CellLine
from tests.drawn.drawn_lines import exposed, line_of_light

SHAPE = (300, 400)
SIGMA_PX = 1.2
FWHM_PX = 2.3548 * SIGMA_PX


def measured(light, *lines: CellLine) -> FrameCandidates:
    """Everything that is proposed, in its order."""
    pixels = exposed(light, np.random.default_rng(4))
    frame = Frame(frame_id=1, name="drawn", pixels=pixels, exposure_s=10.0)
    sky = local_background(pixels)
    it = FrameCandidates(frame, sky, find_stars(pixels, sky), PointImage(fwhm_px=FWHM_PX))
    for each in merged_proposals([], lines):
        if not it.has(each):
            it.measure(each)
    return it


def about(x: float, y: float, length_px: float, angle_deg: float = 0.0, **more) -> CellLine:
    dx = 0.5 * length_px * math.cos(math.radians(angle_deg))
    dy = 0.5 * length_px * math.sin(math.radians(angle_deg))
    return CellLine(x_a=x - dx, y_a=y - dy, x_b=x + dx, y_b=y + dy, snr=30.0, **more)


def test_a_short_light_is_measured_where_it_is_not_on_its_brighter_neighbour():
    faint = line_of_light(SHAPE, (188.0, 150.0, 212.0, 150.0), SIGMA_PX)
    bright = line_of_light(SHAPE, (180.0, 157.5, 220.0, 157.5), SIGMA_PX)
    light = 500.0 * faint + 2500.0 * bright
    (as_light,) = measured(light, about(200.0, 150.0, 20.0, is_light=True)).taken
    assert abs(as_light.found.y_px - 150.0) < 0.5
    # What the line filter proposes may be as far off as its cells are large.
    (as_line,) = measured(light, about(200.0, 150.0, 20.0)).taken
    assert abs(as_line.found.y_px - 157.5) < 0.5


def test_a_piece_of_what_is_measured_is_not_measured_again():
    light = 500.0 * line_of_light(SHAPE, (120.0, 100.0, 280.0, 200.0), SIGMA_PX)
    whole = about(200.0, 150.0, 180.0, math.degrees(math.atan2(100.0, 160.0)))
    piece = about(170.0, 131.0, 20.0, 32.0, is_light=True)
    elsewhere = about(170.0, 181.0, 20.0, 32.0, is_light=True)
    it = measured(light, whole)
    of_piece, of_other = merged_proposals([], [piece, elsewhere])
    assert it.has(of_piece)
    assert not it.has(of_other)
    # A sum of the line filter is looked at for itself.
    (as_sum,) = merged_proposals([], [about(170.0, 131.0, 20.0, 32.0)])
    assert not it.has(as_sum)
