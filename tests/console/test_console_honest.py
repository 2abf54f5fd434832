"""What the plots and the log make of what is out of the ordinary."""

from dataclasses import replace
from pathlib import Path

import pytest

from rsoconsole.config import Config
from rsoconsole.console.drawing.plot import PlotColumn, residual_axis_limit, residual_plot
from rsoconsole.console.timeline.lines import TimelineMarks, place_words, timeline_lines
from rsoconsole.console.timeline.timeline import FrameStart, Timeline
from rsoconsole.night import Night
from rsoconsole.records import (
    BelowTau,
    Cause,
    Detections,
    FrameTaken,
    HiddenBy,
    Miss,
    Missed,
    NotAStreak,
    Rejection,
    StateChange,
)
from tests.makers import T0_UTC_NS, straight_detection
from tests.nights.made_up_night import taken


def test_one_stray_residual_does_not_flatten_the_others():
    usual = [PlotColumn(value=0.3 * (-1) ** n, bound=0.9) for n in range(20)]
    stray = PlotColumn(value=-99.0, bound=120.0)
    columns = [*usual, stray, *usual]
    assert residual_axis_limit(columns) == residual_axis_limit(usual)
    text = "\n".join("".join(t for t, _ in line) for line in residual_plot(columns, 60, 5))
    assert "▼" in text
    assert "99" not in text


@pytest.mark.parametrize("count", [1, 3])
def test_of_a_few_residuals_every_one_is_shown(count: int):
    columns = [
        *(PlotColumn(value=0.3, bound=0.9) for _ in range(count)),
        PlotColumn(value=9.0, bound=0.9),
    ]
    assert residual_axis_limit(columns) >= 9.0


def test_residuals_that_are_often_large_make_the_axis():
    columns = [PlotColumn(value=0.3 if n % 3 else 9.0, bound=0.9) for n in range(30)]
    assert residual_axis_limit(columns) >= 9.0


# -- why a streak was not taken ------------------------------------------------------------------


def said(*records: object, number: int = 7) -> list[str]:
    night = Night(Path("night"), {}, Config())
    frame: FrameTaken = taken(number, 150.0, -5.0)
    for record in (frame, *records):
        night.fold_record(T0_UTC_NS, record)  # type: ignore[arg-type]
    return [line.text for line in night.view().log]


def rejected(confidence: float, reason: object, number: int = 7) -> Detections:
    streak = straight_detection(frame_id=number, confidence=confidence)
    return Detections(
        frame_id=number,
        width_px=4656,
        height_px=3520,
        detections=(),
        rejected=(Rejection(detection=streak, reason=reason),),  # type: ignore[arg-type]
    )


NO_DETECTION = Missed(kind="no detection")
COASTS = StateChange(
    frame_id=7, before="TRACK", after="COAST", reason=Cause(kind="missed", missed=NO_DETECTION)
)


def test_the_log_says_why_the_streak_was_not_taken():
    for record in (COASTS, Miss(frame_id=7, reason=NO_DETECTION, track_id=1)):
        (line,) = said(rejected(0.24, NotAStreak(kind="no ends")), record)
        assert "no detection; a streak of confidence .24 was left out: no ends found" in line


def test_what_was_no_likely_streak_is_not_spoken_of():
    (line,) = said(rejected(0.04, BelowTau(confidence=0.04, tau=0.1)), COASTS)
    assert line == "TRACK → COAST: no detection"


def test_a_cloud_is_reason_enough():
    hidden = Missed(kind="no detection", hidden_by=(HiddenBy(kind="few stars", stars=4),))
    change = StateChange(
        frame_id=7, before="TRACK", after="COAST", reason=Cause(kind="missed", missed=hidden)
    )
    (line,) = said(rejected(0.24, NotAStreak(kind="no ends")), change)
    assert "left out" not in line


# -- which frames can be opened ------------------------------------------------------------------


def test_the_time_line_shows_which_frames_have_their_pixels():
    minute = 60 * 10**9
    frames = tuple(FrameStart(n * 10, T0_UTC_NS + n * minute, n) for n in range(1, 21))
    line = Timeline(
        frames=frames,
        first_utc_ns=frames[0].t_utc_ns,
        last_utc_ns=frames[-1].t_utc_ns,
        last_seq=209,
        read_seq=209,
        with_pixels=frozenset({18, 19}),
    )
    events, *_ = timeline_lines(line, TimelineMarks(seq=10), 100, 3)
    text = "".join(part for part, _ in events)
    assert text.count("▫") == 2
    assert text.index("▫") > 75
    assert place_words(line, 185, None)[-1] == "enter opens it"
    assert place_words(line, 15, None)[-1] == "pixels not kept"
    nowhere = replace(line, with_pixels=frozenset())
    assert "▫" not in "".join(
        part for part, _ in timeline_lines(nowhere, TimelineMarks(), 100, 3)[0]
    )
    assert len(place_words(nowhere, 15, None)) == 2
