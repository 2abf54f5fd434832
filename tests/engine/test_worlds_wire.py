"""What a world does to a camera and a mount as a client on the wire sees them."""

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import connect_instruments
from rsoconsole.simulator import binned_optics, start_observatory, world_from
from rsoconsole.sky import describe_field, iso_to_utc_ns, separation_deg, wcs_from_cards
from tests.truth.frame_truth import truth_from_json

NS = 1_000_000_000
WIDTH_PX, HEIGHT_PX = 160, 128
EXPOSURE_S = 2.0
FRAME_SOON_S = 60.0


@contextmanager
def telescope(folder, world):
    """The instruments of an observatory in this world, and what its truth says so far."""
    truth_path = folder / "truth.jsonl"
    optics = Config.model_validate(
        {"optics": {"width_px": WIDTH_PX, "height_px": HEIGHT_PX}}
    ).optics
    with start_observatory(
        *("intelsat-14", 1, 0, truth_path),
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        world=world_from(world).non_default_settings(),
    ) as observatory:
        config = Config.model_validate(
            {
                "indi": {"port": observatory.port, "simulated": True},
                "optics": binned_optics(optics, world_from(world)).model_dump(),
            }
        )
        with connect_instruments(config, log_dir=folder) as instruments:

            def truths():
                return [truth_from_json(line) for line in truth_path.read_text().splitlines()]

            yield SimpleNamespace(
                clock=instruments.clock,
                mount=instruments.mount,
                camera=instruments.camera,
                truths=truths,
            )


def take(telescope, frame_id, timeout_s=FRAME_SOON_S):
    """One frame, asked for as the engine does; and the simulated seconds from order to frame."""
    begun_ns = telescope.clock.now_utc_ns()
    telescope.camera.start_exposure(EXPOSURE_S, frame_id)
    telescope.clock.wait_until(begun_ns + round((0.3 + EXPOSURE_S) * NS))
    frame = telescope.camera.wait_frame(timeout_s)
    return frame, (telescope.clock.now_utc_ns() - begun_ns) / NS


def test_a_late_frame_comes_so_much_later_and_a_slow_shutter_too(tmp_path):
    world = {
        "frames": {"late_rate": 0.5, "late_s": 7.0},
        "shutter": {"latency_s": 0.4, "bias_s": 0.1},
    }
    with telescope(tmp_path, world) as there:
        taken_s = np.array([take(there, number)[1] for number in range(1, 13)])
    on_time_s = 0.3 + EXPOSURE_S + 0.5
    is_late = taken_s > on_time_s + 1.0
    assert taken_s[~is_late] == pytest.approx(on_time_s, abs=1e-3)
    assert taken_s[is_late] == pytest.approx(on_time_s + 7.0, abs=1e-3)
    assert 2 <= is_late.sum() <= 10


def test_a_failed_frame_is_told_of_and_the_next_one_comes(tmp_path):
    with telescope(tmp_path, {"frames": {"failed_rate": 0.5}}) as there:
        words = []
        for number in range(1, 13):
            try:
                take(there, number)
            except InstrumentError as error:
                words.append(str(error))
        assert len(there.truths()) == 12 - len(words)
    assert 2 <= len(words) <= 10
    assert all("no usable frame" in each for each in words)


def test_a_dropped_frame_never_comes_and_nothing_is_said(tmp_path):
    with (
        telescope(tmp_path, {"frames": {"dropped_rate": 1.0}}) as there,
        pytest.raises(InstrumentError, match="gave no frame in 1 s"),
    ):
        take(there, 1, timeout_s=1.0)


def test_a_header_in_whole_seconds_binned_pixels_and_a_turned_camera(tmp_path):
    world = {
        "shutter": {"round_s": 1.0},
        "sensor": {"binning": 2, "bayer": False},
        "optics": {"camera_angle_deg": 40.0, "rotation_deg_h": 30.0, "scale_error": 0.02},
        "mount": {"arrival_arcsec": 600.0},
    }
    errors_deg, rotations_deg, times_s = [], [], []
    with telescope(tmp_path, world) as there:
        start = there.mount.report()
        for number, offset_deg in enumerate((0.0, 1.0, -1.0, 2.0, 0.5, -0.5), start=1):
            now_utc_ns = there.clock.now_utc_ns()
            there.mount.slew(start.ra_icrs_deg + offset_deg, start.dec_icrs_deg, now_utc_ns)
            there.clock.wait_until(now_utc_ns + 60 * NS)
            frame, _ = take(there, number)
            truth = there.truths()[-1]
            assert frame.pixels.shape == (HEIGHT_PX // 2, WIDTH_PX // 2)
            header = frame.header
            assert len(header["DATE-OBS"]) == len("2023-06-23T05:30:00")
            assert iso_to_utc_ns(header["DATE-OBS"]) == truth.t_start_utc_ns
            assert 0 <= truth.t_open_utc_ns - truth.t_start_utc_ns < 1.1 * NS
            assert (header["XBINNING"], header["XPIXSZ"], header["PIXSIZE1"]) == (2, 7.6, 3.8)
            # The driver believes in the configured focal length.
            assert header["FOCALLEN"] == 620.0
            assert frame.scale_arcsec_px == pytest.approx(2.0 * 1.2642, rel=1e-3)
            plate = describe_field(wcs_from_cards(truth.wcs_cards), WIDTH_PX // 2, HEIGHT_PX // 2)
            assert plate.scale_arcsec_px == pytest.approx(2.0 * 1.2642 / 1.02, rel=1e-3)
            rotations_deg.append(plate.rotation_deg)
            times_s.append(truth.t_mid_utc_ns / NS)
            errors_deg.append(
                separation_deg(
                    frame.pointing_ra_icrs_deg,
                    frame.pointing_dec_icrs_deg,
                    truth.boresight_ra_icrs_deg,
                    truth.boresight_dec_icrs_deg,
                )
            )
    rate_deg_h, at_first_deg = np.polyfit(np.array(times_s) - times_s[0], rotations_deg, 1)
    assert rate_deg_h * 3600.0 == pytest.approx(30.0, rel=0.01)
    assert at_first_deg == pytest.approx(40.0 + 30.0 / 60.0, abs=0.1)
    # Slews that miss by some 600 arcsec, about a pointing model of 0.1 deg.
    assert np.std(errors_deg) * 3600.0 > 60.0


def test_a_colour_camera_says_so_and_a_settling_mount_trails_its_stars(tmp_path):
    world = {"sensor": {"bayer": True}, "mount": {"settle_s": 20.0, "settle_arcsec": 400.0}}
    with telescope(tmp_path, world) as there:
        now_utc_ns = there.clock.now_utc_ns()
        start = there.mount.report()
        there.mount.slew(start.ra_icrs_deg + 1.0, start.dec_icrs_deg, now_utc_ns)
        while there.mount.report(there.clock.now_utc_ns()).is_slewing:
            there.clock.wait_until(there.clock.now_utc_ns() + NS // 5)
        frame, _ = take(there, 1)
        early = there.truths()[-1]
        there.clock.wait_until(there.clock.now_utc_ns() + 30 * NS)
        take(there, 2)
        late = there.truths()[-1]
    assert frame.header["BAYERPAT"] == "RGGB"
    # From some 1.5 s after the arrival: about 370 arcsec are still to go.
    crept_deg = separation_deg(
        early.boresight_ra_icrs_deg,
        early.boresight_dec_icrs_deg,
        late.boresight_ra_icrs_deg,
        late.boresight_dec_icrs_deg,
    )
    assert crept_deg * 3600.0 == pytest.approx(370.0, abs=25.0)
