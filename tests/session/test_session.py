"""A session as one writer makes it and any reader sees it."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from rsoconsole.base import SessionError
from rsoconsole.config import Config, load_config
from rsoconsole.records import (
    DONE,
    TABLES,
    CameraMode,
    Cause,
    Closeup,
    CycleTiming,
    Detection,
    Detections,
    Event,
    FollowedAgain,
    Frame,
    FrameTaken,
    LedgerName,
    LightStep,
    Measurement,
    Miss,
    Missed,
    Mixture,
    NotAStreak,
    NotFollowed,
    NotSolved,
    NotTaken,
    OperatorAction,
    ParameterChange,
    Photometry,
    Rejection,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    StreakLight,
    TrackState,
    Wcs,
)
from rsoconsole.records.columns import tables_markdown
from rsoconsole.session import (
    SessionReader,
    SessionWriter,
    list_sessions,
    new_session_folder,
    verify_session,
)
from rsoconsole.session.log.codec import KINDS
from rsoconsole.session.log.schema import SCHEMA_VERSION, VIEWS
from rsoconsole.session.upkeep.store import size_bytes
from rsoconsole.session.writing import writer as writer_module
from rsoconsole.session.writing.worker import RecordingFaults
from tests.nights.leap_samples import leap_of, pass_of
from tests.nights.orbit_night import estimate_of, identified_of
from tests.nights.pair_records import expected_of, pair_of, pairs_of, unseen_of

T0_UTC_NS = 1_800_000_000_123_456_789
ABOUT = {"title": "test", "model_sha256": "ab" * 32, "clock_offset_s": 0.002}

STREAK = Detection(
    frame_id=1,
    confidence=0.9,
    x_px=10.5,
    y_px=20.25,
    x_a_px=0.1,
    y_a_px=0.2,
    x_b_px=0.3,
    y_b_px=0.4,
    box_px=(1.0, 2.0, 3.0, 4.0),
    length_px=118.5,
    width_px=2.5,
    snr=12.0,
    sigma_along_px=0.4,
    sigma_across_px=0.1,
    is_clipped=True,
    kind="crossing",
    sigma_angle_deg=0.25,
    object_class="aircraft",
    class_probability=0.75,
    modulation_period_px=12.5,
    modulation_period_s=0.125,
    light_offset_px=-0.75,
    light_sigma_px=0.375,
    light_length_px=119.5,
    light_length_sigma_px=1.25,
    modulation_depth=0.5,
    train=3,
    method="line",
)
MEASUREMENT = Measurement(
    measurement_id="1-0",
    frame_id=1,
    t_mid_utc_ns=T0_UTC_NS + 5,
    ra_icrs_deg=320.1,
    dec_icrs_deg=-4.8,
    cov_sky_arcsec2=(1.0, 0.25, 2.0),
    x_px=10.5,
    y_px=20.25,
    confidence=0.9,
    source="network",
    ends_icrs_deg=((320.0, -4.8), (320.2, -4.8)),
)
NIGHT = (
    FrameTaken(
        frame_id=1,
        name="one.fits",
        t_start_utc_ns=T0_UTC_NS,
        exposure_s=10.0,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=320.0,
        pointing_dec_icrs_deg=None,
        camera=CameraMode(binning="1x1", x0_px=0, y0_px=8, gain=139.0, time_by="gps"),
    ),
    Detections(
        frame_id=1,
        width_px=4656,
        height_px=3520,
        detections=(STREAK, replace(STREAK, confidence=0.5)),
        rejected=(Rejection(detection=STREAK, reason=NotAStreak(kind="no line")),),
        stage_ms={"network": 12.5},
        star_count=212,
        star_fwhm_px=2.75,
        background_adu=410.5,
        star_flux_adu=5200.0,
    ),
    Photometry(
        frame_id=1,
        zero_point_mag=21.25,
        zero_point_sigma_mag=0.02,
        zero_point_stars=31,
        zero_point_scatter_mag=0.03,
        colour_term=0.1,
        colour_term_sigma=0.02,
        limiting_mag=14.5,
        streaks=(
            StreakLight(
                measurement_id="1-0",
                flux_adu=9000.0,
                flux_sigma_adu=90.0,
                rate_adu_s=900.0,
                rate_sigma_adu_s=9.0,
                band="V",
                mag=13.8,
                mag_sigma=0.03,
                mag_sigma_colour=0.01,
                steps=(LightStep(t_s=-4.5, rate_adu_s=880.0, rate_sigma_adu_s=40.0),),
            ),
        ),
    ),
    Solution(
        frame_id=1,
        wcs=Wcs(
            crpix_x_px=1.0,
            crpix_y_px=2.0,
            crval_ra_deg=3.0,
            crval_dec_deg=4.0,
            cd=(1e-4, 0.0, 0.0, 1e-4),
            sip_a=((2, 0, 1e-9),),
        ),
        ra_icrs_deg=320.1,
        dec_icrs_deg=-4.8,
        scale_arcsec_px=1.264,
        rotation_deg=0.5,
        is_flipped=False,
        matched=40,
        rms_arcsec=0.3,
        path="full",
        ms=33.0,
    ),
    NotSolved(frame_id=2, reason="7 stars, 8 needed", ms=4.0),
    MEASUREMENT,
    NotFollowed(frame_id=1, measurement=MEASUREMENT, reason=NotTaken.by_gate(31.0, 11.83)),
    TrackState(
        track_id=1,
        measurement_id="1-0",
        kind="updated",
        frame_id=1,
        t_utc_ns=T0_UTC_NS + 5,
        x=(320.1, 0.00417, -4.8, 1e-6),
        P=tuple(tuple(float(i == j) for j in range(4)) for i in range(4)),
        nis=1.5,
        innovation_arcsec=(0.5, -0.25),
        sigma_innovation_arcsec=(1.0, 2.0),
        replaces=7,
        begun_through=("1-3",),
        filter_nis=41.3,
        shared_with=2,
        mixture=Mixture(
            motion_probabilities=(("parallel", 0.9), ("any orbit", 0.1)),
            acceleration_arcsec_s2=1e-6,
            acceleration_sigma_arcsec_s2=1e-7,
            turn=-0.1,
            turn_sigma=0.01,
            scatter_s=0.2,
            scatter_low_s=0.15,
            scatter_high_s=0.25,
        ),
    ),
    SlewCommand(
        frame_id=1, ra_icrs_deg=320.2, dec_icrs_deg=-4.8, t_aim_utc_ns=T0_UTC_NS, reason="follow"
    ),
    Miss(frame_id=2, reason=Missed(kind="not solved", detail="cloud")),
    StateChange(
        frame_id=2,
        before="TRACK",
        after="COAST",
        reason=Cause(kind="missed", missed=Missed(kind="no detection")),
        kept_track_id=1,
    ),
    ParameterChange(name="detector.tau", before=0.1, after=0.2, by="operator"),
    OperatorAction(verb="slew", arguments={"ra": 1.5}, outcome=DONE, by="console"),
    CycleTiming(frame_id=1, stage_ms={"detect": 30.0, "solve": 40.0}),
    Event(level="alarm", text="the dome is closed"),
    Closeup(frame_id=1, x0_px=1872, y0_px=1405, width_px=256, height_px=192),
    Ruling(frame_id=1, taken=MEASUREMENT, refused=(MEASUREMENT,), by="operator"),
    FollowedAgain(frame_id=1),
    estimate_of(
        1,
        nis=1.25,
        innovation_arcsec=(0.5, -0.25),
        sigma_innovation_arcsec=(1.0, 2.0),
        is_guide=True,
    ),
    replace(
        identified_of(1),
        not_catalogued=0.1,
        ledger=LedgerName(
            number=3,
            name="UCT 3",
            t_last_utc_ns=T0_UTC_NS,
            probability=0.8,
            separation_arcsec=9.0,
        ),
    ),
    pairs_of(1, pair_of(1, 1, 2)),
    expected_of(1, unseen_of()),
    leap_of(4),
    pass_of(),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "night"


@pytest.fixture
def writer(folder: Path) -> Iterator[SessionWriter]:
    session = SessionWriter.create(folder, Config(), ABOUT)
    yield session
    session.close()


def small_frame(frame_id: int = 1, shift_bits: int = 4) -> Frame:
    rng = np.random.default_rng(frame_id)
    counts = rng.normal(60, 4, (96, 128)).astype(np.uint16)
    counts[10, 20] = 4095
    return Frame(
        frame_id=frame_id,
        name="a.fits",
        pixels=counts << np.uint16(shift_bits),
        header={
            "DATE-OBS": "2026-09-12T04:05:00.000",
            "EXPTIME": 10.0,
            "GAIN": 0,
            "BZERO": 32768,
            "NOTES": (),
            "BAD": float("nan"),
            "OBSERVER": "Müller",
        },
    )


def read_back(path: Path) -> tuple[np.ndarray, fits.Header]:
    with fits.open(path) as hdus:
        return np.array(hdus[1].data), hdus[1].header


def test_a_night_is_read_back_record_for_record_in_order(
    writer: SessionWriter, folder: Path
) -> None:
    assert {type(record).__name__ for record in NIGHT} == set(KINDS)
    places = [writer.append(record, T0_UTC_NS + i) for i, record in enumerate(NIGHT)]
    assert places == list(range(1, len(NIGHT) + 1))
    assert writer.flush()
    reader = SessionReader(folder)
    expected = [(i + 1, T0_UTC_NS + i, record) for i, record in enumerate(NIGHT)]
    assert list(reader.records()) == expected
    assert reader.last_seq() == len(NIGHT)
    assert [record for _, _, record in reader.records(kinds=(Measurement,))] == [MEASUREMENT]
    assert [seq for seq, _, _ in reader.records(since_seq=12)] == list(range(13, len(NIGHT) + 1))
    writer.close()
    assert list(reader.records()) == expected
    assert writer.faults == ()


def test_the_views_spread_every_record_into_columns(writer: SessionWriter, folder: Path) -> None:
    for record in NIGHT:
        writer.append(record, T0_UTC_NS)
    writer.flush()
    reader = SessionReader(folder)
    rows = {name: reader.view_rows(name) for name in VIEWS}
    assert {name: len(found) for name, found in rows.items()} == {
        **dict.fromkeys(VIEWS, 1),
        "detections": 2,
        "timings": 2,
    }
    assert rows["frames"][0]["t_start_utc_ns"] == T0_UTC_NS
    assert (rows["frames"][0]["gain"], rows["frames"][0]["time_by"]) == (139.0, "gps")
    assert [row["confidence"] for row in rows["detections"]] == [0.9, 0.5]
    assert rows["detections"][0]["y1_px"] == 4.0
    assert rows["rejections"][0] | {"seq": 0} == rows["rejections"][0] | {
        "seq": 0,
        "x_px": 10.5,
        "reason": "no line fits the light in the box",
        "is_clipped": 1,
        "kind": "crossing",
        "object_class": "aircraft",
        "class_probability": 0.75,
        "modulation_period_s": 0.125,
        "train": 3,
    }
    assert rows["image_quality"][0]["star_count"] == 212
    assert rows["photometry"][0]["zero_point_mag"] == 21.25
    assert rows["magnitudes"][0]["mag"] == 13.8
    assert json.loads(rows["magnitudes"][0]["steps"])[0]["t_s"] == -4.5
    assert rows["measurements"][0]["t_mid_utc_ns"] == T0_UTC_NS + 5
    assert rows["measurements"][0]["cov_en_arcsec2"] == 0.25
    assert rows["track"][0]["step"] == "updated"
    assert rows["track"][0]["dec_icrs_deg"] == -4.8
    assert rows["track"][0]["innovation_north_arcsec"] == -0.25
    assert rows["orbits"][0]["vy_gcrs_km_s"] == estimate_of(1).v_gcrs_km_s[1]
    assert json.loads(rows["orbits"][0]["covariance"])[5][5] == estimate_of(1).covariance[5][5]
    assert rows["identifications"][0]["runner_up_name"] == "SES 10"
    assert rows["states"][0]["after"] == "COAST"
    assert rows["states"][0]["kept_track_id"] == 1
    assert rows["parameters"][0]["after"] == 0.2
    assert json.loads(rows["actions"][0]["arguments"]) == {"ra": 1.5}
    assert {(row["stage"], row["ms"]) for row in rows["timings"]} == {
        ("detect", 30.0),
        ("solve", 40.0),
    }
    # A column whose place in the record is misspelt would be empty.
    empty = {c for name in VIEWS for row in rows[name] for c, value in row.items() if value is None}
    assert empty == {
        "pointing_dec_icrs_deg",
        "file",
        "file_bytes",
        "not_kept_because",
        "preview",
        "file_sha256",
        "frame_id",
        "track_id",
        "first_measurement_id",
    }


def test_a_view_that_is_not_there_is_named(writer: SessionWriter, folder: Path) -> None:
    with pytest.raises(SessionError, match="no view 'sqlite_master'; it has frames"):
        SessionReader(folder).view_rows("sqlite_master")


def test_the_session_says_what_it_began_with(folder: Path) -> None:
    config = Config.model_validate({"detector": {"tau": 0.3}, "site": {"name": 'A "B" \\ é'}})
    SessionWriter.create(folder, config, {**ABOUT, "versions": {"numpy": "2"}}).close()
    reader = SessionReader(folder)
    about = reader.read_meta()
    assert about["title"] == "test"
    assert about["versions"] == {"numpy": "2"}
    assert about["schema_version"] == SCHEMA_VERSION
    assert about["is_closed"] is True
    assert reader.config() == config
    assert load_config(folder / "config.toml") == config


def test_a_closed_session_is_one_database_file_that_a_read_only_place_can_hold(
    writer: SessionWriter, folder: Path
) -> None:
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.close()
    writer.close()
    assert sorted(p.name for p in folder.iterdir()) == [
        "closeups",
        "config.toml",
        "frames",
        "previews",
        "session.db",
    ]
    with sqlite3.connect(folder / "session.db") as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    connection.close()


def test_a_reader_at_work_does_not_keep_the_session_from_closing(
    writer: SessionWriter, folder: Path
) -> None:
    for i in range(2000):
        writer.append(Miss(frame_id=i, reason=Missed(kind="no detection")), T0_UTC_NS + i)
    writer.flush()
    reading = SessionReader(folder).records()
    next(reading)
    writer.close()
    assert writer.faults == ()
    assert not (folder / "session.db-wal").exists()
    assert sum(1 for _ in reading) == 1999


def test_a_reader_follows_a_live_session_without_gap_or_repetition(
    writer: SessionWriter, folder: Path
) -> None:
    seen: list[int] = []
    is_over = threading.Event()

    def follow() -> None:
        reader, last = SessionReader(folder), 0
        while not (is_over.is_set() and last == reader.last_seq()):
            for seq, _, record in reader.records(since_seq=last):
                assert isinstance(record, Miss)
                assert record.frame_id == seq
                seen.append(seq)
                last = seq
            is_over.wait(0.01)

    thread = threading.Thread(target=follow)
    thread.start()
    for i in range(3000):
        writer.append(
            Miss(frame_id=i + 1, reason=Missed(kind="not solved", detail="x" * 50)), T0_UTC_NS
        )
        if i % 500 == 0:
            writer.flush()
    writer.close()
    is_over.set()
    thread.join(30)
    assert seen == list(range(1, 3001))


def test_records_from_many_threads_keep_one_order(writer: SessionWriter, folder: Path) -> None:
    def append(by: int) -> None:
        for i in range(200):
            writer.append(
                Miss(frame_id=i, reason=Missed(kind="not solved", detail=str(by))), T0_UTC_NS
            )

    threads = [threading.Thread(target=append, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    writer.close()
    found = list(SessionReader(folder).records())
    assert [seq for seq, _, _ in found] == list(range(1, 801))
    for by in "0123":
        own = [
            r.frame_id
            for _, _, r in found
            if isinstance(r, Miss) and r.reason == Missed(kind="not solved", detail=by)
        ]
        assert own == list(range(200))


def test_a_record_that_cannot_be_kept_leaves_an_alarm_in_its_place(
    writer: SessionWriter, folder: Path
) -> None:
    writer.append(replace(MEASUREMENT, ra_icrs_deg=float("nan")), T0_UTC_NS)
    writer.append(MEASUREMENT, -1)
    writer.append(MEASUREMENT, T0_UTC_NS)
    assert writer.flush()
    found = [record for _, _, record in SessionReader(folder).records()]
    assert isinstance(found[0], Event)
    assert "Measurement.ra_icrs_deg is nan" in found[0].text
    assert isinstance(found[1], Event)
    assert found[2] == MEASUREMENT
    assert len(writer.faults) == 1


@pytest.mark.parametrize("shift_bits", [0, 2, 4])
def test_a_frame_comes_back_pixel_for_pixel_with_its_header(
    writer: SessionWriter, folder: Path, shift_bits: int
) -> None:
    frame = small_frame(shift_bits=shift_bits)
    assert writer.save_frame(frame)
    writer.close()
    assert writer.faults == ()
    path = SessionReader(folder).frame_path(1)
    assert path is not None
    pixels, header = read_back(path)
    assert np.array_equal(pixels, frame.pixels)
    assert header["DATE-OBS"] == "2026-09-12T04:05:00.000"
    assert header["EXPTIME"] == 10.0
    assert "OBSERVER" not in header


def test_real_valued_and_flat_frames_are_kept_without_loss(
    writer: SessionWriter, folder: Path
) -> None:
    rng = np.random.default_rng(1)
    real = Frame(frame_id=1, name="", pixels=rng.normal(size=(70, 90)).astype(np.float32))
    flat = Frame(frame_id=2, name="", pixels=np.zeros((64, 64), np.uint16))
    full = Frame(frame_id=3, name="", pixels=np.full((64, 64), 65535, np.uint16))
    for frame in (real, flat, full):
        writer.save_frame(frame)
    writer.close()
    reader = SessionReader(folder)
    for frame in (real, flat, full):
        path = reader.frame_path(frame.frame_id)
        assert path is not None
        assert np.array_equal(read_back(path)[0], frame.pixels)


def test_empty_low_bits_are_not_paid_for(writer: SessionWriter, folder: Path) -> None:
    writer.save_frame(small_frame(1, shift_bits=0))
    writer.save_frame(small_frame(2, shift_bits=4))
    writer.close()
    sizes = [row[0] for row in _files(folder, "SELECT bytes FROM files ORDER BY frame_id")]
    assert sizes[1] <= sizes[0]


def test_previews_are_pictures(writer: SessionWriter, folder: Path) -> None:
    grey = np.arange(60 * 80, dtype=np.uint32).reshape(60, 80).astype(np.uint8)
    colour = np.zeros((4, 5, 3), np.uint8)
    colour[..., 0] = 200
    writer.save_preview(1, grey)
    writer.save_preview(2, colour)
    writer.close()
    reader = SessionReader(folder)
    assert np.array_equal(cv2.imread(str(reader.preview_path(1)), cv2.IMREAD_UNCHANGED), grey)
    # OpenCV reads blue, green, red.
    assert cv2.imread(str(reader.preview_path(2)))[0, 0].tolist() == [0, 0, 200]
    assert reader.preview_path(3) is None


def test_frames_that_come_too_fast_are_given_up_and_said_so(
    writer: SessionWriter, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_go_on = threading.Event()
    compress = writer_module.compress_frame

    def slow(frame: Frame) -> bytes:
        may_go_on.wait(20)
        return compress(frame)

    monkeypatch.setattr(writer_module, "compress_frame", slow)
    taken = [writer.save_frame(small_frame(i)) for i in range(1, 6)]
    assert taken == [True, True, True, False, False]
    assert any("exposure 5 is not kept" in fault for fault in writer.faults)
    may_go_on.set()
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.close()
    reader = SessionReader(folder)
    assert [reader.frame_path(i) is not None for i in range(1, 6)] == taken
    reasons = _files(folder, "SELECT frame_id, reason FROM files WHERE path IS NULL")
    assert [frame_id for frame_id, _ in reasons] == [4, 5]


def test_where_only_the_last_frames_are_kept_the_disk_they_take_is_bounded(folder: Path) -> None:
    last = Config.model_validate({"session": {"keep_frames": "last"}})
    writer = SessionWriter.create(folder, last, {})
    count = writer_module.LAST_KEPT + 5
    for number in range(1, count + 1):
        assert writer.save_frame(small_frame(number))
        assert writer._frames.drain(20)
    kept = frozenset(range(6, count + 1))
    # One file may wait for the next frame to be removed: nothing names it any more.
    assert len(list((folder / "frames").iterdir())) <= writer_module.LAST_KEPT + 1
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.close()
    assert not writer.faults
    assert len(list((folder / "frames").iterdir())) == writer_module.LAST_KEPT
    reader = SessionReader(folder)
    assert reader.frames_with_pixels() == kept
    assert "of the last 12 frames alone" in str(reader.missing_pixels_reason(1))
    assert verify_session(folder).is_sound


@pytest.mark.parametrize(
    "error",
    [cv2.error("no coder"), fits.VerifyError("a bad card"), MemoryError(), SystemExit("odd")],
    ids=lambda error: type(error).__name__,
)
def test_whatever_a_frame_raises_is_its_reason_and_the_next_one_is_kept(
    writer: SessionWriter, folder: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def fails(*_arguments: object) -> bytes:
        raise error

    compress, encode = writer_module.compress_frame, writer_module.encode_preview
    monkeypatch.setattr(writer_module, "compress_frame", fails)
    monkeypatch.setattr(writer_module, "encode_preview", fails)
    # As many as may wait, and once more: a thread that ended would take no more.
    for frame_id in range(1, 13):
        writer.save_frame(small_frame(frame_id))
        writer.save_preview(frame_id, np.zeros((4, 5), np.uint8))
        assert writer._frames.drain(10)
        assert writer._previews.drain(10)
    assert len(writer.faults) == 2
    assert all(type(error).__name__ in fault for fault in writer.faults)
    monkeypatch.setattr(writer_module, "compress_frame", compress)
    monkeypatch.setattr(writer_module, "encode_preview", encode)
    writer.save_frame(small_frame(13))
    writer.save_preview(13, np.zeros((4, 5), np.uint8))
    writer.close()
    assert writer.faults == ()
    lost = _files(folder, "SELECT frame_id, role, reason FROM files WHERE path IS NULL")
    assert len(lost) == 24
    assert {str(reason).split(":", maxsplit=1)[0] for _, _, reason in lost} == {
        type(error).__name__
    }
    assert SessionReader(folder).frame_path(13) is not None
    assert SessionReader(folder).preview_path(13) is not None


def test_a_card_that_fits_cannot_carry_costs_no_pixel(writer: SessionWriter, folder: Path) -> None:
    header = {"NO GOOD": 1.0, "GAIN": 2.5, "ARRIVED_MONOTONIC_S": 3.0, "NOTES": ("a", "b")}
    writer.save_frame(replace(small_frame(), header=header))
    writer.close()
    path = SessionReader(folder).frame_path(1)
    assert path is not None
    pixels, kept = read_back(path)
    assert np.array_equal(pixels, small_frame().pixels)
    assert kept["GAIN"] == 2.5
    assert not {"NO GOOD", "NOTES", "ARRIVED_MONOTONIC_S"} & set(kept)


def test_when_disk_is_short_frames_go_first_and_the_log_goes_on(folder: Path) -> None:
    alarms: list[str] = []
    writer = SessionWriter.create(
        folder, Config(), ABOUT, on_fault=alarms.append, reserve_bytes=10**18
    )
    writer.save_frame(small_frame())
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.close()
    assert len(alarms) == 1
    assert "the frame of exposure 1 is not kept: only" in alarms[0]
    assert writer.faults == tuple(alarms)
    reader = SessionReader(folder)
    assert reader.last_seq() == 1
    assert "MB of disk are free" in reader.view_rows("frames")[0]["not_kept_because"]


def test_an_alarm_that_fails_does_not_end_the_record(folder: Path) -> None:
    def broken(text: str) -> None:
        raise RuntimeError("no bell")

    writer = SessionWriter.create(folder, Config(), ABOUT, on_fault=broken, reserve_bytes=10**18)
    writer.save_frame(small_frame(1))
    writer.append(replace(MEASUREMENT, x_px=float("inf")), T0_UTC_NS)
    writer.append(MEASUREMENT, T0_UTC_NS)
    assert writer.flush()
    writer.close()
    assert any("no bell" in fault for fault in writer.faults)


FULL_DISK = """
import json, resource, sys
from pathlib import Path
import numpy as np
from rsoconsole.config import Config
from rsoconsole.records import Missed
from rsoconsole.records import Miss
from rsoconsole.records import Frame
from rsoconsole.session import SessionWriter

