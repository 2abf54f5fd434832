"""The figures say what the session holds: marks, misses, bounds, and nothing that is not there."""

import itertools
import json
import math
import sqlite3
from contextlib import closing
from dataclasses import replace
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.library import write_figures
from rsoconsole.library.notebook.figures.draw_sky import (
    draw_errors,
    draw_track,
    draw_track_about_line,
)
from rsoconsole.library.notebook.figures.draw_time import draw_confidence, draw_nis, draw_residuals
from rsoconsole.library.notebook.night.night import read_drawn_night, read_truth
from rsoconsole.records import FrameTaken, Measurement
from rsoconsole.session import BatchRecording
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from tests.cli.test_cli_frames import rsoconsole
from tests.tiers import plain_first

NS = 1_000_000_000
T0 = 1_687_498_200 * NS
MISSED = (7, 8)
FRAMES = 14
ARCSEC = 1 / 3600


def measurement(frame_id: int, north_arcsec: float = 0.0, **more: Any) -> Measurement:
    """A satellite that crosses RA 0h in the middle of its night."""
    t_s = 30.0 * frame_id
    offset_arcsec = 0.2 if frame_id % 2 else -0.2
    return Measurement(
        **{
            "measurement_id": f"{frame_id}-{round(north_arcsec)}",
            "frame_id": frame_id,
            "t_mid_utc_ns": T0 + round(t_s * 1e9),
            "ra_icrs_deg": (359.1 + 15.04 * ARCSEC * t_s) % 360.0,
            "dec_icrs_deg": -5.0 + (offset_arcsec + north_arcsec) * ARCSEC,
            "cov_sky_arcsec2": (0.09, 0.0, 0.04),
            "x_px": 0.0,
            "y_px": 0.0,
            "confidence": 0.9 - 0.01 * frame_id,
            "source": "network",
            **more,
        }
    )


def taken(frame_id: int) -> FrameTaken:
    return FrameTaken(
        frame_id=frame_id,
        name=f"{frame_id}.fits",
        t_start_utc_ns=T0 + (30 * frame_id - 5) * NS,
        exposure_s=10.0,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )


def record(folder, *, preset="tuned", frames=FRAMES, is_seen=True):
    config = Config.model_validate({"filter": {"preset": preset}})
    settings = FollowSettings(filter=config.filter, half_field_deg=0.6)
    recording = BatchRecording(folder, config, "0" * 64)
    following = Following()
    for frame_id in range(1, frames + 1):
        measured = ()
        if is_seen and frame_id not in MISSED:
            stray = measurement(frame_id, north_arcsec=400.0, confidence=0.3)
            measured = (measurement(frame_id), stray)
        seen = FrameInput(
            frame_id=frame_id,
            t_mid_utc_ns=T0 + 30 * frame_id * NS,
            exposure_s=10.0,
            measurements=measured,
        )
        following, records = follow(following, seen, settings)
        recording.append((taken(frame_id), *measured, *records), seen.t_mid_utc_ns)
    recording.close()
    return folder


@pytest.fixture(scope="module", params=["tuned", "paper"])
def session(request, tmp_path_factory):
    return record(tmp_path_factory.mktemp("night") / request.param, preset=request.param)


@pytest.fixture(scope="module")
def tuned_session(tmp_path_factory):
    """For what does not depend on the preset: drawing to a file takes its time."""
    return record(tmp_path_factory.mktemp("night") / "tuned")


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("truth") / "truth.jsonl"
    lines = []
    for frame_id in range(1, FRAMES + 1):
        exact = measurement(frame_id)
        satellites = [
            {"name": "ALPHA", "ra_icrs_deg": exact.ra_icrs_deg, "dec_icrs_deg": -5.0},
            {"name": "BETA", "ra_icrs_deg": exact.ra_icrs_deg, "dec_icrs_deg": -5.0 + 1 / 9},
        ]
        t_start = exact.t_mid_utc_ns - 5 * NS
        exposure = {"t_start_utc_ns": t_start, "exposure_s": 10.0, "satellites": satellites}
        lines.append(json.dumps(exposure))
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def drawn(draw, *arguments):
    from matplotlib.figure import Figure

    figure = Figure()
    draw(figure, *arguments)
    return figure.axes


