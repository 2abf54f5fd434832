"""A kept frame processed once more: what the record says again, and what other settings say."""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import ConfigError, FrameError, ModelError, SessionError, SolverError
from rsoconsole.config import Config, with_setting
from rsoconsole.instruments import read_frame
from rsoconsole.pipeline import (
    RecordedFrame,
    Reprocessor,
    pair_candidates,
    read_frame_records,
    read_recorded_frame,
)
from rsoconsole.pipeline.replays import reprocess
from rsoconsole.records import (
    Detection,
    Detections,
    Frame,
    NotAStreak,
    NotSolved,
    ParameterChange,
    Rejection,
)
from rsoconsole.session import SessionReader, compress_frame
from tests.makers import straight_detection
from tests.nights import made_up_night as night
from tests.nights.samples import SAMPLE

KEPT, LEFT_OUT = 9, 8
NO_LINE = "no line fits the light in the box"
A_HUNDREDTH_ARCSEC = 0.01 / 3600
SIGMA_OF_MIDPOINT_ARCSEC = 0.8
"""On record for this frame's measurement, along the streak."""


@pytest.fixture(scope="module")
def recorded() -> RecordedFrame:
    return read_frame_records(SessionReader(SAMPLE), KEPT)


@pytest.fixture(scope="module")
def frame(recorded: RecordedFrame) -> Frame:
    return read_recorded_frame(recorded)


