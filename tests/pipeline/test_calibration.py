"""Configured masters: chosen, applied by every verb and replay, told once where they do not fit."""

import gzip
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import Config, config_faults, load_config
from rsoconsole.engine.doctor.checks import check_calibration
from rsoconsole.pipeline import Reprocessor, read_frame_records, read_recorded_frame
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.records import Event, Frame
from rsoconsole.session import SessionReader
from rsoconsole.vision import without_mosaic
from tests.drawn.uneven_camera import STREAK, UnevenCamera
from tests.nights.samples import SAMPLE

SHAPE = HEIGHT, WIDTH = 120, 160
OFFSET, SKY, SIGMA = 500.0, 1000.0, 20.0
UNSOLVED = "[solver]\ndeadline_s = 0.5\nblind_deadline_s = 0.5\n"
"""The drawn stars are nobody's."""


def master(path: Path, pixels: Any, **cards: Any) -> Path:
    """A FITS file as a camera's software writes masters: real numbers, 32 bits."""
    header = fits.Header([(key.replace("_", "-"), value) for key, value in cards.items()])
    fits.writeto(path, np.asarray(pixels, np.float32), header)
    return path


def config_of(**calibration: Any) -> Config:
    return Config.model_validate({"calibration": calibration, "detector": {"threads": 1}})


def current(seed: int = 3) -> np.ndarray:
    """Electrons of ten seconds: most pixels few, some many."""
    return np.random.default_rng(seed).exponential(60.0, SHAPE)


def exposed(dark_adu: np.ndarray, **other: Any) -> Frame:
    noise = np.random.default_rng(1).normal(SKY, SIGMA, SHAPE)
    pixels = np.clip(np.rint(noise + dark_adu), 0, 65535).astype(np.uint16)
    return Frame(**({"frame_id": 1, "name": "a", "pixels": pixels, "exposure_s": 10.0} | other))


def left_over(frame: Frame) -> float:
    """One sigma of what is not noise of the sky, in units of that."""
    return float(np.sqrt(max(np.var(frame.pixels.astype(float)) / SIGMA**2 - 1.0, 0.0)))


def warnings_of(told: Any) -> list[str]:
    return [each.words for each in told if each.level == "warning"]


# -- which master is taken ---------------------------------------------------------------------


def test_without_masters_the_frame_is_the_camera_s_own():
    frame = exposed(current() + OFFSET)
    prepared, told = Calibration(Config()).prepare(frame)
    assert prepared is frame
    assert told == ()


@pytest.mark.parametrize(
    ("exposure_s", "name"), [(10.0, "ten.fits (10"), (10.1, "ten.fits (10"), (2.0, "two.fits (2")]
)
def test_of_several_darks_that_of_the_exposure_and_the_size_is_taken(tmp_path, exposure_s, name):
    darks = [
        master(tmp_path / "binned.fits", np.ones((64, 80)), EXPTIME=exposure_s),
        master(tmp_path / "two.fits", current() / 5 + OFFSET, EXPTIME=2.0),
        master(tmp_path / "ten.fits", current() + OFFSET, EXPTIME=10.0),
    ]
    frame = exposed(current() * exposure_s / 10.0 + OFFSET, exposure_s=exposure_s)
    assert left_over(frame) > 0.5
    even, told = Calibration(config_of(darks=darks)).prepare(frame)
    assert left_over(even) < 0.1
    (only,) = told
    assert only.level == "info"
    assert only.words.startswith(f"calibrated with dark {name} s")


def test_of_darks_of_one_exposure_that_of_the_temperature_is_taken_and_another_is_told(tmp_path):
    darks = [
        master(tmp_path / "warm.fits", 8 * current() + OFFSET, EXPTIME=10.0, CCD_TEMP=8.0),
        master(tmp_path / "cold.fits", current() + OFFSET, EXPTIME=10.0, CCD_TEMP=-10.0),
    ]
    frame = exposed(current() + OFFSET, header={"CCD-TEMP": -9.4})
    even, told = Calibration(config_of(darks=darks)).prepare(frame)
    assert left_over(even) < 0.1
    assert warnings_of(told) == []
    _, told = Calibration(config_of(darks=darks[:1])).prepare(frame)
    (words,) = warnings_of(told)
    assert "taken at 8 °C, the frame at -9 °C" in words


