"""Each track of a night of several: in the notebook, in the report, in a picture of one frame."""

from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import SessionError
from rsoconsole.library import render_report
from rsoconsole.library.notebook._pictures import TrackStreak, draw_tracks
from rsoconsole.library.notebook.session import open_session
from rsoconsole.night import frames_of, tracks_of
from rsoconsole.records import FollowedAgain, Miss, Missed, Ruling, TrackLost
from tests.makers import straight_detection
from tests.nights import eight_tracks as eight
from tests.nights import made_up_night
from tests.nights.made_up_night import t_of

FRAMES = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("eight") / "night"
    writer = made_up_night.begin(place)
    eight.write(writer, range(1, FRAMES + 1))
    writer.append(Ruling(frame_id=FRAMES, dropped=(8,)), t_of(FRAMES))
    writer.append(FollowedAgain(frame_id=FRAMES), t_of(FRAMES))
    left = range(1, eight.COUNT)
    for record in eight.frame(FRAMES, missed=(3,), tracks=left):
        if type(record).__name__ in {"TrackState", "Miss"}:
            writer.append(record, t_of(FRAMES))
    writer.close()
    return place


def test_every_track_has_its_orbit_its_name_and_its_end(folder: Path):
    tracks = open_session(folder).tracks
    assert list(tracks) == list(range(1, eight.COUNT + 1))
    assert tracks[2].orbit.label == "free"
    assert tracks[3].orbit.label == "constrained by prior"
    assert tracks[2].name == "ASTRA 1L"
    assert tracks[5].name is None  # two of the catalogue may be it
    assert tracks[5].identity_text == "ASTRA 19.2E SPARE?"
    assert tracks[6].identity_text == "-"
    led = [n for n, each in tracks.items() if any(state.is_lead for state in each.states)]
    assert led == [2]
    assert tracks[2].quality.residual_rms_arcsec == pytest.approx(1.0)
    assert tracks[4].quality.nis_mean == pytest.approx(1.4)
    assert list(tracks[3].missed) == [FRAMES - 1, FRAMES]
    assert len(tracks[3].measurements) == FRAMES - 2
    assert tracks[8].ended == "dropped by the operator"
    # The frame that was followed again had it no more.
    assert tracks[8].states[-1].frame_id == FRAMES - 1
    assert [tracks[n].ended for n in range(1, 8)] == [""] * 7


def test_a_word_that_is_taken_back_ends_nothing():
    records = [*eight.story(1, since=1, tracks=(1, 2))]
    records += [Ruling(frame_id=1, dropped=(2,)), Ruling(frame_id=1)]
    lost = Missed(kind="no detection", lost=TrackLost(kind="left the field"))
    records.append(Miss(frame_id=2, track_id=1, reason=lost))
    tracks = tracks_of(frames_of(records))
    assert tracks[2].ended == ""
    assert tracks[1].ended == "it has left the field"
    assert tracks[1].missed == {2: "no detection; it has left the field"}


def test_the_report_has_a_line_for_each_member_and_says_whose_misses_they_are(folder: Path):
    html = render_report(folder).html
    for name in ("ASTRA 1KR", "ASTRA 1M", "ASTRA 19.2E SPARE?", "EUTELSAT 25B"):
        assert f"<td>{name}</td>" in html
    assert html.count("a 42164 km") == len(eight.NAMES)
    assert "<td>dropped by the operator</td>" in html
    assert "track 3: miss: no detection" in html


def test_two_streaks_of_one_frame_are_drawn_with_their_tracks_numbers_and_confidences():
    from rsoconsole.library.notebook.figures.inline import NightFigure

    pixels = np.full((600, 800), 1000, np.uint16)
    pixels[300:302, 200:320] = 3000
    one = straight_detection(x_px=260.0, y_px=300.0, confidence=0.99)
    other = straight_detection(x_px=420.0, y_px=340.0, confidence=0.87)
    figure = NightFigure(6.0, 4.0)
    draw_tracks(
        figure, pixels, [TrackStreak(2, False, other), TrackStreak(1, True, one)], "Frame 6"
    )
    (axes,) = figure.axes
    said = [each.get_text() for each in axes.texts]
    assert said == ["track 1* · confidence 0.99", "track 2 · confidence 0.87"]
    x_low, x_high = axes.get_xlim()
    assert x_low < 200.0
    assert x_high > 480.0
    assert (x_high - x_low) < 3.0 * abs(axes.get_ylim()[0] - axes.get_ylim()[1])
    many = [TrackStreak(n, False, one) for n in range(1, 6)]
    figure = NightFigure(6.0, 4.0)
    draw_tracks(figure, pixels, many, "Frame 6")
    assert [each.get_text() for each in figure.axes[0].texts] == ["1", "2", "3", "4", "5"]


def test_a_frame_of_which_no_track_took_anything_has_no_such_picture(folder: Path):
    with pytest.raises(SessionError, match="no track took a streak of frame 99"):
        open_session(folder).plot_tracks(99)
