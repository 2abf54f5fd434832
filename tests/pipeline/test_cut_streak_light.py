"""Brightness of a streak that the frame cuts: by the speed of the track that took it."""

import math

import numpy as np
import pytest

from rsoconsole.pipeline.photometry.frame_photometry import FrameLight, photometry_of
from rsoconsole.records import Detection, Frame
from rsoconsole.vision import find_stars, local_background
from tests.drawn.drawn_moffat import MoffatSky, flux_of_snr, streak_points

EXPOSURE_S = 10.0
WHOLE_PX, SEEN_PX = 200.0, 99.0


def cut_streak() -> tuple[FrameLight, float]:
    """A streak of 200 px in 10 s, half of it beyond the right rim, and its light in a second."""
    rng = np.random.default_rng(17)
    sky = MoffatSky.of(rng)
    flux = flux_of_snr(200.0, WHOLE_PX, sky.fwhm_px)
    pixels = sky.drawn(rng, streak_points((700.0, 200.0, 900.0, 200.0), flux))
    streak = Detection(
        frame_id=1,
        confidence=1.0,
        x_px=749.5,
        y_px=200.0,
        x_a_px=700.0,
        y_a_px=200.0,
        x_b_px=799.0,
        y_b_px=200.0,
        box_px=(695.0, 190.0, 799.0, 210.0),
        length_px=SEEN_PX,
        width_px=sky.fwhm_px,
        snr=140.0,
        sigma_along_px=50.0,
        sigma_across_px=0.1,
        is_clipped=True,
        method="line",
    )
    light = FrameLight(
        frame=Frame(frame_id=1, name="cut", pixels=pixels, exposure_s=EXPOSURE_S),
        stars=find_stars(pixels),
        background=local_background(pixels),
        streaks=(("1-0", streak),),
    )
    return light, flux / EXPOSURE_S


def test_with_a_speed_it_has_the_light_of_the_whole_in_a_second() -> None:
    light, rate_adu_s = cut_streak()
    (found,) = photometry_of(light, {"1-0": WHOLE_PX / EXPOSURE_S}).streaks
    assert found.band == "instrumental"
    assert found.mag == pytest.approx(-2.5 * math.log10(rate_adu_s), abs=0.08)


def test_without_one_it_has_light_and_no_magnitude() -> None:
    light, _ = cut_streak()
    (found,) = photometry_of(light).streaks
    assert found.mag is None
    assert found.flux_adu > 0.0