def test_another_exposure_is_told_and_with_a_bias_scaled(tmp_path):
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0)
    bias = master(tmp_path / "bias.fits", np.full(SHAPE, OFFSET))
    frame = exposed(current() * 3.0 + OFFSET, exposure_s=30.0)
    even, told = Calibration(config_of(darks=[dark])).prepare(frame)
    (words,) = warnings_of(told)
    assert "dark.fits is of 10 s, the frame of 30 s" in words
    assert "calibration.bias" in words
    assert left_over(even) > 4.0
    even, told = Calibration(config_of(darks=[dark], bias=bias)).prepare(frame)
    assert warnings_of(told) == []
    assert "dark current times 3" in told[-1].words
    assert left_over(even) < 0.1


def test_a_frame_without_an_exposure_gets_the_dark_and_a_word(tmp_path):
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0)
    even, told = Calibration(config_of(darks=[dark])).prepare(
        exposed(current() + OFFSET, exposure_s=None)
    )
    assert left_over(even) < 0.1
    assert ["an exposure that is not known" in words for words in warnings_of(told)] == [True]


@pytest.mark.parametrize(
    ("key", "own", "frames", "is_told"),
    [
        ("GAIN", 139, 139.0, False),
        ("GAIN", 139, 200, True),
        ("ROWORDER", "TOP-DOWN", "BOTTOM-UP", True),
        ("OFFSET", 21, None, False),
    ],
)
def test_another_gain_or_order_of_rows_is_told(tmp_path, key, own, frames, is_told):
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0, **{key: own})
    header = {} if frames is None else {key: frames}
    _, told = Calibration(config_of(darks=[dark])).prepare(
        exposed(current() + OFFSET, header=header)
    )
    assert [key in words for words in warnings_of(told)] == [True] * is_told


# -- what does not fit -------------------------------------------------------------------------


def test_masters_of_another_size_leave_the_frame_as_it_is(tmp_path):
    dark = master(tmp_path / "dark.fits", np.ones((240, 320)), EXPTIME=10.0)
    flat = master(tmp_path / "flat.fits", np.ones((240, 320)))
    frame = exposed(current() + OFFSET)
    same, told = Calibration(config_of(darks=[dark], flat=flat)).prepare(frame)
    assert same is frame
    assert len(warnings_of(told)) == len(told) == 2
    assert all("does not fit a frame of 160 x 120 px" in words for words in warnings_of(told))
    # A dark that fits is used though the flat does not.
    dark = master(tmp_path / "own.fits", current() + OFFSET, EXPTIME=10.0)
    even, told = Calibration(config_of(darks=[dark], flat=flat)).prepare(frame)
    assert left_over(even) < 0.1
    assert ["calibration.flat" in words for words in warnings_of(told)] == [True]


def test_a_part_of_the_sensor_gets_its_part_of_the_masters(tmp_path):
    lamp = np.linspace(0.8, 1.2, WIDTH) * np.ones(SHAPE)
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0)
    flat = master(tmp_path / "flat.fits", 20_000.0 * lamp)
    calibration = Calibration(config_of(darks=[dark], flat=flat))
    sky = np.random.default_rng(1).normal(SKY, SIGMA, SHAPE) * lamp
    whole = np.rint(sky + current() + OFFSET).astype(np.uint16)
    even, _ = calibration.prepare(exposed(current(), pixels=whole))
    header = {"XBINNING": 1, "YBINNING": 1, "XORGSUBF": 32, "YORGSUBF": 16}
    part = exposed(current(), pixels=whole[16:96, 32:128], header=header)
    even_part, told = calibration.prepare(part)
    assert warnings_of(told) == []
    of_whole = even.pixels[16:96, 32:128].astype(float)
    # What stays in the frame is the median of the dark's own part.
    apart = even_part.pixels.astype(float) - of_whole
    assert np.percentile(np.abs(apart - np.median(apart)), 99) <= 2.0
    # A camera that says of the whole, too, where it begins is given the same pixels.
    of_all, _ = calibration.prepare(
        exposed(current(), pixels=whole, header=header | {"XORGSUBF": 0, "YORGSUBF": 0})
    )
    assert np.array_equal(of_all.pixels, even.pixels)
    # Joined pixels are others, and a frame that does not say where it lies has no part.
    for header_of in ({**header, "XBINNING": 2, "YBINNING": 2}, {}):
        other = exposed(current(), pixels=whole[16:96, 32:128], header=header_of)
        assert any("does not fit" in words for words in warnings_of(calibration.prepare(other)[1]))


