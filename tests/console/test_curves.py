"""The curves of the night, the focus, the drift, and which frames the plots show."""

import math
from dataclasses import replace

import numpy as np
import pytest
from textual.pilot import Pilot

from rsoconsole.config import Config
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.plain import to_ascii
from rsoconsole.console.drawing.plot import AXIS_COLUMNS, Line
from rsoconsole.console.words.curves import (
    alignment_lines,
    focus_lines,
    fwhm_trend_words,
    image_quality_lines,
)
from rsoconsole.console.words.panels import (
    PlotWindow,
    confidence_lines,
    nis_lines,
    residual_lines,
    time_axis_lines,
)
from rsoconsole.night import FRAME_FACTS, FrameRow, NightView
from rsoconsole.sky import iso_to_utc_ns
from tests.rigs.seat_rig import FakeWire, pane, play, until

BEGUN = iso_to_utc_ns("2023-06-22T05:30:00Z")
NS = 1_000_000_000


def row(number: int, **more) -> FrameRow:
    names = {fact.name for fact in FRAME_FACTS}
    facts = {name: more.pop(name) for name in names & more.keys()}
    begun_ns = BEGUN + 30 * NS * (number - 1)
    return FrameRow(frame_id=number, is_reduced=True, t_utc_ns=begun_ns, facts=facts, **more)


def words(lines: list[Line]) -> str:
    return "\n".join("".join(text for text, _ in line) for line in lines)


def test_the_five_curves_have_their_unit_their_span_and_one_axis_of_time():
    rows = [
        row(
            n,
            star_fwhm_px=2.5 + n / 100,
            background_adu=1000.0 + n,
            zero_point_mag=21.5 - n / 50,
            limiting_mag=14.0 - n / 50,
            star_count=100 + n,
        )
        for n in range(1, 41)
    ]
    said = words(image_quality_lines(rows, 60, 16))
    assert len(said.splitlines()) == 16
    assert "FWHM 2.9 px" in said
    assert "2.5 to 2.9" in said
    assert "background 1040 ADU" in said
    assert "zero point 20.70 mag" in said
    assert "limiting magnitude 13.2 mag" in said
    assert "stars 140" in said
    assert "╵05:30" in said.splitlines()[-1]


def test_haze_is_said_loudly_and_what_was_not_measured_plainly():
    clear = [row(n, zero_point_mag=21.5) for n in range(1, 10)]
    hazy = image_quality_lines([*clear, row(10, zero_point_mag=21.0)], 60, 17)
    assert ("transparency, zero point 21.00 mag", "warn") in [
        part for line in hazy for part in line
    ]
    assert "background: not measured" in words(hazy)


def test_a_time_stands_under_the_frame_that_began_then():
    rows = [row(n) for n in range(1, 101)]
    (line,) = time_axis_lines(rows, AXIS_COLUMNS + 50, 1)
    text = "".join(part for part, _ in line)
    at = text.index("╵06:07")  # frames 51 to 100 are shown, one a column
    shown = rows[50 + at - AXIS_COLUMNS]
    assert shown.t_utc_ns is not None
    assert BEGUN + 37 * 60 * NS <= shown.t_utc_ns < BEGUN + 38 * 60 * NS


def test_the_window_goes_back_and_on_and_keeps_the_worst_of_a_mark():
    rows = [row(n, residual_arcsec=(0.1, 0.0), sigma_arcsec=(1.0, 1.0)) for n in range(1, 41)]
    rows[13] = replace(rows[13], residual_arcsec=(9.0, 0.0))
    rows[21] = replace(rows[21], residual_arcsec=None, miss="cloud")
    window = PlotWindow().zoomed(2.0).zoomed(2.0)
    assert [each.frame_id for each in window.rows(rows)][3] == 14
    assert len(window.rows(rows)) == 10
    back = PlotWindow().moved(-12, len(rows))
    assert back.rows(rows)[-1].frame_id == 28
    assert "to frame 0028, 05:43Z" in back.words(rows)
    assert back.moved(99, len(rows)) == PlotWindow()
    assert back.moved(-999, len(rows)).rows(rows)
    # As the night goes on a mark keeps its frames.
    assert window.rows([*rows, row(41)])[:10] == window.rows(rows)


def test_titles_count_the_frames_that_the_plot_has_marks_of():
    rows = tuple(row(n) for n in range(1, 301))
    width = AXIS_COLUMNS + 50
    newest, wide = PlotWindow(), PlotWindow().zoomed(2.0).zoomed(2.0)
    assert newest.frames_words(rows, width) == "last 50 of 300"
    assert newest.frames_words(rows[:40], width) == "40 frames"
    assert wide.frames_words(rows, width) == "last 200 of 300"
    assert len(wide.rows(rows, width)) == 50
    assert wide.frames_words(rows, AXIS_COLUMNS + 75) == "300 frames"
    assert newest.moved(-100, 300).frames_words(rows, width) == "0151-0200 of 300"
    # The last mark has one frame as yet.
    assert wide.frames_words((*rows, row(301)), width) == "last 197 of 301"


