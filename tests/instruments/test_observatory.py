"""The simulated observatory: one seed, one sky, whatever the pace."""

import math
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import ARRIVED_KEY, connect_instruments
from rsoconsole.records import Frame
from rsoconsole.simulator import fits_bytes, start_observatory
from rsoconsole.sky import separation_deg
from tests.truth.frame_truth import truth_from_json

NS = 1_000_000_000
ONE_ARCSEC = 1 / 3600
WIDTH_PX, HEIGHT_PX = 640, 480


def short_night(folder: Path, *, seed: int, speed: float) -> tuple[list[Frame], list[str]]:
    """Two slews, three frames of a small sensor; frames and lines of truth."""
    truth_path = folder / f"truth_{seed}_{speed}.jsonl"
    frames = []
    with start_observatory(
        "intelsat-14", seed, speed, truth_path, width_px=WIDTH_PX, height_px=HEIGHT_PX
    ) as observatory:
        config = Config.model_validate(
            {
                "indi": {"port": observatory.port, "simulated": True},
                "optics": {"width_px": WIDTH_PX, "height_px": HEIGHT_PX},
            }
        )
        with connect_instruments(config, log_dir=folder) as instruments:
            clock, mount, camera = instruments.clock, instruments.mount, instruments.camera
            start = mount.report()
            for frame_id, ra_offset_deg in ((1, 0.0), (2, 1.0), (3, -0.5)):
                now_utc_ns = clock.now_utc_ns()
                ra_deg = start.ra_icrs_deg + ra_offset_deg
                mount.slew(ra_deg, start.dec_icrs_deg, now_utc_ns)
                clock.wait_until(now_utc_ns + 6 * NS)
                assert not mount.report(clock.now_utc_ns()).is_slewing
                camera.start_exposure(10.0, frame_id)
                clock.wait_until(now_utc_ns + 17 * NS)
                frames.append(camera.wait_frame(60.0))
    return frames, truth_path.read_text().splitlines()


def cards(frame: Frame) -> dict[str, Any]:
    """The header without the wall clock's instant of its arrival."""
    return {key: value for key, value in frame.header.items() if key != ARRIVED_KEY}


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Frame], list[str]]:
    return short_night(tmp_path_factory.mktemp("night"), seed=1, speed=math.inf)


@pytest.mark.nightly("a night twice")
def test_the_same_seed_gives_the_same_pixels_at_any_speed(night, tmp_path):
    at_once, truth_at_once = night
    paced, truth_paced = short_night(tmp_path, seed=1, speed=1000.0)
    other, _ = short_night(tmp_path, seed=2, speed=0)
    assert truth_at_once == truth_paced
    for a, b, c in zip(at_once, paced, other, strict=True):
        assert a.t_start_utc_ns == b.t_start_utc_ns
        assert cards(a) == cards(b)
        assert np.array_equal(a.pixels, b.pixels)
        assert not np.array_equal(a.pixels, c.pixels)


def test_truth_names_what_the_header_does_not(night):
    frames, lines = night
    for frame, line in zip(frames, lines, strict=True):
        truth = truth_from_json(line)
        assert truth.t_start_utc_ns == frame.t_start_utc_ns
        error_deg = separation_deg(
            frame.pointing_ra_icrs_deg,
            frame.pointing_dec_icrs_deg,
            truth.boresight_ra_icrs_deg,
            truth.boresight_dec_icrs_deg,
        )
        # The mount points a tenth of a degree wrong, and its header does not know.
        assert 60 * ONE_ARCSEC < error_deg < 0.25
        assert not any("TRUTH" in key or "WCS" in key for key in frame.header)


def test_the_observatory_listens_on_loopback_only():
    with start_observatory("plain", 1, 0, stage="tests.rigs.stub_stage:open_plain") as observatory:
        listening = [
            line.split()[1]
            for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
            if line.split()[3] == "0A" and line.split()[1].endswith(f":{observatory.port:04X}")
        ]
    assert listening == [f"0100007F:{observatory.port:04X}"]


def test_an_unknown_scenario_is_an_error_that_lists_the_known():
    with pytest.raises(InstrumentError, match="intelsat-14"):
        start_observatory("andromeda", 1, 0)


def test_a_client_that_hangs_up_leaves_no_trace():
    with start_observatory("plain", 1, 0, stage="tests.rigs.stub_stage:open_plain") as observatory:
        # More than the server has seats for, one after another.
        for _ in range(30):
            with socket.create_connection((observatory.host, observatory.port), 5.0) as client:
                client.sendall(b'<getProperties version="1.7" device="Simulated Clock"/>')
                heard = b""
                while b"SIM_CLOCK" not in heard:
                    heard += client.recv(65536)


def test_fits_written_for_indi_is_what_astropy_reads():
    from astropy.io import fits

    pixels = np.random.default_rng(1).integers(0, 65536, (48, 64), dtype=np.uint16)
    cards = {"EXPTIME": 10.0, "DATE-OBS": "2023-06-22T02:13:20.300000", "XBINNING": 1}
    with fits.HDUList.fromstring(bytes(fits_bytes(pixels, cards))) as hdus:
        hdus.verify("exception")
        assert np.array_equal(hdus[0].data, pixels)
        assert {key: hdus[0].header[key] for key in cards} == cards