alarms = []
writer = SessionWriter.create(Path(sys.argv[1]), Config(), {}, on_fault=alarms.append)
writer.append(Miss(frame_id=1, reason=Missed(kind="not solved", detail="before")), 1)
assert writer.flush()
soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
# No file may grow from here on, as on a full disk.
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
noise = np.random.default_rng(0).integers(0, 65535, (256, 256), dtype=np.uint16)
writer.save_frame(Frame(frame_id=1, name="", pixels=noise))
for i in range(2, 5001):
    writer.append(Miss(frame_id=i, reason=Missed(kind="not solved", detail="x" * 100)), i)
is_flushed_when_full = writer.flush(1.0)
assert writer._frames.drain(60)
faults_when_full = writer.faults
resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
is_flushed_when_free = writer.flush(20.0)
writer.save_frame(Frame(frame_id=2, name="", pixels=noise))
writer.close()
print(json.dumps([is_flushed_when_full, faults_when_full, alarms, is_flushed_when_free,
                  writer.faults]))
"""


def test_a_full_disk_raises_nothing_and_loses_no_record_once_it_has_room(folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(folder)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    when_full, faults, alarms, when_free, faults_at_end = json.loads(done.stdout)
    assert when_full is False
    assert any("log cannot be written" in fault for fault in faults)
    assert any("exposure 1 is not kept" in alarm for alarm in alarms)
    assert len(alarms) == 2
    assert when_free is True
    assert faults_at_end == []
    reader = SessionReader(folder)
    assert [seq for seq, _, _ in reader.records()] == list(range(1, 5001))
    assert reader.frame_path(1) is None
    assert reader.frame_path(2) is not None
    assert not list((folder / "frames").glob("*.part"))


def test_the_gravest_fault_is_named_first_whichever_came_first() -> None:
    faults = RecordingFaults(None)
    for place in ("preview", "frame", "log"):
        faults.report(place, place)
    assert faults.texts() == ("log", "frame", "preview")
    faults.clear("log")
    faults.report("frame", "another frame")
    assert faults.texts() == ("another frame", "preview")


KILLED = """
import sys, itertools
from pathlib import Path
from rsoconsole.config import Config
from rsoconsole.records import Missed
from rsoconsole.records import Miss
from rsoconsole.session import SessionWriter