def test_a_flat_alone_is_not_divided_by(tmp_path):
    flat = master(tmp_path / "flat.fits", np.full(SHAPE, 2.0))
    frame = exposed(current() + OFFSET)
    same, told = Calibration(config_of(flat=flat)).prepare(frame)
    assert same is frame
    assert ["is not used" in words for words in warnings_of(told)] == [True]


def test_files_that_cannot_be_used_are_named_and_the_others_go_on(tmp_path):
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0)
    black = master(tmp_path / "black.fits", np.zeros(SHAPE))
    (tmp_path / "torn.fits").write_bytes(dark.read_bytes()[:4000])
    (tmp_path / "words.fits").write_text("no picture")
    gone = [tmp_path / name for name in ("missing.fits", "torn.fits", "words.fits")]
    calibration = Calibration(config_of(darks=[dark, *gone], flat=black, bias=tmp_path))
    calibration.make_ready(Config())
    even, told = calibration.prepare(exposed(current() + OFFSET))
    assert left_over(even) < 0.1
    words = warnings_of(told)
    assert len(words) == 5
    for name in ("missing.fits does not exist", "torn.fits", "words.fits", "no light", "directory"):
        assert sum(name in each for each in words) == 1
    dark.unlink()
    again, told = Calibration(config_of(darks=[dark])).prepare(exposed(current() + OFFSET))
    assert left_over(again) > 1.0
    assert len(warnings_of(told)) == 1


def test_a_master_that_vanishes_in_the_night_costs_no_frame(tmp_path):
    two = master(tmp_path / "two.fits", current() / 5 + OFFSET, EXPTIME=2.0)
    ten = master(tmp_path / "ten.fits", current() + OFFSET, EXPTIME=10.0)
    calibration = Calibration(config_of(darks=[two, ten]))
    assert left_over(calibration.prepare(exposed(current() + OFFSET))[0]) < 0.1
    two.unlink()
    frame = exposed(current() / 5 + OFFSET, exposure_s=2.0)
    same, told = calibration.prepare(frame)
    assert same is frame
    assert "two.fits does not exist" in warnings_of(told)[0]
    ten.unlink()  # what is ready needs its file no more
    assert left_over(calibration.prepare(exposed(current() + OFFSET))[0]) < 0.1


def test_pixels_that_are_nan_count_as_those_about_them(tmp_path):
    dark, flat = current() + OFFSET, np.full(SHAPE, 3.0)
    dark[5, 7] = flat[50, 60] = flat[10, 11] = np.nan
    flat[10, 12] = np.inf
    calibration = Calibration(
        config_of(
            darks=[master(tmp_path / "dark.fits", dark, EXPTIME=10.0)],
            flat=master(tmp_path / "flat.fits", flat),
        )
    )
    truth = current() + OFFSET
    truth[5, 7] = np.median(truth)
    even, told = calibration.prepare(exposed(truth))
    assert warnings_of(told) == []
    assert left_over(even) < 0.1
    assert abs(even.pixels[50, 60] - SKY - np.median(truth)) < 5 * SIGMA


@pytest.mark.parametrize("how", ["gz", "fpack", "uint16"])
def test_compressed_masters_give_the_same_as_plain_ones(tmp_path, how):
    pixels = np.rint(current() + OFFSET).astype(np.float32)
    plain = master(tmp_path / "plain.fits", pixels, EXPTIME=10.0, CCD_TEMP=-5.0)
    other = tmp_path / f"dark.fits.{how}"
    if how == "gz":
        other.write_bytes(gzip.compress(plain.read_bytes()))
    else:
        header = fits.getheader(plain)
        data = pixels.astype(np.uint16)
        unit = fits.CompImageHDU(data, header) if how == "fpack" else fits.ImageHDU(data, header)
        fits.HDUList([fits.PrimaryHDU(), unit]).writeto(other)
    frame = exposed(current() + OFFSET, header={"CCD-TEMP": -5.0})
    one, said = Calibration(config_of(darks=[plain])).prepare(frame)
    two, told = Calibration(config_of(darks=[other])).prepare(frame)
    assert np.array_equal(one.pixels, two.pixels)
    assert [each.words.replace(other.name, plain.name) for each in told] == [
        each.words for each in said
    ]