@pytest.fixture(scope="module")
def processor(recorded: RecordedFrame, frame: Frame):
    processor = Reprocessor(recorded, frame)
    yield processor
    processor.close()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The sample, to be damaged."""
    return Path(shutil.copytree(SAMPLE, tmp_path / "night"))


# -- the pixels once more ----------------------------------------------------------------------


def test_the_recorded_settings_see_what_was_recorded(processor: Reprocessor):
    found = processor.run()
    assert (found.tau, found.map_mode) == (0.1, "fast")
    assert [pair.is_as_recorded for pair in found.candidates] == [True]
    assert found.is_same_network is True
    (was,), (now,) = found.was.measurements, found.now.measurements
    assert now.t_mid_utc_ns == was.t_mid_utc_ns
    assert now.ra_icrs_deg == pytest.approx(was.ra_icrs_deg, abs=A_HUNDREDTH_ARCSEC)
    assert now.dec_icrs_deg == pytest.approx(was.dec_icrs_deg, abs=A_HUNDREDTH_ARCSEC)
    assert found.stage_ms["total"] >= found.stage_ms["network"] > 0


def test_a_tau_above_its_confidence_rejects_it_with_both_numbers(processor: Reprocessor):
    found = processor.run(tau=0.99999)
    (pair,) = found.candidates
    assert pair.was is not None
    assert pair.now is not None
    assert (pair.was.is_taken, pair.now.is_taken) == (True, False)
    assert "tau 1.00" in pair.now.reason
    assert not pair.is_as_recorded
    assert found.now.measurements == ()


def test_the_paper_map_is_black_and_white_and_shows_less(processor: Reprocessor):
    (graded,), (hard,) = processor.network_maps("fast"), processor.network_maps("paper")
    assert set(np.unique(hard.values)) == {0, 255}
    assert len(np.unique(graded.values)) > 100
    assert graded.values.shape == hard.values.shape == (440, 582)
    # The streak's ridge is below two sigma a pixel: four of them make a white one. Only the line
    # filter, which reads no map, still sees it.
    found = processor.run(map_mode="paper")
    assert found.map_mode == "paper"
    pair, *_ = found.candidates
    assert pair.was is not None
    assert pair.now is not None
    assert pair.now.detection.confidence <= pair.was.detection.confidence


def test_a_plate_found_again_gives_the_same_place(recorded: RecordedFrame, frame: Frame):
    unsolved = NotSolved(frame_id=KEPT, reason="clouds", ms=1.0)
    without = replace(recorded, seen=replace(recorded.seen, solution=unsolved))
    processor = Reprocessor(without, frame)
    try:
        plain = processor.run()
        assert plain.now.detections is not None
        assert len(plain.now.detections.detections) == 1
        assert plain.now.solution is unsolved
        assert plain.now.measurements == ()
        solved = processor.run(solves_again=True)
    finally:
        processor.close()
    (was,), (now,) = recorded.seen.measurements, solved.now.measurements
    away_arcsec = 3600 * np.hypot(
        (now.ra_icrs_deg - was.ra_icrs_deg) * np.cos(np.radians(was.dec_icrs_deg)),
        now.dec_icrs_deg - was.dec_icrs_deg,
    )
    assert away_arcsec < SIGMA_OF_MIDPOINT_ARCSEC
    assert "solve" in solved.stage_ms


def test_without_index_files_the_reason_stands_for_the_plate(
    recorded: RecordedFrame, frame: Frame, monkeypatch: pytest.MonkeyPatch
):
    def none(_dirs: object, **_: object) -> None:
        raise SolverError("no usable index files: install some")

    monkeypatch.setattr(reprocess, "PlateSolver", none)
    found = Reprocessor(recorded, frame).run(solves_again=True)
    assert isinstance(found.now.solution, NotSolved)
    assert "index files" in found.now.solution.reason
    assert found.now.measurements == ()
    assert [pair.is_as_recorded for pair in found.candidates] == [True]


def test_a_missing_network_and_an_impossible_tau_say_so(
    recorded: RecordedFrame, frame: Frame, processor: Reprocessor, tmp_path: Path
):
    with pytest.raises(ConfigError, match=r"detector\.tau"):
        processor.run(tau=1.5)
    config = with_setting(recorded.config, "detector.model", tmp_path / "none.tflite")
    with pytest.raises(ModelError, match="cannot be read"):
        Reprocessor(replace(recorded, config=config), frame).run()


def test_another_network_is_told(recorded: RecordedFrame, frame: Frame):
    other = Reprocessor(replace(recorded, model_sha256="0" * 64), frame).run()
    assert other.is_same_network is False
    unknown = Reprocessor(replace(recorded, model_sha256=None), frame).run()
    assert unknown.is_same_network is None


def test_nothing_is_written(copy: Path):
    def state() -> dict[Path, tuple[int, int]]:
        stats = {path: path.stat() for path in copy.rglob("*")}
        return {path: (stat.st_size, stat.st_mtime_ns) for path, stat in stats.items()}

    before = state()
    recorded = read_frame_records(SessionReader(copy), KEPT)
    Reprocessor(recorded, read_recorded_frame(recorded)).run(tau=0.5)
    assert state() == before


# -- frames that cannot be ---------------------------------------------------------------------


def test_a_frame_that_was_not_kept_says_why():
    recorded = read_frame_records(SessionReader(SAMPLE), LEFT_OUT)
    assert recorded.path is None
    assert recorded.seen.detections is not None
    with pytest.raises(FrameError, match="frame 8 was not kept: pruned on 2023-06-23"):
        read_recorded_frame(recorded)


def test_a_frame_that_is_not_written_yet_says_so(tmp_path: Path):
    writer = night.begin(tmp_path / "night")
    night.add_frames(writer, range(1, 2))
    with pytest.raises(FrameError, match="not written yet"):
        read_recorded_frame(read_frame_records(SessionReader(writer.folder), 1))
    writer.close()


def test_a_frame_that_never_was_is_no_frame():
    with pytest.raises(SessionError, match="holds no frame 999"):
        read_frame_records(SessionReader(SAMPLE), 999)


def test_a_truncated_file_is_named(copy: Path):
    path = copy / "frames" / "000009.fits.fz"
    path.write_bytes(path.read_bytes()[:1_000_000])
    with pytest.raises(FrameError, match=r"000009\.fits\.fz is truncated"):
        read_recorded_frame(read_frame_records(SessionReader(copy), KEPT))


@pytest.mark.parametrize("what", ["size", "instant"])
def test_the_file_of_another_exposure_is_refused(copy: Path, frame: Frame, what: str):
    header = {**frame.header, "DATE-OBS": "2023-06-23T05:00:00"}
    pixels = frame.pixels[:128, :128] if what == "size" else frame.pixels
    other = replace(frame, pixels=pixels, header=header)
    (copy / "frames" / "000009.fits.fz").write_bytes(compress_frame(other))
    words = "128 x 128 px, but frame 9 was 2328 x 1760" if what == "size" else "another instant"
    with pytest.raises(FrameError, match=words):
        read_recorded_frame(read_frame_records(SessionReader(copy), KEPT))


def test_the_pixels_are_those_of_the_file(recorded: RecordedFrame, frame: Frame):
    assert recorded.path is not None
    assert np.array_equal(frame.pixels, read_frame(recorded.path, KEPT).pixels)


def test_a_branch_shows_the_pixels_of_its_session_and_why_others_are_missing(copy: Path):
    branch = copy / "branches" / "tried"
    branch.mkdir(parents=True)
    shutil.copy(copy / "session.db", branch)
    with closing(sqlite3.connect(branch / "session.db")) as database, database:
        database.execute("DELETE FROM files")
        database.execute("INSERT INTO meta VALUES ('branch_of', '\"../..\"')")
    reader = SessionReader(branch)
    kept = read_frame_records(reader, KEPT)
    assert kept.path is not None
    assert kept.path.samefile(copy / "frames" / "000009.fits.fz")
    assert kept.not_kept_because == ""
    assert "pruned on 2023-06-23" in read_frame_records(reader, LEFT_OUT).not_kept_because


# -- what was in force -------------------------------------------------------------------------


def test_changes_before_the_frame_are_in_force_and_later_ones_are_not(tmp_path: Path):
    writer = night.begin(tmp_path / "night")
    for frame_id, tau in ((1, 0.2), (2, 0.3), (3, 0.4)):
        change = ParameterChange(name="detector.tau", before=0.1, after=tau, by="operator")
        writer.append(change, night.t_of(frame_id))
        night.add_frames(writer, range(frame_id, frame_id + 1))
    writer.close()
    reader = SessionReader(writer.folder)
    assert read_frame_records(reader, 2).config.detector.tau == 0.3
    own = with_setting(Config(), "detector.map_mode", "paper")
    given = read_frame_records(reader, 1, own).config.detector
    assert (given.tau, given.map_mode) == (0.2, "paper")


# -- then and now, side by side ----------------------------------------------------------------


def found(*taken: Detection, rejected: tuple[tuple[Detection, str], ...] = ()) -> Detections:
    return Detections(
        frame_id=1,
        width_px=1000,
        height_px=800,
        detections=taken,
        rejected=tuple(Rejection(detection=d, reason=reason) for d, reason in rejected),
    )


def test_candidates_of_one_streak_stand_side_by_side():
    here = straight_detection(frame_id=1, x_px=300.0, y_px=200.0, confidence=0.6)
    moved = replace(here, x_px=300.5, confidence=0.7)
    there = straight_detection(frame_id=1, x_px=700.0, y_px=600.0, confidence=0.9)
    pairs = pair_candidates(
        found(here, there), found(rejected=((moved, NotAStreak(kind="no line")),))
    )
    seen = [
        (p.was and p.was.detection.confidence, p.now and p.now.detection.confidence) for p in pairs
    ]
    assert seen == [(0.9, None), (0.6, 0.7)]
    assert pairs[1].now is not None
    assert (pairs[1].now.is_taken, pairs[1].now.reason) == (
        False,
        "no line fits the light in the box",
    )
    assert pairs[0].latest_detection == there
    assert pairs[1].latest_detection == moved


def test_two_parallel_streaks_are_not_taken_for_one_another():
    one = straight_detection(frame_id=1, x_px=300.0, y_px=200.0, confidence=0.6)
    other = replace(one, y_px=204.0, y_a_px=204.0, y_b_px=204.0, width_px=4.0)
    one = replace(one, width_px=4.0)
    pairs = pair_candidates(found(one, other), found(other, one))
    assert all(p.was and p.now and p.was.detection == p.now.detection for p in pairs)
    assert all(pair.is_as_recorded for pair in pairs)


def test_a_frame_never_reduced_has_only_what_is_seen_now():
    now = straight_detection(frame_id=1, confidence=0.6)
    (pair,) = pair_candidates(None, found(now))
    assert pair.was is None
    assert not pair.is_as_recorded
    assert pair_candidates(None, None) == ()
