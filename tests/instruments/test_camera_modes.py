"""Joined pixels and parts of the sensor: as INDI's drivers offer them, from order to frame."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import IndiWire, Instruments, connect_instruments
from rsoconsole.records import Frame
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory

NS = 1_000_000_000
WIDTH_PX, HEIGHT_PX = 640, 480
STUB = "tests.rigs.stub_stage:open_plain"


@contextlib.contextmanager
def connected(
    observatory: Observatory, folder: Path, size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)
) -> Iterator[Instruments]:
    config = Config.model_validate(
        {
            "indi": {"port": observatory.port, "simulated": True},
            "optics": {"width_px": size_px[0], "height_px": size_px[1]},
        }
    )
    with connect_instruments(config, log_dir=folder) as instruments:
        yield instruments


@pytest.fixture(scope="module")
def observatory() -> Iterator[Observatory]:
    with start_observatory("intelsat-14", 1, 0, width_px=WIDTH_PX, height_px=HEIGHT_PX) as running:
        yield running


def take(instruments: Instruments, frame_id: int) -> Frame:
    clock, camera = instruments.clock, instruments.camera
    camera.start_exposure(5.0, frame_id)
    clock.wait_until(clock.now_utc_ns() + 6 * NS)
    return camera.wait_frame(60.0)


def numbers(observatory: Observatory, name: str) -> dict[str, float]:
    wire = IndiWire(observatory.host, observatory.port)
    wire.ask(observatory.camera_name, name)
    vector = wire.wait(lambda each: each.name == name, 5.0)
    wire.close()
    assert vector is not None
    return {key: float(value) for key, value in vector.values.items()}


def set_frame(wire: IndiWire, observatory: Observatory, part: dict[str, int]) -> None:
    """Ask for it, and wait for the camera's answer."""
    values = {name: str(value) for name, value in part.items()}
    wire.ask(observatory.camera_name, "CCD_FRAME")
    assert wire.wait(lambda each: each.name == "CCD_FRAME", 5.0) is not None
    wire.new("Number", observatory.camera_name, "CCD_FRAME", values)
    assert wire.wait(lambda each: each.name == "CCD_FRAME", 5.0) is not None


