"""Trailed stars on frames that another program drew, drawn out here: measured where they stood."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsoconsole.instruments import read_frame
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import Candidate, LineLight, find_stars
from rsoconsole.vision.detector._reject_artifacts import reject_star_trails
from rsoconsole.vision.stars.star_list import StarTrail
from rsoconsole.words import text
from tests.makers import straight_detection
from tests.tiers import plain_first

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not here")


def drawn_out(pixels: np.ndarray, length_px: float, angle_deg: float, seed: int) -> np.ndarray:
    """The frame with every source drawn along a line, and the noise that it had before."""
    half = math.ceil(length_px / 2.0) + 2
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    places = 16 * math.ceil(length_px)
    for along in (np.arange(places) + 0.5) / places - 0.5:
        x = half + along * length_px * math.cos(math.radians(angle_deg))
        y = half + along * length_px * math.sin(math.radians(angle_deg))
        left, top = math.floor(x), math.floor(y)
        for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
            kernel[top + dy, left + dx] += abs(1 - dx - (x - left)) * abs(1 - dy - (y - top))
    kernel /= kernel.sum()
    steps = pixels[::20, 2:].astype(float) - pixels[::20, :-2]
    sigma = 1.4826 * float(np.median(np.abs(steps))) / math.sqrt(2.0)
    smeared = cv2.filter2D(pixels.astype(np.float32), -1, kernel[::-1, ::-1])
    left_of_noise = float(np.sum(kernel**2))
    noise = np.random.default_rng(seed).standard_normal(pixels.shape, np.float32)
    smeared += noise * np.float32(sigma * math.sqrt(1.0 - left_of_noise))
    return np.clip(np.rint(smeared), 0, 65535).astype(np.uint16)


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    folder = DATA / "simulated" / "geo_single"
    name = json.loads((folder / "truth.json").read_text())["frames"][0]["file"]
    return read_frame(folder / name, 1).pixels


@pytest.mark.nightly("many independent frames")
@needs_data
@pytest.mark.shared_data
def test_a_warm_sensors_hot_pixels_do_not_hide_them(plain):
    """One pixel in two thousand at three quarters of full well: ten for each star."""
    frame = drawn_out(plain, 14.0, 90.0, 3)
    cold = find_stars(frame)
    random = np.random.default_rng(8)
    hot = random.random(frame.shape) < 5e-4
    frame[hot] = random.integers(40_000, 50_000, np.count_nonzero(hot))
    warm = find_stars(frame)
    assert warm.trail is not None
    assert warm.trail.length_px == pytest.approx(14.0, rel=0.12)
    assert len(warm) > 0.8 * len(cold)


@needs_data
@pytest.mark.shared_data
@pytest.mark.parametrize(("length_px", "angle_deg"), [(9.0, 40.0), (14.0, 90.0), (30.0, 172.0)])
def test_trailed_stars_are_where_the_points_were(plain, length_px, angle_deg):
    points = find_stars(plain)
    assert points.trail is None
    found = find_stars(drawn_out(plain, length_px, angle_deg, 3))
    assert found.trail is not None
    assert found.trail.length_px == pytest.approx(length_px, rel=0.12)
    assert line_angle_deg(found.trail.angle_deg, angle_deg) < 2.0
    assert found.trail.fwhm_px == pytest.approx(points.median_fwhm_px, rel=0.35)
    brightest = slice(0, 60)
    away = np.hypot(
        points.x_px[:, None] - found.x_px[brightest], points.y_px[:, None] - found.y_px[brightest]
    ).min(axis=0)
    assert np.median(away) < 0.15
    assert np.mean(away < 0.5) > 0.8
    assert len(found) > 60


@needs_data
@pytest.mark.shared_data
@pytest.mark.parametrize(
    "pattern", plain_first(1, ["real/pocs_*", "simulated/*/*.bz2", "real/tetra3_*"])
)
@pytest.mark.parametrize(
    "step", [4, pytest.param(1, marks=pytest.mark.nightly("looks at every frame"))]
)
def test_stars_that_are_points_are_told_to_be(pattern, step):
    paths = sorted(DATA.glob(pattern))[::step]
    assert paths
    for path in paths:
        frame = read_frame(path, 1)
        assert find_stars(frame.pixels, saturation_adu=frame.saturation_adu).trail is None, path


@pytest.mark.parametrize(
    ("angle_deg", "length_px", "confidence", "roughness", "is_kept"),
    [
        (62.0, 40.0, 0.99, 0.05, False),
        (62.0, 150.0, 0.5, 0.6, False),
        (62.0, 150.0, 0.99, 0.6, True),
        (62.0, 150.0, 0.5, 0.05, True),
        (62.0, 400.0, 0.5, 0.6, True),
        (75.0, 40.0, 0.5, 0.6, True),
        (179.0, 40.0, 0.5, 0.6, True),
    ],
)
def test_some_trails_in_a_row_are_no_streak(angle_deg, length_px, confidence, roughness, is_kept):
    trail = StarTrail(length_px=20.0, angle_deg=60.0, fwhm_px=3.0)
    found = straight_detection(angle_deg=angle_deg, length_px=length_px, confidence=confidence)
    light = LineLight(roughness=roughness)
    candidate = Candidate(found=found, light=light)
    kept, chains = reject_star_trails([candidate], trail)
    assert (kept == [candidate], len(chains)) == (is_kept, 0 if is_kept else 1)
    if chains:
        assert "along the stars' own trails, of 20 px" in text(chains[0].reason)


def test_what_the_verifier_is_sure_of_stays_along_the_stars_trails():
    trail = StarTrail(length_px=20.0, angle_deg=60.0, fwhm_px=3.0)
    found = straight_detection(angle_deg=62.0, length_px=30.0, confidence=0.5)
    light = LineLight(roughness=0.3, log_odds=6.0)
    kept, chains = reject_star_trails([Candidate(found=found, light=light)], trail)
    assert (len(kept), chains) == (1, [])
