"""The field as a finder chart: stars, streaks and ellipse where the numbers say, and few bytes."""

import asyncio
import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.color import ColorSystem
from rich.style import Style
from textual.app import App, ComposeResult
from textual.geometry import Region

from rsoconsole.console.drawing.blocks import (
    HALF_BLOCKS,
    QUADRANTS,
    BlockSet,
    fit_to_cells,
    row_runs,
)
from rsoconsole.console.drawing.plain import to_ascii
from rsoconsole.console.drawing.track_marks import track_ink
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.picture.chart import (
    CELLS_A_STAR,
    SIZES,
    chart_characters,
    chart_legend,
    charted_stars,
)
from rsoconsole.console.picture.marks import frame_marks, mark_characters
from rsoconsole.console.picture.picture import (
    Picture,
    decode_preview,
    draw_empty_field,
    draw_field,
)
from rsoconsole.night import FrameTrack, NightFrame
from rsoconsole.records import ChartStar, Detections, FrameTaken, Photometry
from rsoconsole.session.files.frame_encoding import MAX_STARS, decode_preview_stars, encode_preview
from tests.console.test_console_picture import HIGH, WIDE, picture_of, solution, track

BOXES = [(22, 9), (38, 12), (51, 19), (84, 31)]
BRIGHTEST = (3000.0, 700.0, 40_000.0)


def stars(count: int = 60, seed: int = 3) -> tuple[ChartStar, ...]:
    """Stars over the frame, three magnitudes of them, away from the streak at 2000, 1500."""
    rng = np.random.default_rng(seed)
    flux = 10 ** rng.uniform(3.0, 4.2, count)
    x, y = rng.uniform(0, WIDE - 1, count), rng.uniform(1900, HIGH - 1, count)
    made = [ChartStar(*map(float, each)) for each in zip(x, y, flux, strict=True)]
    return (ChartStar(*BRIGHTEST), *made)


made = cache(picture_of)


def charted(angle_deg: float = 0.0, **other) -> Picture:
    return replace(made(angle_deg), stars=stars(), **other)


def written(picture: Picture, columns: int, rows: int):
    drawing = draw_empty_field(picture, columns, rows)
    return drawing.window, chart_characters(picture, picture.marks, drawing.window)