def marks(axis, marker):
    """(time, value) of every point with this marker."""
    return [
        (float(x), float(y))
        for line in axis.get_lines()
        if line.get_marker() == marker
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    ]


def test_a_night_is_gathered_frame_by_frame(session):
    night = read_drawn_night(session)
    assert [frame.frame_id for frame in night.frames] == list(range(1, FRAMES + 1))
    assert [frame.frame_id for frame in night.frames if frame.lead_miss_reason] == list(MISSED)
    for frame in night.frames[1:]:
        is_missed = frame.frame_id in MISSED
        assert (frame.lead_measured is None) is is_missed
        assert [each.confidence for each in frame.other_measurements] == (
            [] if is_missed else [0.3]
        )
    assert night.frames[0].lead_measured is None, "before a track nothing was taken"
    assert night.seconds_since_start(night.frames[-1]) == pytest.approx(30.0 * (FRAMES - 1))


def test_marks_are_the_papers_and_as_many_as_there_were(session):
    for axis in drawn(draw_track, read_drawn_night(session)):
        followed = FRAMES - 1 - len(MISSED)
        assert len(marks(axis, "s")) == len(marks(axis, "^")) == followed
        assert len(marks(axis, "o")) == FRAMES - 2, "every frame after the first two is predicted"
        dashed = [line for line in axis.get_lines() if line.get_linestyle() == "--"]
        assert len(dashed) == 2
        colours = {line.get_marker(): line.get_markeredgecolor() for line in axis.get_lines()}
        assert colours["s"] == "#c62828"


def test_right_ascension_runs_through_0h_without_a_jump(session):
    right_ascension, _ = drawn(draw_track, read_drawn_night(session))
    values = [value for _, value in sorted(marks(right_ascension, "s"))]
    steps = [b - a for a, b in itertools.pairwise(values)]
    four_missed_frames_deg = 0.6
    assert all(0.0 < step < four_missed_frames_deg for step in steps)
    told = right_ascension.yaxis.get_major_formatter()
    assert told(360.25, 0) == "0.25"


def test_misses_are_shaded_where_they_were(session):
    night = read_drawn_night(session)
    for draw in (draw_track, draw_track_about_line, draw_confidence, draw_residuals, draw_nis):
        axis = drawn(draw, night)[0]
        columns = [
            patch.get_x() + patch.get_width() / 2
            for patch in axis.patches
            if patch.get_width() == pytest.approx(30.0)
        ]
        assert columns == pytest.approx([30.0 * (frame_id - 1) for frame_id in MISSED])


def test_about_the_line_the_marks_are_seconds_of_arc(session):
    _, declination = drawn(draw_track_about_line, read_drawn_night(session))
    assert all(abs(value) < 0.5 for _, value in marks(declination, "s"))
    assert "arcsec" in declination.get_ylabel()


def test_residuals_lie_in_their_own_bounds(session):
    night = read_drawn_night(session)
    for index, axis in enumerate(drawn(draw_residuals, night)):
        points = marks(axis, "s")
        assert len(points) == FRAMES - 2 - len(MISSED)
        innovations = [
            frame.updated.innovation_arcsec[index]
            for frame in night.frames
            if frame.updated is not None and frame.updated.innovation_arcsec is not None
        ]
        assert [value for _, value in points] == pytest.approx(innovations)
        low, high = axis.get_ylim()
        assert all(low < value < high for value in innovations)


def test_errors_are_those_of_the_satellite_that_was_followed(session, truth):
    night = read_drawn_night(session)
    places = read_truth(truth, night)
    assert {place.name for place in places.values()} == {"ALPHA"}
    east, north = drawn(draw_errors, night, places)
    assert all(abs(value) < 1e-6 for _, value in marks(east, "s"))
    assert [abs(value) for _, value in marks(north, "s")] == pytest.approx([0.2] * 11)