def test_a_mosaic_is_evened_out_after_the_calibration(tmp_path):
    dark = current() * 20.0 + OFFSET
    frame = exposed(dark, header={"BAYERPAT": "RGGB"})
    path = master(tmp_path / "dark.fits", dark, EXPTIME=10.0)
    even, _ = Calibration(config_of(darks=[path])).prepare(frame)
    first = replace(frame, pixels=Calibration(config_of(darks=[path]))._calibrated(frame)[0].pixels)
    assert np.array_equal(even.pixels, without_mosaic(first).pixels)
    assert left_over(even) < 0.2
    assert left_over(without_mosaic(frame)) > 5.0


# -- verbs, sessions, replays ------------------------------------------------------------------


def printed(*arguments: str | Path) -> Result:
    """What the program prints, run in this process."""
    return CliRunner().invoke(app, [str(each) for each in arguments])


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a bad camera, its masters, and a configuration that names them."""
    folder = tmp_path_factory.mktemp("uneven")
    camera = UnevenCamera.made(0)
    for number in (1, 2):
        header = fits.Header([("EXPTIME", 10.0), ("DATE-OBS", f"2023-06-22T03:0{number}:00")])
        fits.writeto(folder / f"frame{number}.fits", camera.frame().pixels, header)
    dark, flat = camera.masters()
    header = fits.Header([("EXPTIME", 10.0)])
    unit = fits.CompImageHDU(np.rint(dark).astype(np.uint16), header)
    fits.HDUList([fits.PrimaryHDU(), unit]).writeto(folder / "dark.fits.fz")
    master(folder / "flat.fits", flat)
    (folder / "config.toml").write_text(
        f"{UNSOLVED}[calibration]\ndarks = ['{folder}/dark.fits.fz']\nflat = '{folder}/flat.fits'\n"
        f"[optics]\nwidth_px = {camera.dark_e.shape[1]}\nheight_px = {camera.dark_e.shape[0]}\n"
    )
    return folder


def found_at(answer: dict[str, Any]) -> list[bool]:
    x, y = (STREAK[0] + STREAK[2]) / 2.0, (STREAK[1] + STREAK[3]) / 2.0
    return [math.hypot(each["x"] - x, each["y"] - y) < 4.0 for each in answer["detections"]]


def test_detect_finds_with_masters_what_it_misses_without(night: Path):
    frames = sorted(night.glob("frame*.fits"))
    run = printed("detect", "--json", "--config", night / "config.toml", *frames)
    assert run.exit_code == 0, run.stderr
    for answer in map(json.loads, run.stdout.splitlines()):
        assert found_at(answer) == [True]
        (note,) = [each for each in answer["notes"] if "calibrated with" in each]
        assert "dark dark.fits.fz (10 s, 960 x 720 px), flat flat.fits (960 x 720 px)" in note
    assert run.stderr.count("calibrated with") == 1
    (night / "plain.toml").write_text(UNSOLVED)
    run = printed("detect", "--json", "--config", night / "plain.toml", frames[0])
    for answer in map(json.loads, run.stdout.splitlines()):
        assert True not in found_at(answer)
        assert not any("calibrat" in each for each in answer["notes"])


def test_a_missing_master_is_one_line_and_no_traceback(night: Path, tmp_path: Path):
    path = tmp_path / "config.toml"
    path.write_text(UNSOLVED + "[calibration]\ndarks = ['/nowhere/dark.fits']\n")
    frames = sorted(night.glob("frame*.fits"))
    for verb in ("detect", "solve"):
        run = printed(verb, "--config", path, *frames)
        assert run.exit_code == 0
        assert "Traceback" not in run.stderr
        assert run.stderr.count("/nowhere/dark.fits does not exist") == 1
    run = printed("config", "check", "--config", path)
    assert run.exit_code == 1
    assert "calibration.darks: /nowhere/dark.fits does not exist" in run.stdout


def test_process_puts_the_masters_in_force_on_record_once(night: Path, tmp_path: Path):
    frames = sorted(night.glob("frame*.fits"))
    config = night / "config.toml"
    run = printed("process", "--config", config, "--session", tmp_path / "s", *frames)
    assert run.exit_code == 0, run.stderr
    events = [each for _, _, each in SessionReader(tmp_path / "s").records(kinds=(Event,))]
    (told,) = [each for each in events if "calibrated with" in each.text]
    assert (told.level, told.frame_id) == ("info", 1)
    assert not any(each.level != "info" and "calibration" in each.text for each in events)


def test_a_kept_frame_is_processed_again_with_the_masters(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    """A dark that holds the frame's own light leaves nothing to be found."""
    folder = Path(shutil.copytree(SAMPLE, tmp_path / "night"))
    recorded = read_frame_records(SessionReader(folder), 9)
    frame = read_recorded_frame(recorded)
    dark = master(tmp_path / "dark.fits", frame.pixels, EXPTIME=frame.exposure_s)
    plain, calibrated = (
        Reprocessor(replace(recorded, config=each), frame)
        for each in (
            recorded.config,
            recorded.config.model_copy(update={"calibration": config_of(darks=[dark]).calibration}),
        )
    )
    (there,) = plain.run().now.detections.detections
    assert there.confidence > 0.5
    found = calibrated.run()
    assert found.now.detections.detections == ()
    assert not np.array_equal(
        plain.network_maps("fast")[0].values, calibrated.network_maps("fast")[0].values
    )
    assert "calibration" not in caplog.text
    dark.unlink()
    gone = Reprocessor(replace(recorded, config=calibrated._recorded.config), frame)
    assert gone.run().now.measurements == plain.run().now.measurements
    assert "dark.fits does not exist" in caplog.text