@pytest.mark.parametrize(("columns", "rows"), BOXES)
def test_every_star_is_in_its_cell_and_a_brighter_one_is_no_smaller(columns: int, rows: int):
    picture = charted()
    window, cells = written(picture, columns, rows)
    shown = charted_stars(picture, window)
    assert len(shown) == min(len(picture.stars), window.columns * window.rows // CELLS_A_STAR)
    assert [star.flux_adu for star in shown] == sorted(s.flux_adu for s in picture.stars)[
        -len(shown) :
    ]
    of_cell = {window.cell(star.x_px, star.y_px): star for star in shown}  # the brightest of each
    signs = {at: sign for at, (sign, kind) in cells.items() if kind == "star"}
    assert signs.keys() == of_cell.keys()
    by_flux = sorted(signs, key=lambda at: of_cell[at].flux_adu)
    sizes = [SIZES.index(signs[at]) for at in by_flux]
    assert all(a <= b for a, b in pairwise(sizes))
    assert signs[window.cell(*BRIGHTEST[:2])] == SIZES[-1]
    assert len(set(sizes)) >= 3


def test_stars_about_equally_bright_look_alike():
    equal = tuple(ChartStar(100.0 * k, 50.0 * k, 1000.0 + k) for k in range(1, 40))
    _, cells = written(replace(charted(), stars=equal), 51, 19)
    assert {sign for sign, kind in cells.values() if kind == "star"} == {SIZES[0]}


@pytest.mark.parametrize(
    ("angle_deg", "sign"), [(0.0, "─"), (45.0, "╲"), (90.0, "│"), (135.0, "╱")]
)
@pytest.mark.parametrize(("columns", "rows"), BOXES)
def test_a_streak_is_a_line_in_its_cells(angle_deg: float, sign: str, columns: int, rows: int):
    """Each cell that the streak crosses has the line's sign, and no cell beside has."""
    picture = charted(angle_deg)
    window, cells = written(picture, columns, rows)
    (xa, ya), (xb, yb) = picture.marks[0].ends_px
    on_it = {window.cell(xa + k * (xb - xa), ya + k * (yb - ya)) for k in np.linspace(0, 1, 4000)}
    lines = {at for at, (each, kind) in cells.items() if each == sign and kind == "candidate"}
    assert lines <= on_it
    assert len(lines) >= max(len({row for _, row in on_it}), len({column for column, _ in on_it}))
    assert to_ascii(sign) == {"─": "-", "╲": "\\", "│": "|", "╱": "/"}[sign]


def test_the_followed_streak_has_its_tracks_number():
    picture = charted()
    lead = FrameTrack(track_id=7, is_lead=True)
    detail = replace(picture.detail, tracks=(lead,))
    marks = tuple(replace(mark, kind="followed") for mark in picture.marks)
    picture = replace(picture, detail=detail, marks=marks)
    window, cells = written(picture, 51, 19)
    text = "".join(sign for sign, kind in cells.values() if kind == track_ink(7))
    assert text == "7*"
    column, row = window.cell(2000.0, 1500.0)
    near = [at for at, each in cells.items() if each == ("7", track_ink(7))]
    assert [max(abs(x - column), abs(y - row)) <= 8 for x, y in near] == [True]


def test_the_prediction_is_a_cross_in_its_ellipse():
    detail = NightFrame(
        detections=Detections(frame_id=1, width_px=WIDE, height_px=HIGH, detections=()),
        solution=solution(),
        predicted=track(150.0, -5.0, 400.0, 200.0),
    )
    picture = replace(charted(), detail=detail, marks=frame_marks(detail))
    window, cells = written(picture, 84, 31)
    centre = window.cell((WIDE - 1) / 2, (HIGH - 1) / 2)
    assert cells[centre] == ("+", "predicted")
    ring = [at for at, each in cells.items() if each == ("·", "predicted")]
    half = 3.0 * 400.0 / 1.264 / WIDE * window.columns, 3.0 * 200.0 / 1.264 / HIGH * window.rows
    assert max(x for x, _ in ring) - centre[0] == pytest.approx(half[0], abs=1.0)
    assert max(y for _, y in ring) - centre[1] == pytest.approx(half[1], abs=1.0)
    for x, y in ring:
        out = math.hypot((x - centre[0]) / half[0], (y - centre[1]) / half[1])
        assert out == pytest.approx(1.0, abs=1.0 / half[1])


def test_the_sizes_of_stars_stay_four_in_ascii():
    assert to_ascii(SIZES) == ".oO*"


def test_the_legend_says_from_which_magnitude_on_a_star_has_its_size():
    picture = charted()
    detail = picture.detail
    light = Photometry(frame_id=1, zero_point_mag=22.0)
    taken = FrameTaken(
        frame_id=1,
        name="",
        t_start_utc_ns=1,
        exposure_s=10.0,
        width_px=WIDE,
        height_px=HIGH,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    picture = replace(picture, detail=replace(detail, photometry=light, taken=taken))
    window, cells = written(picture, 51, 19)
    lines = chart_legend(picture, window, 20)
    words = [line.split() for line in lines]
    limits = {each[0]: float(each[1]) for each in words if each and each[0] in SIZES}
    assert list(limits) == list(reversed(SIZES))
    of_cell = {window.cell(star.x_px, star.y_px): star for star in charted_stars(picture, window)}
    for at, star in of_cell.items():
        sign, kind = cells[at]
        mag = 22.0 - 2.5 * math.log10(star.flux_adu / 10.0)
        if kind == "star":
            assert mag <= limits[sign] + 0.051
    assert not chart_legend(picture, window, 5)
    assert not chart_legend(charted(), window, 20)


@pytest.mark.parametrize(("columns", "rows"), [(58, 19), (24, 9), (51, 21)])
def test_a_chart_leaves_no_narrow_strip_blank(columns: int, rows: int):
    window = draw_empty_field(charted(), columns, rows).window
    assert (window.columns, window.rows) == (columns, rows)
    assert draw_empty_field(charted(), 84, 19).window.columns < 84


def cost_bytes(cells, drawing) -> int:
    """Bytes of the picture as a terminal gets it, each run in its colours."""
    fitted, sent = fit_to_cells(drawing.greys, drawing.blocks), 0
    for row in range(drawing.window.rows):
        for text, _ in row_runs(fitted, drawing.blocks, cells, row):
            style = Style(color="#c8c8d0", bgcolor="#161616")
            sent += len(style.render(text, color_system=ColorSystem.TRUECOLOR).encode())
    return sent


@pytest.mark.parametrize("blocks", [QUADRANTS, HALF_BLOCKS])
def test_a_chart_costs_less_than_half_of_the_blocks(blocks: BlockSet):
    picture = charted()
    window, cells = written(picture, 51, 19)
    chart = draw_empty_field(picture, 51, 19, blocks)
    pixels = draw_field(picture, "asinh", 51, 19, blocks)
    of_marks = mark_characters(picture.marks, window)
    assert cost_bytes(cells, chart) < 0.5 * cost_bytes(of_marks, pixels)


class PaneApp(App[None]):
    """A picture's pane alone."""

    def compose(self) -> ComposeResult:
        yield FramePane(lambda *_: (["field"], []), id="frame")


def test_of_a_frame_like_the_one_before_only_the_changed_rows_are_sent():
    """A streak that goes on by a row, and stars that stay."""
    marked: list[Region] = []

    async def run() -> None:
        app = PaneApp()
        async with app.run_test(size=(60, 24)) as pilot:
            pane = app.query_one(FramePane)
            picture = charted()
            pane.show(picture, "field", "chart", 1)
            await pilot.pause()
            rows_before = [pane.render_line(y) for y in range(24)]
            (streak,) = picture.marks
            (xa, ya), (xb, yb) = streak.ends_px
            moved = replace(
                streak, y_px=streak.y_px + 200, ends_px=((xa, ya + 200), (xb, yb + 200))
            )
            pane.refresh = lambda *regions, **_: marked.extend(regions)
            pane.show(replace(picture, marks=(moved,)), "field", "chart", 2)
            changed = [y for y in range(24) if pane.render_line(y) != rows_before[y]]
            assert 1 <= len(changed) <= 3
            assert sorted(region.y for region in marked) == changed
            assert {region.height for region in marked} == {1}

    asyncio.run(run())


def test_the_stars_come_back_from_the_pictures_file():
    codes = np.zeros((30, 40), np.uint8)
    kept = decode_preview_stars(encode_preview(codes, stars()))
    assert kept is not None
    for star, was in zip(kept, stars(), strict=True):
        assert star == pytest.approx(was, abs=0.51)
    assert decode_preview_stars(encode_preview(codes)) is None
    assert decode_preview_stars(encode_preview(codes, ())) == ()
    # Other programs read the picture as before.
    assert np.array_equal(decode_preview(encode_preview(codes, stars())), codes)


@given(st.binary(max_size=300))
def test_damaged_or_hostile_files_give_no_star_that_cannot_be_drawn(noise: bytes):
    whole = encode_preview(np.zeros((30, 40), np.uint8), (ChartStar(1.0, 2.0, 3.0),))
    at = whole.index(b"stars")
    for coded in (noise, whole[: at + 8] + noise, whole[: at - 6] + noise + whole[at:]):
        for star in decode_preview_stars(coded) or ():
            assert all(map(math.isfinite, star))
            assert star.flux_adu > 0.0
    many = encode_preview(np.zeros((30, 40), np.uint8), [ChartStar(1.0, 2.0, 3.0)] * 500)
    assert len(decode_preview_stars(many) or ()) == MAX_STARS


def test_without_stars_on_record_the_pixels_are_drawn():
    assert not made(0.0).has_chart
    assert charted().has_chart
    assert replace(charted(), stars=()).has_chart
    assert written(replace(charted(), stars=(), marks=()), 51, 19)[1] == {}
