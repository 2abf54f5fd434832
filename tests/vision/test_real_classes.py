"""Classes of real satellites, meteors and an aircraft, as an all-sky video camera saw them.

Frames of the Global Meteor Network, 88 by 47 degrees: the brightest of 256 video frames at every
pixel, so that an aircraft's strobes and a meteor's flare stand in them as they were. The ends are
those that were found by eye; whether the detector finds these streaks is asked elsewhere.
"""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.records import Detection, Frame
from rsoconsole.vision import StreakFit, find_stars, fit_streak, local_background
from rsoconsole.vision.streaks.streak_classes import classify_streaks

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "field" / "gmn"
EXPOSURE_S, SCALE_ARCSEC_PX = 10.24, 249.6
pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not FOLDER.exists(), reason=f"{FOLDER} is not here"),
]


@cache
def frame_of(name: str) -> Frame:
    from astropy.io import fits

    with fits.open(FOLDER / name) as file:
        pixels = np.asarray(file["MAXPIXEL"].data, dtype=np.uint16)
    return Frame(frame_id=1, name=name, pixels=pixels)


def told(true: dict, *, is_plate_known: bool) -> Detection:
    """What is said of a streak with these ends, its width as the fit measures it."""
    frame = frame_of(true["file"])
    if is_plate_known:
        frame = replace(frame, exposure_s=EXPOSURE_S, scale_arcsec_px=SCALE_ARCSEC_PX)
    sky = local_background(frame.pixels)
    stars = find_stars(frame.pixels, sky)
    (x_a, y_a), (x_b, y_b) = true["a"], true["b"]
    box = min(x_a, x_b) - 3.0, min(y_a, y_b) - 3.0, max(x_a, x_b) + 3.0, max(y_a, y_b) + 3.0
    found = fit_streak(frame.pixels, sky, box, stars=stars, ends=(x_a, y_a, x_b, y_b))
    fit = found if isinstance(found, StreakFit) else found.fit
    assert fit is not None
    streak = Detection(
        frame_id=1,
        confidence=0.9,
        x_px=0.5 * (x_a + x_b),
        y_px=0.5 * (y_a + y_b),
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        box_px=box,
        length_px=math.dist((x_a, y_a), (x_b, y_b)),
        width_px=fit.width_px,
        snr=fit.snr,
        sigma_along_px=0.5,
        sigma_across_px=0.1,
        is_clipped=False,
        method="line",
        unevenness=fit.unevenness,
    )
    (one,), *_ = classify_streaks(frame, sky, stars, [streak])
    return one


def truth(kind: str) -> list[dict]:
    return json.loads((FOLDER / "truth.json").read_text())[kind]


@pytest.fixture(params=[False, True], ids=["plate unknown", "plate known"])
def is_plate_known(request: pytest.FixtureRequest) -> bool:
    return request.param


def test_satellites_are_satellites_or_undetermined(is_plate_known):
    found = [told(each, is_plate_known=is_plate_known) for each in truth("satellites")]
    classes = [each.object_class for each in found]
    assert set(classes) <= {"satellite", "undetermined"}
    three_of_five = 3
    assert classes.count("satellite") >= three_of_five


def test_the_aircrafts_strobes_name_it(is_plate_known):
    """About twenty flashes in 10.24 s, counted by eye."""
    (found,) = [told(each, is_plate_known=is_plate_known) for each in truth("aircraft")]
    assert found.object_class == "aircraft"
    assert found.modulation_period_px is not None
    two_flashes = 2.0
    assert found.length_px / found.modulation_period_px == pytest.approx(20.0, abs=two_flashes)
    if is_plate_known:
        assert found.modulation_period_s == pytest.approx(EXPOSURE_S / 20.0, rel=0.1)


def test_meteors_are_no_satellites(is_plate_known):
    for each in truth("meteors"):
        found = told(each, is_plate_known=is_plate_known)
        assert found.object_class == "meteor"
        assert found.class_probability > 2.0 / 3.0
