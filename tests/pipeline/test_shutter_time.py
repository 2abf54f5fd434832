"""A calibrated shutter: which frames it is used for, how it is written, and shown with its age."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import (
    CalibratedTiming,
    Config,
    ExposureConfig,
    config_to_toml,
    load_config,
    write_settings,
)
from rsoconsole.engine.doctor.checks import check_shutter
from rsoconsole.engine.operator.arming import ArmingCheck, arming_checks
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.pipeline import frame_timing, measure, merged_timings, mid_exposure_utc_ns, replay
from rsoconsole.records import CameraMode, FrameTaken, Measurement
from rsoconsole.session import SessionReader
from rsoconsole.sky import iso_to_utc_ns
from tests.engine.test_arming import FACTS
from tests.makers import straight_detection
from tests.nights.export_nights import closed_night
from tests.nights.samples import SAMPLE
from tests.pipeline.test_measure import solution
from tests.rigs.rewritten import rewrite_log
from tests.truth.navigation_truth import Plan, Shutter, constellation, night

NS = 1_000_000_000
MODE = {"binning": "1x1", "width_px": 4656, "height_px": 3520, "gain": 139.0}
FOUND = {
    "bias_s": 0.1372,
    "bias_sigma_s": 0.0023,
    "scatter_s": 0.0081,
    "scatter_sigma_s": 0.0011,
    "line_time_us": 15.1,
    "line_time_sigma_us": 0.8,
    "measured_on": date(2026, 11, 20),
    "source": "sp3",
    "tracks": 20,
    "measurements": 120,
}
TWO_S = CalibratedTiming.model_validate({"exposure_s": 2.0, **MODE, **FOUND})
TEN_S = TWO_S.model_copy(update={"exposure_s": 10.0, "bias_s": 0.2, "line_time_us": 0.0})
ANY = TWO_S.model_copy(update={"exposure_s": None, "bias_s": 0.3})


def frame(exposure_s: float = 2.0, **camera: object) -> FrameTaken:
    return FrameTaken(
        frame_id=1,
        name="1.fits",
        t_start_utc_ns=1_700_000_000 * NS,
        exposure_s=exposure_s,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
        camera=CameraMode(**{"binning": "1x1", "gain": 139.0, **camera}),  # type: ignore[arg-type]
    )


def exposure(*known: CalibratedTiming) -> ExposureConfig:
    return ExposureConfig(header_latency_s=0.5, line_time_us=3.0, calibrated=known)


@pytest.mark.parametrize(
    ("taken", "bias_s"),
    [
        (frame(2.0), 0.1372),
        (frame(10.0), 0.2),
        (frame(9.0), 0.2),  # the exposure that is nearest
        (frame(0.1), 0.1372),
        (frame(binning="2x2"), 0.5),  # another mode: as set for all
        (frame(gain=0.0), 0.5),
        (frame(gain=None), 0.5),
        (replace(frame(), height_px=1760), 0.5),
        (frame(y0_px=200), 0.5),
        (replace(frame(), camera=None), 0.5),  # a session from before modes were on record
    ],
)
def test_a_frame_has_the_shutter_of_its_mode(taken: FrameTaken, bias_s: float) -> None:
    assert frame_timing(taken, exposure(TWO_S, TEN_S)).late_s == bias_s


def part(x0_px: int, y0_px: int, width_px: int, height_px: int, **camera: object) -> FrameTaken:
    return replace(
        frame(x0_px=x0_px, y0_px=y0_px, **camera), width_px=width_px, height_px=height_px
    )


def test_a_part_of_the_sensor_has_the_shutter_of_the_whole_a_little_less_surely() -> None:
    known = exposure(TWO_S)
    timed = frame_timing(part(1152, 880, 2320, 1760), known)
    assert (timed.late_s, timed.line_time_us) == (0.1372, 15.1)
    assert timed.bias_sigma_s == pytest.approx(0.0055, abs=1e-4)
    own = TWO_S.model_copy(
        update={"x0_px": 1152, "y0_px": 880, "width_px": 2320, "height_px": 1760, "bias_s": 0.11}
    )
    assert frame_timing(part(1152, 880, 2320, 1760), exposure(TWO_S, own)).late_s == 0.11
    for other in (
        part(1152, 880, 2320, 1760, binning="2x2"),
        part(1152, 880, 2320, 1760, gain=0.0),
        part(3000, 880, 2320, 1760),  # not of that sensor
    ):
        assert frame_timing(other, known).late_s == 0.5


def test_rare_exposures_share_an_entry_of_their_own() -> None:
    assert frame_timing(frame(3.0), exposure(TWO_S, ANY)).late_s == 0.3
    assert frame_timing(frame(2.04), exposure(TWO_S, ANY)).late_s == 0.1372


def test_a_cameras_own_receiver_has_no_header_latency_and_an_error_of_its_own() -> None:
    timed = frame_timing(frame(time_by="gps"), exposure(TWO_S))
    assert (timed.late_s, timed.sigma_s, timed.line_time_us) == (0.0, 0.001, 3.0)
    own = TWO_S.model_copy(update={"time_by": "gps", "bias_s": 0.0004})
    assert frame_timing(frame(time_by="gps"), exposure(TWO_S, own)).late_s == 0.0004


def test_bias_line_time_and_scatter_are_in_a_measurement() -> None:
    taken, plain, known = frame(), ExposureConfig(), exposure(TWO_S)
    mid_ns = mid_exposure_utc_ns(taken, known)
    assert mid_ns == taken.t_mid_utc_ns + round(0.1372 * NS)
    streak = replace(straight_detection(), y_px=1000.0)
    before = measure(streak, solution(), taken, plain, measurement_id="1-0")
    after = measure(streak, solution(), taken, known, measurement_id="1-0")
    assert before is not None
    assert after is not None
    assert after.t_mid_utc_ns - before.t_mid_utc_ns == round((0.1372 + 1000 * 15.1e-6) * NS)
    # The default is 15 ms, measured were 8.1: the covariance along the streak is smaller.
    trace = [each.cov_sky_arcsec2[0] + each.cov_sky_arcsec2[2] for each in (before, after)]
    rate_arcsec_s = streak.length_px * solution().scale_arcsec_px / 2.0
    expected = rate_arcsec_s**2 * (0.015**2 - 0.0081**2 - 0.0011**2)  # with the scatter's error
    assert trace[0] - trace[1] == pytest.approx(expected, rel=0.02)


USERS = """# my observatory
[site]
name = "Hill"  # on the roof
latitude_deg = 47.5