# -- configuration and doctor ------------------------------------------------------------------


def test_settings_are_paths_and_checked(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    path = tmp_path / "config.toml"
    path.write_text("[calibration]\ndarks = ['~/dark.fits']\nflat = '~/flat.fits'\n")
    config = load_config(path)
    assert config.calibration.darks == (tmp_path / "dark.fits",)
    assert [fault.name for fault in config_faults(path)] == [
        "calibration.darks",
        "calibration.flat",
    ]
    for name in ("dark", "flat"):
        (tmp_path / f"{name}.fits").touch()
    assert config_faults(path) == ()
    path.write_text(f"[calibration]\nflat = '~/flat.fits'\nbias = '{tmp_path}'\n")
    (fault,) = config_faults(path)
    assert fault.problem == f"{tmp_path} is no file"
    path.write_text("[calibration]\nflat = '~/flat.fits'\n")
    (fault,) = config_faults(path)
    assert "is not used" in fault.problem
    path.write_text("[calibration]\ndark = '~/dark.fits'\n")
    (fault,) = config_faults(path)
    assert fault.remedy == "did you mean calibration.darks?"


def test_the_doctor_says_what_is_loaded_and_whether_it_fits(tmp_path):
    def check(width_px: int = WIDTH, exposure_s: float = 10.0, **calibration: Any):
        optics = {"width_px": width_px, "height_px": HEIGHT}
        table = {"optics": optics, "calibration": calibration}
        return check_calibration(
            Config.model_validate(table | {"exposure": {"exposure_s": exposure_s}})
        )

    assert check().ok is True
    assert "no master frames" in check().detail
    dark = master(tmp_path / "dark.fits", current() + OFFSET, EXPTIME=10.0, CCD_TEMP=-10)
    flat = master(tmp_path / "flat.fits", np.full(SHAPE, 2.0))
    bias = master(tmp_path / "bias.fits", np.full(SHAPE, OFFSET))
    well = check(darks=[dark], flat=flat)
    assert (well.ok, well.remedy) == (True, "")
    assert (
        well.detail == "dark dark.fits (10 s, -10 °C, 160 x 120 px); flat flat.fits (160 x 120 px)"
    )
    binned = check(2 * WIDTH, darks=[dark])
    assert binned.ok is None
    assert "does not fit the camera's 320 x 120 px" in binned.detail
    longer = check(exposure_s=30.0, darks=[dark])
    assert longer.ok is None
    assert "calibration.bias" in longer.remedy
    assert check(exposure_s=30.0, darks=[dark], bias=bias).ok is True
    assert check(flat=flat).ok is None
    current_only = master(tmp_path / "current.fits", current(), EXPTIME=10.0)
    assert "below the bias" in check(darks=[current_only], bias=bias).detail
    missing = check(darks=[dark, tmp_path / "no.fits"])
    assert missing.ok is False
    assert "no.fits does not exist" in missing.detail
    assert missing.remedy