writer = SessionWriter.create(Path(sys.argv[1]), Config(), {})
for i in itertools.count(1):
    writer.append(Miss(frame_id=i, reason=Missed(kind="not solved", detail="x" * 100)), i)
    if i % 1000 == 0:
        assert writer.flush()
        print(i, flush=True)
"""


def test_a_killed_engine_leaves_every_record_that_was_flushed(folder: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(folder)], stdout=subprocess.PIPE, text=True
    ) as engine:
        assert engine.stdout is not None
        flushed = [int(engine.stdout.readline()) for _ in range(4)][-1]
        os.kill(engine.pid, signal.SIGKILL)
        engine.wait(10)
    reader = SessionReader(folder)
    found = [seq for seq, _, _ in reader.records()]
    assert len(found) >= flushed
    assert found == list(range(1, len(found) + 1))
    assert reader.read_meta()["is_closed"] is False
    assert list_sessions(folder.parent)[0].fault is None


def test_a_session_whose_folder_vanishes_is_a_fault_and_no_error(folder: Path) -> None:
    import shutil

    writer = SessionWriter.create(folder, Config(), ABOUT)
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.flush()
    shutil.rmtree(folder)
    writer.save_frame(small_frame())
    writer.close(timeout_s=5)
    assert any("exposure 1 is not kept" in fault for fault in writer.faults)


def test_a_record_after_the_end_is_a_fault_and_no_error(writer: SessionWriter) -> None:
    writer.close()
    writer.append(NIGHT[0], T0_UTC_NS)
    assert any("after the session was closed" in fault for fault in writer.faults)
    assert not writer.save_frame(small_frame())


def test_a_session_is_never_begun_over_another(writer: SessionWriter, folder: Path) -> None:
    with pytest.raises(SessionError, match="already holds a session: name another folder"):
        SessionWriter.create(folder, Config(), ABOUT)


def test_a_place_that_cannot_be_written_is_refused_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match=r"no session can be begun in .*--session"):
        SessionWriter.create(tmp_path / "file" / "night", Config(), ABOUT)


def test_missing_foreign_damaged_and_later_sessions_are_told_apart(
    tmp_path: Path, writer: SessionWriter, folder: Path
) -> None:
    with pytest.raises(SessionError, match="does not exist"):
        SessionReader(tmp_path / "nothing")
    with pytest.raises(SessionError, match=r"holds no session\.db"):
        SessionReader(tmp_path)
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    connection = sqlite3.connect(foreign / "session.db")
    connection.execute("CREATE TABLE log (x)")
    connection.close()
    with pytest.raises(SessionError, match="is not a session of rsoconsole"):
        SessionReader(foreign)
    (foreign / "session.db").write_bytes(b"not a database at all" * 100)
    with pytest.raises(SessionError, match="is damaged or no session"):
        SessionReader(foreign)
    writer.close()
    connection = sqlite3.connect(folder / "session.db")
    connection.execute(f"PRAGMA user_version={SCHEMA_VERSION + 1}")
    connection.close()
    with pytest.raises(SessionError, match="written by another version of rsoconsole"):
        SessionReader(folder)


def test_a_session_cut_in_the_middle_says_that_it_is_damaged(
    writer: SessionWriter, folder: Path
) -> None:
    for i in range(5000):
        writer.append(
            Miss(frame_id=i, reason=Missed(kind="not solved", detail="x" * 100)), T0_UTC_NS
        )
    writer.close()
    database = folder / "session.db"
    content = database.read_bytes()
    database.write_bytes(content[: len(content) // 2])
    with pytest.raises(SessionError, match=r"damaged|cannot be read"):
        list(SessionReader(folder).records())
    assert list_sessions(folder.parent)[0].fault is not None


def test_sessions_are_listed_with_what_is_in_them(writer: SessionWriter, folder: Path) -> None:
    (folder.parent / "broken").mkdir()
    (folder.parent / "broken" / "session.db").write_bytes(b"x" * 5000)
    (folder.parent / "no session").mkdir()
    writer.append(NIGHT[0], T0_UTC_NS)
    writer.append(NIGHT[1], T0_UTC_NS + 9)
    writer.close()
    broken, night = list_sessions(folder.parent)
    assert broken.fault is not None
    assert "damaged" in broken.fault
    assert broken.size_bytes == 5000
    assert (night.title, night.frames, night.records) == ("test", 1, 2)
    assert (night.t_first_utc_ns, night.t_last_utc_ns) == (T0_UTC_NS, T0_UTC_NS + 9)
    assert night.is_closed
    assert night.size_bytes == size_bytes(folder) > 10_000
    assert list_sessions(folder.parent / "nowhere") == ()


def test_a_new_session_is_named_by_instant_and_title_and_never_twice(tmp_path: Path) -> None:
    t_utc_ns = 1_789_185_900_999_999_999  # 2026-09-12T04:05:00.999999999Z
    first = new_session_folder(tmp_path, "Intelsat-14: überholt / é", t_utc_ns)
    assert first == tmp_path / "20260912T040500Z-intelsat-14-uberholt-e"
    first.mkdir()
    again = new_session_folder(tmp_path, "Intelsat-14: überholt / é", t_utc_ns)
    assert again.name == first.name + "-2"
    assert new_session_folder(tmp_path, "../..", t_utc_ns).name == "20260912T040500Z"


def _files(folder: Path, sql: str) -> list[tuple[object, ...]]:
    connection = sqlite3.connect(folder / "session.db")
    try:
        return connection.execute(sql).fetchall()
    finally:
        connection.close()


def test_the_documented_views_are_those_there_are_column_by_column(
    writer: SessionWriter, folder: Path
) -> None:
    text = (Path(__file__).parents[2] / "sessions" / "README.md").read_text(encoding="utf-8")
    assert tables_markdown() in text
    assert f"## The database (schema {SCHEMA_VERSION})" in text
    with sqlite3.connect(folder / "session.db") as connection:
        for name in VIEWS:
            columns = [row[1] for row in connection.execute(f"PRAGMA table_info({name})")]
            assert columns == [column.name for column in TABLES[name].columns]
    connection.close()