[exposure]
# two seconds for satellites
exposure_s = 2.0
cadence_s = 5.0

[search]
pattern = "stay"
"""


def written(path: Path, *timings: CalibratedTiming) -> ExposureConfig:
    known = load_config(path).exposure
    whole = merged_timings(known, timings)
    write_settings(path, {"exposure.calibrated": [each.model_dump(mode="json") for each in whole]})
    return load_config(path).exposure


def test_writing_keeps_every_line_that_the_user_wrote(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(USERS)
    assert written(path, TWO_S).calibrated == (TWO_S,)
    assert path.read_text().startswith(USERS)
    config = load_config(path)
    assert (config.exposure.exposure_s, config.search.pattern) == (2.0, "stay")


def test_another_result_of_a_mode_replaces_its_own_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(USERS)
    written(path, TWO_S, TEN_S)
    path.write_text(path.read_text() + "# a word at the end\n\n[aim]\nlead_s = 1.0\n")
    newer = TWO_S.model_copy(update={"bias_s": 0.14})
    assert written(path, newer).calibrated == (TEN_S, newer)
    assert load_config(path).aim.lead_s == 1.0
    assert path.read_text().count("# a word at the end") == 1
    assert written(path, newer).calibrated == (TEN_S, newer)


def test_a_configuration_with_calibrations_is_written_and_read_whole(tmp_path: Path) -> None:
    config = Config(exposure=ExposureConfig(calibrated=(TWO_S, ANY)))
    path = tmp_path / "session.toml"
    path.write_text(config_to_toml(config))
    assert load_config(path) == config


def test_the_doctor_tells_the_age() -> None:
    def seen_on(day: date, *known: CalibratedTiming):
        return check_shutter(Config(exposure=ExposureConfig(calibrated=known)), day)

    none = seen_on(date(2026, 11, 25))
    assert none.ok is None
    assert "not calibrated: ±15 ms assumed" in none.detail
    assert "calibrate-time" in none.remedy
    fresh = seen_on(date(2026, 11, 25), TWO_S)
    assert fresh.ok is True
    assert "2 s, 1x1, 4656 x 3520 px, gain 139: +137.2 ± 2.3 ms late" in fresh.detail
    assert "5 days old" in fresh.detail
    old = seen_on(date(2027, 11, 25), TWO_S)
    assert old.ok is None
    assert "370 days old" in old.detail
    assert "measure again" in old.remedy
    assert "clock is wrong" in seen_on(date(2026, 11, 1), TWO_S).remedy


def test_the_checklist_before_arming_tells_it() -> None:
    def clock_check(*known: CalibratedTiming) -> ArmingCheck:
        config = Config(exposure=ExposureConfig(calibrated=known))
        now_utc_ns = iso_to_utc_ns("2026-11-25T20:00:00Z")
        return arming_checks(replace(FACTS, now_utc_ns=now_utc_ns), config)[0]

    plain, known = clock_check(), clock_check(TWO_S)
    assert plain.name == known.name == "clock"
    assert "shutter" not in plain.detail
    assert known.detail.startswith(plain.detail)
    assert "shutter at 2 s, 1x1" in known.detail
    assert "5 days old" in known.detail


class TestExports:
    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        plan = Plan(tracks=1, frames=4, strays=0, outliers=0)
        exposure = {"calibrated": [TWO_S.model_dump(mode="json")]}
        sky = constellation(iso_to_utc_ns("2023-06-22T00:59:42Z"), 4.0)
        rng = np.random.default_rng(1)
        return night(tmp_path / "n", sky, Shutter(), plan, rng, exposure=exposure)

    def test_the_time_of_a_row_has_the_error_of_its_mode(self, folder: Path) -> None:
        exported = read_exported_night(folder)
        expected_s = np.sqrt(0.0081**2 + 0.0011**2 + 0.0023**2)
        assert [exported.time_sigma_s(row) for row in exported.rows] == pytest.approx(
            [expected_s] * len(exported.rows)
        )
        (told,) = exported.table_metadata()["shutter"]
        assert (told["bias_s"], told["measured_on"]) == (0.1372, "2026-11-20")

    def test_a_night_without_a_calibration_says_what_it_always_said(self, tmp_path: Path) -> None:
        exported = read_exported_night(closed_night(tmp_path / "old", frames=4))
        assert "shutter" not in exported.table_metadata()
        assert {exported.time_sigma_s(row) for row in exported.rows} == {0.015}


def test_a_night_of_a_calibrated_mode_replays_as_it_was_and_has_its_times() -> None:
    reader = SessionReader(SAMPLE)
    mode = {"binning": "1x1", "gain": 139.0}
    records = [
        (t, replace(r, camera=CameraMode(**mode)) if isinstance(r, FrameTaken) else r)  # type: ignore[arg-type]
        for _, t, r in reader.records()
    ]
    (size,) = {(r.width_px, r.height_px) for _, r in records if isinstance(r, FrameTaken)}
    known = TEN_S.model_copy(
        update={"width_px": size[0], "height_px": size[1], "line_time_us": 15.0}
    )
    config = reader.config()
    exposure_config = config.exposure.model_copy(update={"calibrated": (known,)})
    config = config.model_copy(update={"exposure": exposure_config})
    retold = rewrite_log(records, config)
    log = [record for _, record in retold.log]
    again = list(replay(log, config))
    assert again
    assert all(each.is_alike for each in again)
    before = {r.measurement_id: r for _, r in records if isinstance(r, Measurement)}
    after = [r for r in log if isinstance(r, Measurement)]
    assert after
    for each in after:
        late_ns = each.t_mid_utc_ns - before[each.measurement_id].t_mid_utc_ns
        assert late_ns == pytest.approx(0.2e9 + each.y_px * 15e3, abs=2)
