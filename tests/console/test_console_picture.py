"""The pictures in cells: where a mark lies, what a close-up shows, how light becomes grey."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.console.picture.marks import (
    OUTLINE_POINTS,
    Mark,
    Window,
    frame_marks,
    mark_characters,
)
from rsoconsole.console.picture.picture import (
    GREYS,
    STRETCHES,
    Picture,
    draw_closeup,
    draw_field,
    preview_light,
)
from rsoconsole.engine.tasks.preview import CLOSEUP_PX, cut_closeup
from rsoconsole.night import NightFrame, uncertainty_ellipse_px
from rsoconsole.records import Closeup, Detections, NotAStreak, Rejection, Solution, TrackState, Wcs
from rsoconsole.sky import pixel_to_sky, separation_deg
from tests.makers import straight_detection

WIDE, HIGH = 4656, 3520
SCALE_DEG = 1.264 / 3600.0
NOISE = 12.0


def solution(ra: float = 150.0, dec: float = -5.0) -> Solution:
    wcs = Wcs(
        crpix_x_px=(WIDE - 1) / 2,
        crpix_y_px=(HIGH - 1) / 2,
        crval_ra_deg=ra,
        crval_dec_deg=dec,
        cd=(-SCALE_DEG, 0.0, 0.0, SCALE_DEG),
    )
    return Solution(
        frame_id=1,
        wcs=wcs,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        scale_arcsec_px=1.264,
        rotation_deg=0.0,
        is_flipped=False,
        matched=40,
        rms_arcsec=0.3,
        path="known",
        ms=4.0,
    )


def track(ra: float, dec: float, east_arcsec: float, north_arcsec: float) -> TrackState:
    cos_dec = math.cos(math.radians(dec))
    diagonal = [(east_arcsec / 3600 / cos_dec) ** 2, 1e-12, (north_arcsec / 3600) ** 2, 1e-12]
    return TrackState(
        track_id=1,
        kind="predicted",
        frame_id=1,
        t_utc_ns=1,
        x=(ra, 0.0, dec, 0.0),
        P=tuple(tuple(float(v) for v in row) for row in np.diag(diagonal)),
    )


def picture_of(angle_deg: float = 0.0, **other) -> Picture:
    """A dark frame with one streak, and its close-up."""
    rng = np.random.default_rng(2)
    streak = straight_detection(x_px=2000.0, y_px=1500.0, angle_deg=angle_deg)
    found = Detections(frame_id=1, width_px=WIDE, height_px=HIGH, detections=(streak,), **other)
    detail = NightFrame(detections=found)
    codes = rng.normal(60, NOISE, (440, 582)).clip(0, 255).astype(np.uint8)
    pixels = rng.normal(1000, 30, (HIGH, WIDE)).astype(np.float32)
    for at in np.linspace(-59, 59, 400):
        x = 2000 + at * math.cos(math.radians(angle_deg))
        y = 1500 + at * math.sin(math.radians(angle_deg))
        pixels[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2] = 1400
    (x0, y0), closeup = cut_closeup(pixels, 2000.0, 1500.0)
    place = Closeup(frame_id=1, x0_px=x0, y0_px=y0, width_px=256, height_px=192)
    return Picture(
        frame_id=1,
        codes=codes,
        light=preview_light(codes),
        detail=detail,
        marks=frame_marks(detail),
        closeup=closeup,
        place=place,
    )


@given(st.floats(-50.0, 5000.0), st.floats(-50.0, 4000.0))
def test_a_close_up_lies_in_the_frame_and_about_its_place(x_px, y_px):
    pixels = np.zeros((300, 400), np.uint16)
    (x0, y0), piece = cut_closeup(pixels, x_px, y_px)
    assert piece.shape == CLOSEUP_PX[::-1]
    assert 0 <= x0 <= 400 - 256
    assert 0 <= y0 <= 300 - 192
    if 128 <= x_px <= 271:
        assert abs(x0 + 128 - x_px) <= 0.5
    if 96 <= y_px <= 203:
        assert abs(y0 + 96 - y_px) <= 0.5


def test_a_small_frame_is_its_own_close_up():
    (x0, y0), piece = cut_closeup(np.zeros((100, 120), np.float32), 60.0, 50.0)
    assert (x0, y0, piece.shape) == (0, 0, (100, 120))


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0])
@pytest.mark.parametrize("cells", [(40, 14), (62, 11), (84, 22)])
def test_the_streak_of_a_close_up_is_seen_whole_between_its_brackets(angle_deg, cells):
    picture = picture_of(angle_deg)
    drawing = draw_closeup(picture, "streaks", *cells)
    assert drawing is not None
    window = drawing.window
    written = mark_characters(picture.marks, window)
    for bracket, beside, (x, y) in zip("()", (-1, 1), picture.marks[0].ends_px, strict=True):
        column, row = window.cell(x, y)
        assert window.has(column, row)
        assert (column, row) not in written
        if angle_deg < 90.0:
            assert written[column + beside, row][0] == bracket
    # The brightest parts of cells are the streak's.
    rows, columns = np.nonzero(drawing.greys >= GREYS - 2)
    squares = drawing.px_per_square
    part_rows, part_columns = drawing.greys.shape
    x_px = window.x0_px + (columns + 0.5) * window.width_px / part_columns - 2000.0
    y_px = window.y0_px + (rows + 0.5) * window.height_px / part_rows - 1500.0
    across = -x_px * math.sin(math.radians(angle_deg)) + y_px * math.cos(math.radians(angle_deg))
    assert np.median(np.abs(across)) <= 2.0 + squares


def test_pixel_by_pixel_a_square_is_a_pixel():
    picture = picture_of()
    drawing = draw_closeup(picture, "linear", 62, 11, is_native=True)
    assert drawing is not None
    assert drawing.px_per_square == 1.0
    assert drawing.window.width_px == 62.0
    assert drawing.window.height_px == 22.0


def test_without_a_close_up_there_is_none():
    picture = picture_of()
    bare = Picture(
        frame_id=1, codes=picture.codes, light=picture.light, detail=picture.detail, closeup=None
    )
    assert draw_closeup(bare, "streaks", 40, 10) is None


@pytest.mark.parametrize("stretch", STRETCHES)
def test_every_stretch_keeps_the_order_of_light(stretch):
    picture = picture_of()
    codes = picture.codes.copy()
    codes[200:230, 300:330] = 250
    bright = Picture(frame_id=1, codes=codes, light=preview_light(codes), detail=picture.detail)
    drawing = draw_field(bright, stretch, 60, 20)
    rows, columns = drawing.greys.shape
    column, row = round(315 / 582 * columns), round(215 / 440 * rows)
    assert drawing.greys[row, column] == drawing.greys.max()
    assert drawing.greys.max() == GREYS - 1
    assert np.median(drawing.greys) < GREYS / 2


def test_noise_alone_is_not_drawn_up():
    codes = np.full((440, 582), 60, np.uint8)
    dark = Picture(frame_id=1, codes=codes, light=preview_light(codes), detail=NightFrame())
    assert draw_field(dark, "streaks", 60, 20).greys.max() <= 3


@pytest.mark.parametrize(("east", "north"), [(60.0, 20.0), (10.0, 200.0)])
def test_the_outline_is_where_three_sigma_lie_on_the_sky(east, north):
    plate, dec = solution(dec=-40.0), -40.01
    points = uncertainty_ellipse_px(track(150.02, dec, east, north), plate, OUTLINE_POINTS)
    away = []
    for x, y in points:
        ra, d = (float(v) for v in pixel_to_sky(plate.wcs, x, y))
        e = (ra - 150.02) * math.cos(math.radians(dec)) * 3600.0 / (3.0 * east)
        n = (d - dec) * 3600.0 / (3.0 * north)
        away.append(math.hypot(e, n))
    assert np.allclose(away, 1.0, atol=0.01)
    ra, d = pixel_to_sky(plate.wcs, *points[0])
    assert separation_deg(150.02, dec, float(ra), float(d)) > 0.0


def test_the_outline_is_drawn_where_it_is_larger_than_a_cell():
    detail = NightFrame(
        detections=Detections(frame_id=1, width_px=WIDE, height_px=HIGH, detections=()),
        solution=solution(),
        predicted=track(150.0, -5.0, 300.0, 300.0),
    )
    window = Window(x0_px=-0.5, y0_px=-0.5, width_px=WIDE, height_px=HIGH, columns=60, rows=20)
    cells = mark_characters(frame_marks(detail), window)
    signs = [sign for sign, kind in cells.values() if kind == "predicted"]
    assert signs.count("+") == 1
    assert signs.count("·") >= 20
    small = Mark(x_px=100.0, y_px=100.0, kind="predicted", outline_px=((100.0, 101.0),))
    assert mark_characters((small,), window) == {window.cell(100.0, 100.0): ("+", "predicted")}


def test_rejected_candidates_are_pointed_at_only_from_near():
    no = Rejection(detection=straight_detection(confidence=0.07), reason=NotAStreak(kind="no line"))
    never = Rejection(
        detection=straight_detection(confidence=0.001), reason=NotAStreak(kind="no line")
    )
    found = Detections(
        frame_id=1, width_px=WIDE, height_px=HIGH, detections=(), rejected=(no, never)
    )
    marks = frame_marks(NightFrame(detections=found))
    assert [(mark.kind, mark.label) for mark in marks] == [("rejected", ".07")]
    window = Window(x0_px=0.0, y0_px=0.0, width_px=600.0, height_px=400.0, columns=60, rows=20)
    assert mark_characters(marks, window) == {}
    assert {sign for sign, _ in mark_characters(marks, window, has_rejected=True).values()} >= {
        "‹",
        "›",
    }


def test_signs_stand_beside_a_streak_and_never_on_it():
    """Brackets, cross and outline: what one looks for is not written over."""
    window = Window(x0_px=0.0, y0_px=0.0, width_px=600.0, height_px=400.0, columns=60, rows=20)
    ends = ((200.0, 200.0), (320.0, 200.0))
    streak = Mark(x_px=260.0, y_px=200.0, kind="followed", ends_px=ends, label=".97")
    turns = np.linspace(0.0, 2 * np.pi, 72)
    outline = tuple((260.0 + 60 * math.cos(t), 200.0 + 30 * math.sin(t)) for t in turns)
    expected = Mark(x_px=260.0, y_px=200.0, kind="predicted", outline_px=outline)
    written = mark_characters((streak, expected), window)
    on_it = {window.cell(x, 200.0) for x in np.linspace(200.0, 320.0, 200)}
    assert not on_it & set(written)
    column, row = window.cell(260.0, 200.0)
    assert written[column, row - 1] == ("▾", "predicted")
    assert written[column, row + 1] == ("▴", "predicted")
    assert written[19, 10][0] == "["
    assert written[33, 10][0] == "]"


@pytest.mark.parametrize(
    ("ends", "written"),
    [
        ((100.0, 300.0), "].93 satellite"),
        ((300.0, 560.0), ".93 satellite["),
        ((90.0, 520.0), "].93"),
        ((10.0, 590.0), ""),
    ],
)
def test_a_label_is_written_whole_or_its_figure_alone(ends: tuple[float, float], written: str):
    window = Window(x0_px=0.0, y0_px=0.0, width_px=600.0, height_px=400.0, columns=60, rows=20)
    (xa, xb), y = ends, 200.0
    mark = Mark(
        x_px=(xa + xb) / 2,
        y_px=y,
        kind="followed",
        ends_px=((xa, y), (xb, y)),
        label=".93 satellite",
    )
    cells = mark_characters((mark,), window)
    row = "".join(cells.get((column, 10), (" ", ""))[0] for column in range(60))
    assert written in row
    assert "satellite" in row or "sat" not in row


def test_a_cross_on_empty_sky_stays_a_cross():
    window = Window(x0_px=0.0, y0_px=0.0, width_px=600.0, height_px=400.0, columns=60, rows=20)
    written = mark_characters((Mark(x_px=100.0, y_px=100.0, kind="predicted"),), window)
    assert written == {(10, 5): ("+", "predicted")}
