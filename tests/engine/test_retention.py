"""What a night takes on disk is computed from the configuration, and told before it runs short."""

import pytest

from rsoconsole.config import Config
from rsoconsole.engine.machine.medium import bytes_until_dawn, disk_outlook, session_bytes
from rsoconsole.sky import iso_to_utc_ns, night_span
from rsoconsole.words import NS_PER_S

HOUR_NS = 3600 * NS_PER_S
MIDNIGHT = iso_to_utc_ns("2023-12-22T05:30:00Z")
"""In Daytona Beach, the default site, whose longest nights are 11.6 h from -12 to -12 deg."""


def config_with(**sections: dict[str, object]) -> Config:
    return Config.model_validate(sections)


def test_a_frame_of_the_papers_camera_is_33_megabytes_and_ten_hours_39_gigabytes() -> None:
    # 4656 x 3520 px of 16 bits; 1,200 exposures in 10 h at 30 s.
    raw_bytes = 2 * 4656 * 3520
    assert 1200 * raw_bytes == pytest.approx(39.3e9, rel=0.01)
    kept = session_bytes(Config(), 10 * 3600.0)
    assert kept == pytest.approx(1200 * (0.52 * raw_bytes + 1e5), rel=1e-9)


def test_a_night_is_as_long_as_it_is_dark() -> None:
    outlook = disk_outlook(Config(), 10**12, MIDNIGHT)
    span = night_span(Config().site.to_site(), MIDNIGHT, -12.0)
    assert span is not None
    assert outlook.dark_s == (span[1] - span[0]) / NS_PER_S
    exposures = outlook.dark_s / 30.0
    # 0.52 of each frame is left by lossless compression, 0.1 MB lie beside it.
    assert outlook.bytes_a_night == pytest.approx(exposures * (0.52 * 32_778_240 + 1e5), rel=1e-6)
    assert outlook.nights == pytest.approx(1e12 / outlook.bytes_a_night)
    june = disk_outlook(Config(), 10**12, iso_to_utc_ns("2023-06-22T05:30:00Z"))
    assert 7.5 * 3600 < june.dark_s < 8.5 * 3600


@pytest.mark.parametrize(
    ("sections", "bytes_a_frame", "share"),
    [
        ({"exposure": {"cadence_s": 60.0}}, None, 0.5),
        ({"exposure": {"cadence_s": 1.0, "exposure_s": 60.0}}, None, 0.5),
        ({"optics": {"width_px": 2328}}, None, 0.503),  # half the pixels, as much beside them
        ({"session": {"keep_frames": "detected"}}, None, 1.0),  # at most
        ({"session": {"keep_frames": "none"}}, None, 0.0058),
        ({"session": {"keep_frames": "none"}}, 9e6, 0.0058),
        ({}, 8.5e6, 0.501),
    ],
)
def test_cadence_sensor_and_what_is_kept_count(sections, bytes_a_frame, share) -> None:
    whole = disk_outlook(Config(), 10**12, MIDNIGHT).bytes_a_night
    outlook = disk_outlook(config_with(**sections), 10**12, MIDNIGHT, bytes_a_frame)
    assert outlook.bytes_a_night / whole == pytest.approx(share, rel=0.01)


def test_a_disk_that_runs_short_is_told_with_the_nights_left() -> None:
    night = disk_outlook(Config(), 0, MIDNIGHT).bytes_a_night
    assert disk_outlook(Config(), 4 * night, MIDNIGHT).warning is None
    soon = disk_outlook(Config(), 2 * night, MIDNIGHT).warning
    assert soon is not None
    assert "holds 2.0 more nights" in soon
    full = disk_outlook(Config(), night // 2, MIDNIGHT).warning
    assert full is not None
    assert "fills before the night is over" in full
    assert f"{night / 1e9:.1f} GB" in full
    assert "session.root" in full


def test_late_in_the_night_less_is_needed() -> None:
    span = night_span(Config().site.to_site(), MIDNIGHT, -12.0)
    assert span is not None
    need, dark_s = bytes_until_dawn(Config(), span[1] - HOUR_NS)
    assert dark_s == pytest.approx(3600.0, abs=1.0)
    whole = disk_outlook(Config(), 0, MIDNIGHT)
    assert need == pytest.approx(whole.bytes_a_night * 3600.0 / whole.dark_s, rel=1e-3)
    before_dusk, _ = bytes_until_dawn(Config(), span[0] - HOUR_NS)
    assert before_dusk == pytest.approx(whole.bytes_a_night, rel=1e-3)


@pytest.mark.parametrize(("latitude_deg", "hours"), [(80.0, 10.0), (-80.0, 24.0)])
def test_polar_seasons_have_a_figure_too(latitude_deg: float, hours: float) -> None:
    far = config_with(site={"latitude_deg": latitude_deg}, limits={"twilight_deg": -6.0})
    june_ns = iso_to_utc_ns("2023-06-22T05:30:00Z")
    assert disk_outlook(far, 10**12, june_ns).dark_s == hours * 3600.0
    need, dark_s = bytes_until_dawn(far, june_ns)
    assert need > 0
    assert dark_s == hours * 3600.0
