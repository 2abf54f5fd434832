"""From a streak in pixels to a direction with an honest covariance."""

import math

import numpy as np
import pytest

from rsoconsole.config import ExposureConfig
from rsoconsole.pipeline import measure
from rsoconsole.pipeline.frame.measurement import AIR_ARCSEC_ROOT_S
from rsoconsole.records import Frame, Solution
from rsoconsole.sky import describe_field, pixel_to_sky, tan_wcs
from tests.makers import T0_UTC_NS, straight_detection

SCALE_ARCSEC_PX = 1.264


def solution(rotation_deg: float = 0.0, rms_arcsec: float = 0.0) -> Solution:
    wcs = tan_wcs(
        150.0,
        -5.0,
        scale_arcsec_px=SCALE_ARCSEC_PX,
        rotation_deg=rotation_deg,
        is_flipped=False,
        width_px=640,
        height_px=480,
    )
    field = describe_field(wcs, 640, 480)
    return Solution(
        frame_id=1,
        wcs=wcs,
        ra_icrs_deg=field.ra_icrs_deg,
        dec_icrs_deg=field.dec_icrs_deg,
        scale_arcsec_px=SCALE_ARCSEC_PX,
        rotation_deg=rotation_deg,
        is_flipped=False,
        matched=40,
        rms_arcsec=rms_arcsec,
        path="full",
        ms=1.0,
    )


def frame(exposure_s: float | None = 10.0) -> Frame:
    return Frame(
        frame_id=1,
        name="a",
        pixels=np.zeros((480, 640), np.uint16),
        t_start_utc_ns=T0_UTC_NS,
        exposure_s=exposure_s,
    )


NO_TIMING_ERROR = ExposureConfig(timing_sigma_s=0.0)


def test_the_midpoint_belongs_to_the_middle_of_the_exposure():
    found = measure(
        straight_detection(), solution(), frame(), NO_TIMING_ERROR, measurement_id="1-0"
    )
    assert found is not None
    assert found.t_mid_utc_ns == T0_UTC_NS + 5_000_000_000
    ra, dec = pixel_to_sky(solution().wcs, 300.0, 200.0)
    assert (found.ra_icrs_deg, found.dec_icrs_deg) == (float(ra), float(dec))


def test_the_cameras_latency_is_added():
    late = ExposureConfig(header_latency_s=0.25)
    found = measure(straight_detection(), solution(), frame(), late, measurement_id="1-0")
    assert found is not None
    assert found.t_mid_utc_ns == T0_UTC_NS + 5_250_000_000


@pytest.mark.parametrize("line_time_us", [25.0, -10.0])
def test_with_a_rolling_shutter_a_streak_has_the_instant_of_its_row(line_time_us):
    rolling = ExposureConfig(line_time_us=line_time_us)
    found = measure(straight_detection(), solution(), frame(), rolling, measurement_id="1-0")
    assert found is not None
    late_ns = found.t_mid_utc_ns - (T0_UTC_NS + 5_000_000_000)
    assert late_ns == round(found.y_px * line_time_us * 1000.0)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0, 135.0])
@pytest.mark.parametrize("rotation_deg", [0.0, 200.0])
def test_the_covariance_is_long_along_the_streak_on_the_sky(angle_deg, rotation_deg):
    """Along 0.6 px, across 0.2 px: their eigenvalues on the sky, whichever way it lies."""
    found = measure(
        straight_detection(angle_deg=angle_deg),
        solution(rotation_deg),
        frame(),
        NO_TIMING_ERROR,
        measurement_id="1-0",
    )
    assert found is not None
    ee, en, nn = found.cov_sky_arcsec2
    values, vectors = np.linalg.eigh(np.array([[ee, en], [en, nn]]))
    floor = AIR_ARCSEC_ROOT_S**2 / 10.0
    assert values - floor == pytest.approx(
        [(0.2 * SCALE_ARCSEC_PX) ** 2, (0.6 * SCALE_ARCSEC_PX) ** 2], rel=1e-3
    )
    assert found.ends_icrs_deg is not None
    (ra_a, dec_a), (ra_b, dec_b) = found.ends_icrs_deg
    streak = np.array([(ra_b - ra_a) * math.cos(math.radians(-5.0)), dec_b - dec_a])
    along = abs(vectors[:, 1] @ streak) / np.hypot(*streak)
    assert along == pytest.approx(1.0, abs=1e-4)


def test_a_wrong_clock_widens_it_along_the_streak_only():
    """0.1 s of timing is 1.5 arcsec for something that moves at 15 arcsec/s."""
    uncertain = ExposureConfig(timing_sigma_s=0.1)
    sharp = measure(
        straight_detection(), solution(), frame(), NO_TIMING_ERROR, measurement_id="1-0"
    )
    blurred = measure(straight_detection(), solution(), frame(), uncertain, measurement_id="1-0")
    assert sharp is not None
    assert blurred is not None
    along = math.sqrt(blurred.cov_sky_arcsec2[0] - sharp.cov_sky_arcsec2[0])
    assert along == pytest.approx(118.0 * SCALE_ARCSEC_PX / 10.0 * 0.1, rel=1e-3)
    assert blurred.cov_sky_arcsec2[2] == pytest.approx(sharp.cov_sky_arcsec2[2], rel=1e-3)


def test_a_frame_without_a_time_makes_no_measurement():
    assert (
        measure(
            straight_detection(), solution(), frame(None), NO_TIMING_ERROR, measurement_id="1-0"
        )
        is None
    )
