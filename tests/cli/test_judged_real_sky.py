"""Debian's indiserver, mount and camera under a sky of ours: a world that holds what it says."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.cli.judge.summary import read_truth
from rsoconsole.instruments import read_frame
from rsoconsole.records import FrameTaken, Solution
from rsoconsole.session import SessionReader
from tests.real_sky import real_sky_night
from tests.real_sky.gsc_sky import Sky, streaks
from tests.real_sky.real_sky_judge import truth_of
from tests.truth.ccd_law import CcdLaw

pytestmark = [pytest.mark.nights, pytest.mark.indi_bin, pytest.mark.timeout(1500)]
FRAMES = 12
SCATTER_S = 0.2
SIDEREAL_ARCSEC_S = 15.04


@pytest.fixture(scope="module")
def night():
    """Twelve frames in real time: figures and the folder with frames and truth."""
    fault = real_sky_night.lacks()
    if fault is not None:
        pytest.skip(fault)
    # Not pytest's own: sockets have short names.
    with tempfile.TemporaryDirectory(prefix="sky") as folder:
        figures = real_sky_night.run_night(
            FRAMES, 1, SCATTER_S, cadence_s=15.0, keep_frames="all", folder=Path(folder)
        )
        one = figures["objects"][0]
        print(json.dumps({**one, "states": figures["states_in_order"]}))
        yield figures, Path(folder)


def test_the_simulators_settings_are_those_of_the_law(night):
    told = json.loads((night[1] / "camera.json").read_text())
    law = CcdLaw()
    settings = told["SIMULATOR_SETTINGS"]
    assert (settings["SIM_XRES"], settings["SIM_YRES"]) == (law.width_px, law.height_px)
    assert settings["SIM_XSIZE"] == settings["SIM_YSIZE"] == law.pixel_um
    assert settings["SIM_MAXVAL"] == law.max_adu
    assert settings["SIM_SATURATION"] == law.saturation_mag
    assert settings["SIM_LIMITINGMAG"] == law.limiting_mag
    assert settings["SIM_NOISE"] == law.noise_adu
    assert settings["SIM_ROTATION"] == law.rotation_deg
    for name in ("SIM_POLAR", "SIM_POLARDRIFT", "SIM_PEPERIOD", "SIM_PEMAX", "SIM_OAGOFFSET"):
        assert settings[name] == 0.0
    assert told["SIM_FOCUSING"]["SIM_SEEING"] == law.seeing_arcsec
    assert told["CCD_GAIN"]["GAIN"] == law.gain
    assert told["SCOPE_INFO"]["FOCAL_LENGTH"] == law.focal_length_mm


def test_every_frame_asked_for_its_own_sky(night):
    figures, _ = night
    assert figures["engine_status"] == 0, figures["last_words"]
    # Where the machine is too busy for the camera's driver some calls have no frame.
    assert figures["frames"] == figures["frames_with_truth"] >= FRAMES - 2
    # The driver takes the time of its header just before it asks.
    assert 0.0 <= figures["call_after_header_ms"] < 1000.0


def test_the_stars_are_those_of_the_catalogue(night):
    figures, folder = night
    assert figures["solved"] >= figures["frames"] - 1
    solved = [r for _, _, r in SessionReader(folder / "session").records()]
    solved = [each for each in solved if isinstance(each, Solution)]
    # A star falls on a whole pixel: evenly spread over one, 1 / sqrt(12) of it on either axis.
    whole_pixel_arcsec = CcdLaw().scale_arcsec_px / np.sqrt(12.0)
    assert figures["solve_rms_arcsec"] == pytest.approx(whole_pixel_arcsec, rel=0.25)
    assert figures["stars_matched"] >= 30
    true_scale = 206.264806 * CcdLaw().pixel_um / CcdLaw().focal_length_mm
    assert np.median([s.scale_arcsec_px for s in solved]) == pytest.approx(true_scale, rel=1e-4)


def test_the_streak_lies_where_the_truth_says(night):
    one = night[0]["objects"][0]
    assert one["visible_frames"] >= FRAMES - 3
    assert one["detections"] >= one["visible_frames"] - 2
    a_pixel_arcsec = CcdLaw().scale_arcsec_px
    assert one["drawn_rms_arcsec"] < a_pixel_arcsec
    scatter_arcsec = night[0]["scatter_rms_s"] * SIDEREAL_ARCSEC_S
    late_arcsec = night[0]["call_after_header_ms"] / 1e3 * SIDEREAL_ARCSEC_S
    assert one["measured_rms_arcsec"] == pytest.approx(
        scatter_arcsec, abs=a_pixel_arcsec + late_arcsec
    )
    assert one["false_measurements"] == 0


def test_the_streaks_light_is_as_the_law_says(night):
    _, folder = night
    sky = Sky.load(folder / "sky.json")
    truth = read_truth(sky.truth)
    reader = SessionReader(folder / "session")
    shares = []
    for taken in (r for _, _, r in reader.records() if isinstance(r, FrameTaken)):
        path, told = reader.frame_path(taken.frame_id), truth_of(truth, taken.t_start_utc_ns)
        if path is not None and told is not None:
            shares += list(_shares(sky, read_frame(path, taken.frame_id).pixels, told))
    assert len(shares) >= FRAMES - 3
    # Now and then a star lies in the streak.
    assert np.median(shares) == pytest.approx(1.0, abs=0.05)


def test_it_is_locked_and_what_becomes_of_the_track_is_told(night, record_property):
    """How long it is followed is measured here, not held to a figure."""
    one = night[0]["objects"][0]
    for name in ("track_frames", "coast_frames", "visible_frames", "prediction_rms_arcsec"):
        record_property(name, one[name])
    assert night[0]["as_the_demo_tells"]["locked_after_frames"] is not None
    assert night[0]["as_the_demo_tells"]["target"] == one["name"]


def _shares(sky, pixels, told):
    """Amplitude of each drawn streak in its frame in units of the law's, fitted by its shape."""
    centre_deg = told["boresight_ra_icrs_deg"], told["boresight_dec_icrs_deg"]
    background = (sky.law.noise_adu - 1) / 2.0
    reach = int(3.0 * sky.law.fwhm_px) + 1
    for each in streaks(sky, centre_deg, told["t_start_utc_ns"], told["scatter_s"]):
        if not each.truth["is_whole"]:
            continue
        best = 0.0
        for is_pier_east in (False, True):
            x, y = sky.law.pixel(each.ra_icrs_deg, each.dec_icrs_deg, centre_deg, is_pier_east)
            drawn = sky.law.drawn_adu(
                x, y, sky.law.flux_adu(each.point_magnitude, told["exposure_s"])
            )
            top, left = int(np.floor(y.min())) - reach, int(np.floor(x.min())) - reach
            seen = pixels[top : top + drawn.shape[0], left : left + drawn.shape[1]] - background
            if seen.shape == drawn.shape:
                best = max(best, float((seen * drawn).sum() / (drawn**2).sum()))
        yield best