def test_going_back_stops_where_the_oldest_frames_fill_the_plot():
    room = 50
    window = PlotWindow()
    for _ in range(40):
        window = window.moved(-12, 300, room)
    assert len(window.rows([row(n) for n in range(1, 301)], AXIS_COLUMNS + room)) == room
    assert window.moved(-12, 300, room) == window
    assert PlotWindow().moved(-12, 30, room) == PlotWindow()  # all of them are seen already
    coarse = PlotWindow(frames_a_mark=4)
    for _ in range(40):
        coarse = coarse.moved(-12, 300, room)
    assert coarse.back == 300 - 4 * room


def test_titles_tell_of_the_newest_frame_up_to_the_right_edge_and_not_of_a_marks_worst():
    def measured(number: int, off_arcsec: float, confidence: float = 0.5) -> FrameRow:
        return row(
            number,
            residual_arcsec=(off_arcsec, 0.0),
            sigma_arcsec=(1.0, 1.0),
            nis=off_arcsec**2,
            confidence=confidence,
        )

    frames = [measured(n, 0.1) for n in range(1, 40)] + [measured(40, 0.2), measured(41, 5.0, 0.9)]
    night = NightView(rows=tuple(frames))
    back = PlotWindow(back=1)
    size = AXIS_COLUMNS + 60, 6
    assert "residual +5.00" in words(residual_lines(night, "east", *size))
    assert "residual +0.20" in words(residual_lines(night, "east", *size, window=back))
    assert "confidence .50" in words(confidence_lines(night, *size, window=back))
    assert "NIS 0.0 /12 (ideal 2) · 0001-0040 of 41" in words(nis_lines(night, *size, window=back))
    wide = PlotWindow().zoomed(2.0).zoomed(2.0)
    after = replace(night, rows=(*night.rows, measured(42, 0.3)))
    assert "residual +0.30" in words(residual_lines(after, "east", *size, window=wide))


@pytest.mark.parametrize(
    ("change", "says"),
    [(0.0, "steady"), (0.1, "wider by"), (-0.1, "sharper by")],
)
def test_the_trend_of_the_focus_is_told_from_its_scatter(change, says):
    scatter = np.random.default_rng(3).normal(0.0, 0.02, 10)
    assert says in fwhm_trend_words([3.0 + change * n + s for n, s in enumerate(scatter)])[0]


def test_the_focus_is_shown_large_with_its_best():
    night = NightView(rows=tuple(row(n, star_fwhm_px=3.0 - n / 10) for n in range(1, 11)))
    said = words(focus_lines(night, 50, 16))
    assert "FWHM 2.00 px   best 2.00 in frame 0010" in to_ascii(
        said
    )  # where blocks cannot be drawn
    assert "█" in said
    assert "no frame has shown stars" in words(focus_lines(NightView(), 50, 16))


def drifting_night(latitude_deg: float, hour_angle_deg: float) -> NightView:
    """The stars drift 90 arcsec an hour north of where the mount says."""
    from rsoconsole.sky import icrs_of_hour_angle

    config = Config.model_validate({"site": {"latitude_deg": latitude_deg}})
    ra, dec = icrs_of_hour_angle(config.site.to_site(), hour_angle_deg, -5.0, BEGUN)
    rows = [
        row(
            n,
            mount_icrs_deg=(ra, dec),
            plate_icrs_deg=(ra, dec + 90.0 / 3600.0 * n / 120.0 + 0.1 / 3600.0 * math.sin(7 * n)),
            rotation_deg=1.7,
        )
        for n in range(1, 41)
    ]
    return NightView(rows=tuple(rows), config=config)


def test_a_drift_near_the_meridian_is_put_down_to_the_azimuth_of_the_polar_axis():
    said = words(alignment_lines(drifting_night(47.0, 0.0), 66, 20))
    assert "Dec +90" in said
    assert "polar axis about 5.7′ too far east (azimuth)" in said
    assert "40 solved frames" in said
    low = words(alignment_lines(drifting_night(47.0, -75.0), 66, 20))
    assert "too low (altitude)" in low
    half_of_80 = words(alignment_lines(drifting_night(47.0, -45.0), 47, 20)[:7])
    assert "both its errors mix" in half_of_80
    assert "…" not in half_of_80
    assert "five solved frames" in words(alignment_lines(NightView(), 66, 20))


def test_each_page_comes_and_goes_by_its_key_and_the_plots_can_be_scrolled(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        assert "╵" in pane(app, "axis")
        pages = {"2": "background", "3": "focus", "4": "polar alignment", "7": "brightness"}
        for key, says in pages.items():
            await pilot.press(key)
            await until(pilot, lambda says=says: says in pane(app, "curves"))
            assert app.live.query_one("#curves").display
        await pilot.press("7")
        await until(pilot, lambda: not app.live.query_one("#curves").display)
        await pilot.press("comma")
        # All of them are seen already.
        await until(pilot, lambda: "no earlier frames" in pane(app, "keys"))
        await pilot.press("minus")
        await until(pilot, lambda: "2 frames" in pane(app, "axis"))
        await pilot.press("end")
        await until(pilot, lambda: "2 frames" not in pane(app, "axis"))
        await pilot.press("2", "escape")
        await until(pilot, lambda: not app.live.query_one("#curves").display)

    play(wire, scene)