def test_joined_pixels_are_fewer_coarser_and_told_in_the_header(observatory, tmp_path):
    with connected(observatory, tmp_path) as instruments:
        whole = take(instruments, 1)
        assert instruments.camera.set_binning(2) == 2
        joined = take(instruments, 2)
        assert instruments.camera.set_binning(1) == 1
        after = take(instruments, 3)
    assert (joined.width_px, joined.height_px) == (WIDTH_PX // 2, HEIGHT_PX // 2)
    assert joined.scale_arcsec_px == pytest.approx(2.0 * whole.scale_arcsec_px)
    assert [each.camera.binning for each in (whole, joined, after)] == ["1x1", "2x2", "1x1"]
    assert (after.width_px, after.height_px) == (WIDTH_PX, HEIGHT_PX)
    # A mean of four numbers: the sky stays, its noise halves within a quarter of itself.
    assert np.median(joined.pixels) == pytest.approx(np.median(whole.pixels), rel=0.05)
    assert spread(joined) == pytest.approx(spread(whole) / 2.0, rel=0.25)


def spread(frame: Frame) -> float:
    values = frame.pixels.astype(float)
    off = values - np.median(values)
    # Numbers come in steps of 16: beside the stars, the mean square knows better.
    return float(np.std(off[np.abs(off) < 6.0 * max(np.median(np.abs(off)), 16.0)]))


def test_a_camera_is_left_as_it_was_found(observatory, tmp_path):
    with connected(observatory, tmp_path) as instruments:
        instruments.camera.set_binning(2)
        assert numbers(observatory, "CCD_BINNING")["HOR_BIN"] == 2.0
    assert numbers(observatory, "CCD_BINNING") == {"HOR_BIN": 1.0, "VER_BIN": 1.0}


def test_a_process_made_again_knows_what_the_camera_was_found_as(observatory, tmp_path):
    with connected(observatory, tmp_path) as instruments:
        instruments.camera.set_binning(2)
        instruments.camera.restart()
        assert take(instruments, 1).width_px == WIDTH_PX // 2
        instruments.camera.set_binning(1)
        assert take(instruments, 2).width_px == WIDTH_PX


def test_what_an_engine_that_was_killed_has_left_is_not_taken_for_the_cameras_own(
    observatory, tmp_path
):
    """The configured width says how many pixels are joined by the operator's own wish: none."""
    wire = IndiWire(observatory.host, observatory.port)
    wire.ask(observatory.camera_name, "CCD_BINNING")
    assert wire.wait(lambda each: each.name == "CCD_BINNING", 5.0) is not None
    left = {"HOR_BIN": "2", "VER_BIN": "2"}
    wire.new("Number", observatory.camera_name, "CCD_BINNING", left)
    assert wire.wait(lambda each: each.name == "CCD_BINNING", 5.0) is not None
    wire.close()
    with connected(observatory, tmp_path) as instruments:
        instruments.camera.set_binning(2)
        assert numbers(observatory, "CCD_BINNING")["HOR_BIN"] == 2.0
        instruments.camera.set_binning(1)
        assert numbers(observatory, "CCD_BINNING")["HOR_BIN"] == 1.0


def test_what_a_camera_cannot_is_said_with_the_remedy(tmp_path):
    with (
        start_observatory("plain", 1, 0, stage=STUB) as plain,
        connected(plain, tmp_path) as instruments,
        pytest.raises(InstrumentError, match=r"did not join 2 x 2 pixels .* leap\.binning to 1"),
    ):
        instruments.camera.set_binning(2)


def whole_of(observatory: Observatory) -> dict[str, float]:
    return dict(zip(("X", "Y", "WIDTH", "HEIGHT"), (0.0, 0.0, WIDTH_PX, HEIGHT_PX), strict=True))


@pytest.mark.parametrize("binning", [1, 2])
def test_a_subframe_is_the_middle_of_the_sensor(observatory, tmp_path, binning):
    with connected(observatory, tmp_path) as instruments:
        instruments.camera.set_binning(binning)
        assert instruments.camera.set_subframe(0.5) == pytest.approx(0.5)
        part = take(instruments, 1)
        assert instruments.camera.set_subframe(1.0) == 1.0
        whole = take(instruments, 2)
    # Sides are multiples of 16 joined pixels.
    assert (part.width_px, part.height_px) == ((320, 240) if binning == 1 else (160, 112))
    corner = (part.camera.x0_px, part.camera.y0_px)
    assert corner == pytest.approx((160 // binning, 120 // binning), abs=16)
    assert (whole.width_px, whole.height_px) == (WIDTH_PX // binning, HEIGHT_PX // binning)
    assert part.camera.binning == whole.camera.binning == f"{binning}x{binning}"


def test_a_camera_is_left_with_all_of_its_sensor(observatory, tmp_path):
    with connected(observatory, tmp_path) as instruments:
        instruments.camera.set_subframe(0.5)
        assert numbers(observatory, "CCD_FRAME")["WIDTH"] == 320.0
    assert numbers(observatory, "CCD_FRAME") == whole_of(observatory)


def ask_for(observatory: Observatory, x: int, y: int, width: int, height: int) -> None:
    wire = IndiWire(observatory.host, observatory.port)
    set_frame(wire, observatory, {"X": x, "Y": y, "WIDTH": width, "HEIGHT": height})
    wire.close()


def test_a_subframe_that_a_killed_engine_has_left_is_given_back(observatory, tmp_path):
    """The configured size is that of all of the sensor, and what was left is about its middle."""
    ask_for(observatory, 160, 128, 320, 240)
    with connected(observatory, tmp_path) as instruments:
        assert numbers(observatory, "CCD_FRAME") == whole_of(observatory)
        assert take(instruments, 1).width_px == WIDTH_PX


def test_a_part_of_the_operators_own_is_left_alone_and_given_back(observatory, tmp_path):
    own = {"X": 112.0, "Y": 64.0, "WIDTH": 480.0, "HEIGHT": 320.0}
    ask_for(observatory, 112, 64, 480, 320)
    try:
        with connected(observatory, tmp_path, (480, 320)) as instruments:
            assert numbers(observatory, "CCD_FRAME") == own
            assert take(instruments, 1).width_px == 480
            assert instruments.camera.set_subframe(0.5) == pytest.approx(0.5)
            part = take(instruments, 2)
        assert (part.width_px, part.height_px) == (240, 160)
        assert numbers(observatory, "CCD_FRAME") == own
        with (
            connected(observatory, tmp_path, (400, 320)) as instruments,
            pytest.raises(InstrumentError, match=r"reads 480 x 320 .* not optics\.width_px"),
        ):
            instruments.camera.set_subframe(0.5)
    finally:
        ask_for(observatory, 0, 0, WIDTH_PX, HEIGHT_PX)


def test_a_part_of_the_sensor_is_that_part_and_says_where_it_lies(observatory, tmp_path):
    part = {"X": 100, "Y": 60, "WIDTH": 304, "HEIGHT": 208}
    ask_for(observatory, *part.values())
    try:
        with connected(observatory, tmp_path, (304, 208)) as instruments:
            frame = take(instruments, 1)
            # The last rows lie behind the sensor: such a part is refused, and the mode stays.
            wire = IndiWire(observatory.host, observatory.port)
            set_frame(wire, observatory, part | {"Y": 400})
            wire.close()
            same = take(instruments, 2)
    finally:
        ask_for(observatory, 0, 0, WIDTH_PX, HEIGHT_PX)
    assert (frame.width_px, frame.height_px) == (304, 208)
    assert (frame.camera.x0_px, frame.camera.y0_px) == (100, 60)
    assert (same.width_px, same.height_px) == (304, 208)