@pytest.mark.parametrize(
    ("file_format", "begins"),
    plain_first(1, [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")]),
)
def test_every_figure_is_written_in_every_format(
    tuned_session, truth, tmp_path, file_format, begins
):
    paths = write_figures(tuned_session, tmp_path / "new", truth=truth, file_format=file_format)
    names = [path.stem.partition("_")[2] for path in paths]
    assert names == ["confidence", "track", "track_about_line", "residuals", "nis", "errors"]
    assert all(path.read_bytes().startswith(begins) for path in paths)


def test_the_same_session_gives_the_same_figures(tmp_path):
    short = record(tmp_path / "short", frames=4)
    first = write_figures(short, tmp_path / "a", file_format="svg")
    second = write_figures(short, tmp_path / "b", file_format="svg")
    assert len(first) == 5
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_a_session_without_a_track_gives_the_confidences_alone(tmp_path):
    folder = record(tmp_path / "empty", is_seen=False, frames=3)
    paths = write_figures(folder, tmp_path / "out")
    assert [path.name for path in paths] == ["1_confidence.png"]


def test_a_track_of_a_single_state_is_drawn(tmp_path):
    folder = record(tmp_path / "short", frames=2)
    assert len(write_figures(folder, tmp_path / "out")) == 5


def test_what_cannot_be_drawn_is_said(tmp_path, tuned_session):
    with pytest.raises(SessionError, match="does not exist"):
        write_figures(tmp_path / "nowhere", tmp_path / "out")
    bare = record(tmp_path / "bare", frames=0)
    with pytest.raises(SessionError, match="nothing to draw"):
        write_figures(bare, tmp_path / "out")
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(SessionError, match="cannot be written"):
        write_figures(tuned_session, tmp_path / "file")
    with pytest.raises(SessionError, match="truth"):
        write_figures(tuned_session, tmp_path / "out", truth=tmp_path / "file")


def test_a_second_track_after_a_loss_is_drawn_too(tuned_session):
    """A miss between two tracks belongs to neither: the bounds are broken there."""
    night = read_drawn_night(tuned_session)
    frames = [
        replace(frame, predicted=None, updated=None) if frame.frame_id in MISSED else frame
        for frame in night.frames
    ]
    axis, _ = drawn(draw_track, replace(night, frames=tuple(frames)))
    bound = next(line for line in axis.get_lines() if line.get_linestyle() == "--")
    holes = [t_s for t_s, value in zip(*bound.get_data(), strict=True) if math.isnan(value)]
    assert holes == pytest.approx([0.0, *(30.0 * (frame_id - 1) for frame_id in MISSED)])


def test_the_verb_prints_one_object_a_figure(tuned_session, tmp_path):
    run = rsoconsole("figures", tuned_session, "--out", tmp_path / "out", "--json")
    assert run.returncode == 0, run.stderr
    paths = [json.loads(line)["figure"] for line in run.stdout.splitlines()]
    assert [path.rsplit("/", 1)[1] for path in paths] == [
        "1_confidence.png",
        "2_track.png",
        "3_track_about_line.png",
        "4_residuals.png",
        "5_nis.png",
    ]


def test_the_verb_says_what_is_no_session(tmp_path):
    run = CliRunner().invoke(app, ["figures", str(tmp_path)])
    assert isinstance(run.exception, SessionError)
    assert run.stdout == ""


@pytest.mark.parametrize("title", ["\x1b]0;pwned\x07\x9b31m", "$\\badformula", "夜"])
def test_whatever_a_session_calls_itself_is_a_title_and_nothing_else(title, tmp_path):
    folder = record(tmp_path / "night", is_seen=False, frames=3)
    with closing(sqlite3.connect(folder / "session.db")) as database, database:
        row = ("title", json.dumps(title))
        database.execute("INSERT OR REPLACE INTO meta (key, value) VALUES (?, ?)", row)
    done = CliRunner().invoke(app, ["figures", str(folder), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert done.stderr == ""
    assert all(c.isprintable() or c == "\n" for c in done.stdout)
