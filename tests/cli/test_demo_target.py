"""``demo --target``, as a shell sees it, and over twenty satellites of each kind of orbit."""

import json
import math
import statistics

import pytest

from rsoconsole.cli.judge._objects import VISIBLE_SNR
from tests.cli.test_demo import night, night_here
from tests.nights.target_night import (
    INDEX,
    centre_offset_deg,
    judged,
    off_skyfield_arcsec,
    off_target_arcsec,
)
from tests.orbits.test_places import earth
from tests.orbits.test_target_places import HUNDREDTH_ARCSEC, TRANSCRIBED
from tests.rigs.in_process import run_here
from tests.simulator.test_target_plan import FIFTH_OF_THE_FIELD_DEG
from tests.truth.regimes import EACH, REGIMES, TLES, samples

__all__ = ["earth"]

KEYS = {
    *("norad", "name", "detections", "visible_frames", "track_frames", "measured_rms_arcsec"),
    *("prediction_rms_arcsec", "identified", "false_measurements", "detected_after_lock"),
    *("tracked_after_lock", "inside_3sigma", "nis_mean", "whiteness", "longest_wrong"),
    "swapped_frames",
}


@pytest.mark.nightly("one more night")
def test_named_satellites_are_in_the_first_frame(tmp_path):
    at = ("--at", "2023-06-23T05:30:00Z")
    words = ("--target", "ses 10", "--target", "49332", *at)
    found = night_here(tmp_path / "night", *words, frames=2, binning=2)
    assert found["scenario"] == "SES 10, SES 17"
    assert found["locked_after_frames"] == 2, "which needs the satellite in the first frame"
    by_number = {each["norad"]: each for each in found["objects"]}
    assert list(by_number)[:2] == [42432, 49332], "as they were named"
    assert all(set(each) == KEYS for each in found["objects"])
    for number in (42432, 49332):
        each = by_number[number]
        assert (each["visible_frames"], each["false_measurements"]) == (2, 0)
        assert each["detections"] >= 1


@pytest.mark.nightly("simulates a night at full frame size")
def test_a_named_satellite_is_in_the_first_frame_followed_and_named(tmp_path):
    at = ("--at", "2023-06-23T05:30:00Z")
    found = night(tmp_path / "night", "--target", "ses 10", "--target", "49332", *at, frames=6)
    assert found["scenario"] == "SES 10, SES 17"
    assert found["states"]["ACQUIRE"] == 1
    assert found["locked_after_frames"] == 2, "which needs the satellite in the first frame"
    by_number = {each["norad"]: each for each in found["objects"]}
    assert list(by_number)[:2] == [42432, 49332], "as they were named"
    assert all(set(each) == KEYS for each in found["objects"])
    [followed] = [each for each in found["objects"] if each["name"] == found["target"]]
    assert followed["track_frames"] == 5
    assert followed["identified"] is True
    assert followed["prediction_rms_arcsec"] < 6.0
    for number in (42432, 49332):
        each = by_number[number]
        assert (each["visible_frames"], each["false_measurements"]) == (6, 0)
        assert 4 <= each["detections"] <= 6
        assert each["measured_rms_arcsec"] < 2.0


def test_a_sky_that_is_not_there_ends_the_demo_before_it_begins(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    path = tmp_path / "mixed.tle"
    path.write_text(TRANSCRIBED)
    folder = tmp_path / "night"
    run = run_here(
        *("demo", "--headless", "--json", "--target", "iss", "--tle", path, "--session", folder)
    )
    if run.returncode == 0:
        pytest.skip("this machine has the whole sky's index files installed")
    assert run.returncode == 1
    assert run.stdout == ""
    [line] = run.stderr.splitlines()
    assert "'rsoconsole index install'" in line
    assert not folder.exists()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("--target", "intelsat"), 1, "4 objects"),
        (("--target", "36097", "--at", "2023-06-23T17:30:00Z"), 1, "the Sun stands at"),
        (("--target", "36097", "--site", "somewhere"), 1, "LAT,LON,ELEV"),
        (("--at", "2023-06-23T05:30:00Z"), 2, "--target"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_starts(arguments, status, words):
    run = run_here("demo", "--headless", *arguments)
    assert run.returncode == status
    assert words in run.stderr
    assert run.stdout == ""


FRAMES = 3


@pytest.mark.nights
@pytest.mark.shared_data
@pytest.mark.timeout(3600)
@pytest.mark.skipif(not TLES.exists(), reason=f"{TLES} is not here")
@pytest.mark.skipif(not INDEX.exists(), reason=f"{INDEX} is not here: tests/fetch_debian_index.sh")
@pytest.mark.parametrize("regime", REGIMES)
def test_nights_of_twenty_satellites_of_a_regime(regime, tmp_path, earth):
    """Each one is in the first frame, where skyfield has it, and its figures are right."""
    rows = []
    for number, sample in enumerate(samples(regime)):
        with pytest.MonkeyPatch.context() as patch:
            run = judged(sample, tmp_path / str(number), FRAMES, patch)
        first, true = run.truth[0], run.of_target(0)
        assert true is not None, sample.entry.name
        assert true["is_in_frame"], sample.entry.name
        assert centre_offset_deg(first, true) < FIFTH_OF_THE_FIELD_DEG + 60 / 3600
        t_mid_utc_ns = first["t_start_utc_ns"] + round(first["exposure_s"] * 5e8)
        off = off_skyfield_arcsec(sample, true, run.plan.site, t_mid_utc_ns, earth)
        assert off < HUNDREDTH_ARCSEC, sample.entry.name
        [found] = [e for e in run.figures["objects"] if e["norad"] == sample.entry.norad_id]
        told = [run.of_target(k) for k in range(len(run.truth))]
        visible = [s for s in told if s and s["is_in_frame"] and s["snr_integrated"] >= VISIBLE_SNR]
        assert found["visible_frames"] == len(visible)
        assert found["identified"] is not False
        if found["measured_rms_arcsec"] is not None and all(s and s["is_whole"] for s in told):
            away = sorted(off_target_arcsec(tmp_path / str(number), run))[: found["detections"]]
            rms = math.sqrt(statistics.fmean(each**2 for each in away))
            assert found["measured_rms_arcsec"] == pytest.approx(rms, rel=1e-3), sample.entry.name
        rows.append(found)
    assert len(rows) == EACH
    visible, detected = (sum(r[key] for r in rows) for key in ("visible_frames", "detections"))
    print(json.dumps({"regime": regime, "visible": visible, "detected": detected}))
    assert visible >= EACH
