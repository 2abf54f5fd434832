"""How bright: the magnitude of each track, wherever the operator looks at one."""

from pathlib import Path

import pytest

from rsoconsole.console.dialogs.candidates import candidate_lines
from rsoconsole.console.drawing.light_plot import LightMark, light_plot
from rsoconsole.console.drawing.plot import AXIS_COLUMNS, Line
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.light_curve import light_curve_lines
from rsoconsole.console.words.track_lines import track_list_lines
from rsoconsole.night import Night, frames_of, light_of_streak
from rsoconsole.records import FollowedAgain, Photometry, TrackState
from rsoconsole.words import light_detail_words, magnitude_words, streak_detail_words
from tests.makers import straight_detection, streak_light
from tests.nights import eight_tracks as eight
from tests.nights.made_up_night import t_of

TWO = (1, 2)


def words(lines: list[Line]) -> str:
    return "\n".join("".join(text for text, _ in line) for line in lines)


def night_of(frames: int, *, light=eight.light_of, **more) -> Night:
    """Two tracks, of which the second leads; ``light``: photometry of a frame by its number."""
    night = Night(Path("bright"), {}, None)
    for n in range(1, frames + 1):
        for record in eight.story(n, since=1, tracks=TWO, light=light(n), **more):
            night.fold_record(t_of(n), record)
    return night


def magnitudes(night: Night) -> list[float | None]:
    return [None if t.light is None else t.light.mag for t in night.view().tracks]


@pytest.mark.parametrize(
    ("light", "says"),
    [
        (streak_light("1-0", 12.412), "mag 12.41±.03 V"),
        (streak_light("1-0", 12.412, mag_sigma=0.31), "mag 12.4±.3 V"),
        (streak_light("1-0", -9.31, band="instrumental"), "mag -9.31±.03 inst"),
        (streak_light("1-0", 8.2, is_saturated=True), "mag <8.20 V"),
        (streak_light("1-0", None), ""),
        (None, ""),
    ],
)
def test_a_magnitude_has_its_sigma_and_its_band(light, says):
    assert magnitude_words(light) == says


def test_a_streak_in_full_says_what_else_is_to_be_known_of_its_magnitude():
    streak = straight_detection()
    assert streak_detail_words(streak) == ["118×2.5 px", "SNR 60"]
    said = streak_detail_words(streak, streak_light("1-0", is_blended=True))
    assert said[2:] == ["mag 12.41±.03 V", "±0.07 by its unknown colour", "blended with stars"]
    saturated = streak_light("1-0", is_saturated=True, mag_sigma_colour=None)
    assert light_detail_words(saturated) == ["mag <12.41 V", "saturated: it is brighter"]
    assert "lost in the noise" in light_detail_words(streak_light("1-0", None))[0]


def test_each_track_has_the_magnitude_of_its_last_measurement():
    assert magnitudes(night_of(3)) == [11.0, 12.0]
    # The second is not seen in the third frame: its last magnitude stays.
    missed = Night(Path("missed"), {}, None)
    for n in (1, 2, 3):
        seen = TWO if n < 3 else (1,)
        out = () if n < 3 else (2,)
        light = Photometry(frame_id=n, streaks=tuple(streak_light(f"{n}-{t}", n) for t in seen))
        for record in eight.story(n, since=1, tracks=TWO, missed=out, light=light):
            missed.fold_record(t_of(n), record)
    assert magnitudes(missed) == [3, 2]


def test_the_magnitude_before_stays_until_the_frames_photometry_is_on_record():
    night = night_of(2)
    for record in eight.frame(3, tracks=TWO):
        night.fold_record(t_of(3), record)
    assert magnitudes(night) == [11.0, 12.0]
    lights = (streak_light("3-1", 11.5), streak_light("3-2", None))
    night.fold_record(t_of(3), Photometry(frame_id=3, streaks=lights))
    assert magnitudes(night) == [11.5, None]


def test_a_frame_without_photometry_leaves_no_magnitude_of_another_frame():
    night = night_of(3, light=lambda n: eight.light_of(n) if n < 3 else None)
    assert magnitudes(night) == [None, None]
    rows = night.view().tracks[0].rows
    assert [row.light is not None for row in rows] == [True, True, False]


def test_frames_that_are_followed_again_keep_the_magnitude_of_what_is_taken_now():
    night = night_of(3)
    night.fold_record(t_of(3), FollowedAgain(frame_id=3))
    for record in eight.frame(3, tracks=TWO):
        if isinstance(record, TrackState):
            night.fold_record(t_of(3), record)
    assert magnitudes(night) == [11.0, 12.0]
    assert [row.light.mag for row in night.view().tracks[0].rows if row.light] == [11.0] * 3


def test_the_rows_of_the_lead_have_its_magnitude_without_the_steps_of_its_light():
    (row,) = (row for row in night_of(4).view().rows if row.frame_id == 4)
    assert row.light is not None
    assert (row.light.mag, row.light.band, row.light.steps) == (12.0, "V", ())


def test_the_list_of_tracks_has_a_column_of_magnitudes_where_there_are_any():
    said = words(track_list_lines(night_of(3).view(), None, None, 62, 12)).splitlines()
    assert said[1].split() == ["#", "name", "state", "resid", "NIS", "SNR", "mag", "age", "orbit"]
    assert "12.00" in said[3].split()
    assert "mag 12.00±.03 V" in "\n".join(said)  # the lead, in full below
    without = words(track_list_lines(night_of(3, light=lambda _: None).view(), None, None, 62, 12))
    assert "mag" not in without


def test_instrumental_magnitudes_have_a_column_that_says_so():
    night = night_of(3, light=lambda n: eight.light_of(n, band="instrumental"))
    said = words(track_list_lines(night.view(), None, None, 62, 12)).splitlines()
    assert "inst" in said[1].split()
    assert "mag" not in said[1].split()
    # One of each: a figure without a band would be read as V.
    lights = (streak_light("4-1", 11.0), streak_light("4-2", -9.3, band="instrumental"))
    for record in eight.story(4, since=1, tracks=TWO, light=Photometry(frame_id=4, streaks=lights)):
        night.fold_record(t_of(4), record)
    said = words(track_list_lines(night.view(), None, None, 62, 12)).splitlines()
    assert "mag" in said[1].split()
    assert "11.00" in said[2].split()
    assert "inst" in said[3].split()
    assert "mag -9.30±.03 inst" in "\n".join(said)


def test_each_candidate_says_how_bright_it_is():
    *_, frame = frames_of(eight.story(3, since=1, tracks=TWO, light=eight.light_of(3)))
    said = "\n".join(candidate_lines(frame, 0.1))
    assert "mag 11.00±.03 V\n" in said
    assert "mag 12.00±.03 V" in said
    *_, without = frames_of(eight.story(3, since=1, tracks=TWO))
    assert "mag" not in "\n".join(candidate_lines(without, 0.1))


def test_a_candidate_of_a_frame_without_a_plate_has_its_magnitude_by_its_number():
    records = [r for r in eight.frame(3, tracks=TWO) if type(r).__name__ != "Measurement"]
    lights = (streak_light("3-0", -8.0, band="instrumental"), streak_light("3-1", -7.0))
    records.append(Photometry(frame_id=3, streaks=lights))
    (frame,) = frames_of(records)
    found = [light_of_streak(frame, each) for each in frame.detected_streaks]
    assert [light.mag for light in found if light is not None] == [-8.0, -7.0]


def row_of(drawn: list[str], column: int) -> int:
    """The row in which a mark of that column of the plot stands."""
    signs = {"●", "▲", "▼"}
    return next(n for n, line in enumerate(drawn) if line[AXIS_COLUMNS + column] in signs)


def test_the_brightest_is_at_the_top_with_its_error_about_it():
    mags = (12.0, 11.0, 13.0)
    marks = [LightMark(mag=mag, sigma=0.3) for mag in mags]
    drawn = words(light_plot([None, *marks], AXIS_COLUMNS + 4, 12)).splitlines()
    rows = [row_of(drawn, column) for column in (1, 2, 3)]
    assert rows[1] < rows[0] < rows[2]
    assert drawn[0].startswith("10.70")
    assert drawn[-1].startswith("13.30")
    assert [line[AXIS_COLUMNS + 1] for line in drawn[rows[0] - 1 : rows[0] + 2]] == ["░", "●", "░"]
    assert not any(line[AXIS_COLUMNS] in "●░" for line in drawn)


def test_a_steady_light_is_drawn_steady():
    marks = [LightMark(mag=12.0 + 0.001 * n, sigma=0.02) for n in range(8)]
    drawn = words(light_plot(marks, AXIS_COLUMNS + 8, 12)).splitlines()
    rows = [row_of(drawn, column) for column in range(8)]
    assert max(rows) - min(rows) <= 1


def test_what_is_saturated_is_an_arrow_up():
    drawn = words(light_plot([LightMark(mag=8.0, is_saturated=True)], AXIS_COLUMNS + 3, 6))
    assert "▲" in drawn
    assert "●" not in drawn


def test_the_page_tells_the_leads_brightness_or_that_of_the_chosen_track():
    night = night_of(6, light=lambda n: eight.light_of(n, TWO)).view()
    said = words(light_curve_lines(night, None, 60, 16))
    assert said.splitlines()[0].startswith("─ brightness mag 12.00±.03 V")
    assert "median 12.00 of 6 · scatter ±.00 · errors ±.03" in said
    assert said.count("●") == 6
    assert len(said.splitlines()) == 16
    assert "╵" in said.splitlines()[-1]
    assert "track 1: brightness mag 11.00" in words(
        light_curve_lines(night, night.tracks[0], 60, 16)
    )


def test_the_page_says_plainly_where_there_is_nothing_to_show():
    for night in (Night(Path("empty"), {}, None), night_of(4, light=lambda _: None)):
        for size in ((35, 17), (60, 3), (20, 1)):
            lines = light_curve_lines(night.view(), None, *size)
            assert 0 < len(lines) <= size[1]
            assert "brightness" in words(lines)
            assert all(len(line) <= size[0] for line in words(lines).splitlines())


def test_the_page_keeps_bands_apart_and_says_so():
    def light(n: int) -> Photometry:
        return eight.light_of(n, TWO, band="instrumental" if n < 3 else "V")

    said = words(light_curve_lines(night_of(6, light=light).view(), None, 60, 16))
    assert said.count("●") == 4
    assert "2 of another band left out" in said
    all_inst = night_of(4, light=lambda n: eight.light_of(n, TWO, band="instrumental"))
    said = words(light_curve_lines(all_inst.view(), None, 60, 16))
    assert "mag 12.00±.03 inst" in said
    assert "no zero point" in said


@pytest.mark.parametrize("size", [(35, 17), (47, 14), (60, 5), (30, 2)])
def test_the_page_fits_its_place(size):
    lines = light_curve_lines(night_of(40).view(), None, *size)
    assert len(lines) <= size[1]
    assert all(len(line) <= size[0] for line in words(lines).splitlines())


def test_a_new_leads_page_has_none_of_the_brightness_of_the_lead_before():
    night = night_of(4)
    for n in (5, 6):
        for record in eight.story(n, since=1, tracks=TWO, lead=1, light=eight.light_of(n)):
            night.fold_record(t_of(n), record)
    said = words(light_curve_lines(night.view(), None, 60, 16))
    assert "median 11.00 of 6" in said  # its own from the first frame on, beside the other lead


def test_the_leads_magnitude_stands_with_its_motion():
    view = EngineView(reach="recorded")
    assert "mag 12.00±.03 V" in words(figure_lines(night_of(3).view(), view, None, 80, 3))
    without = night_of(3, light=lambda _: None).view()
    assert "mag" not in words(figure_lines(without, view, None, 80, 3))
