"""What a streak is, of drawn objects far from those that the classifier was made with."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.records import Detection, NotAStreak, Rejection
from rsoconsole.vision import find_stars, local_background, most_likely_class
from rsoconsole.vision.streaks._streak_light import Fading
from rsoconsole.vision.streaks.class_probabilities import ClassEvidence, probabilities_from_evidence
from rsoconsole.vision.streaks.streak_classes import classify_streaks
from tests.drawn.drawn_classes import Drawn, drawn
from tests.tiers import plain_first

SEEDS = range(1000, 1025)
TELESCOPE = {"scale_arcsec_px": 1.3, "exposure_s": 10.0}
ALL_SKY = {"scale_arcsec_px": 200.0, "exposure_s": 10.0}


def seen(one: Drawn) -> Detection:
    """The streak with the name that its own frame gives it."""
    sky = local_background(one.frame.pixels)
    stars = find_stars(one.frame.pixels, sky)
    (streak,), *_ = classify_streaks(one.frame, sky, stars, [one.streak])
    return streak


def classes(what: str, **frame: float) -> Counter[str]:
    return Counter(seen(drawn(what, seed, **frame)).object_class for seed in SEEDS)


@pytest.mark.parametrize("what", plain_first(1, ["tumbling", "even", "into shadow"]))
@pytest.mark.parametrize("frame", [{}, TELESCOPE, ALL_SKY], ids=["any", "telescope", "all sky"])
def test_a_satellite_is_hardly_ever_taken_for_what_starts_no_track(what, frame):
    found = classes(what, **frame)
    one_in_25 = 1
    assert found["satellite"] + found["undetermined"] >= len(SEEDS) - one_in_25, found


@pytest.mark.parametrize("what", ["even", "into shadow"])
def test_an_even_light_from_shutter_to_shutter_is_a_satellites(what):
    found = classes(what)
    nine_in_ten = 0.9 * len(SEEDS)
    assert found["satellite"] >= nine_in_ten, found


@pytest.mark.parametrize("frame", [{}, ALL_SKY], ids=["any", "all sky"])
def test_regular_flashes_are_an_aircrafts(frame):
    found = classes("strobe", **frame)
    assert found["aircraft"] >= 0.9 * len(SEEDS), found
    assert found["satellite"] == 0


def test_what_flashes_as_slowly_as_a_satellite_moves_is_no_aircraft():
    assert classes("strobe", **TELESCOPE)["aircraft"] == 0


@pytest.mark.parametrize("frame", [{}, ALL_SKY], ids=["any", "all sky"])
def test_light_that_grows_and_dies_is_a_meteors(frame):
    found = classes("meteor", **frame)
    assert found["meteor"] >= 0.5 * len(SEEDS), found
    assert found["satellite"] <= 0.25 * len(SEEDS), found
    assert set(found) <= {"meteor", "satellite", "undetermined"}, found


def test_what_is_sharper_than_the_stars_and_lumpy_is_a_cosmic_ray():
    found = classes("ray")
    assert found["cosmic ray"] >= 0.8 * len(SEEDS), found
    assert found["satellite"] == 0


def test_a_few_stars_in_a_row_are_no_satellite():
    found = classes("stars", **TELESCOPE)
    assert found["satellite"] <= 0.1 * len(SEEDS), found
    assert found["star chain"] > 0, found


def test_what_nothing_is_known_of_is_undetermined():
    nothing = ClassEvidence(
        kind="crossing",
        length_px=500.0,
        width_px=0.0,
        snr=0.0,
        star_fwhm_px=2.5,
        star_scatter=0.05,
    )
    name, probability = most_likely_class(probabilities_from_evidence(nothing))
    assert name == "undetermined"
    assert probability == pytest.approx(1.0 - max(probabilities_from_evidence(nothing).values()))


def crossing(width: float, snr: float = 500.0, scatter: float = 0.03, **more) -> ClassEvidence:
    """A line right through a telescope's field, so wide against the stars."""
    return ClassEvidence(
        kind="crossing",
        length_px=1500.0,
        width_px=3.0 * width,
        snr=snr,
        star_fwhm_px=3.0,
        star_scatter=scatter,
        scale_arcsec_px=1.3,
        exposure_s=2.0,
        aperture_m=0.3,
        **more,
    )


def test_what_is_out_of_focus_is_too_near_to_be_a_satellite():
    sharp, blurred = (probabilities_from_evidence(crossing(width)) for width in (1.0, 1.45))
    assert most_likely_class(probabilities_from_evidence(crossing(1.0)))[0] == "satellite"
    assert most_likely_class(probabilities_from_evidence(crossing(1.45)))[0] == "aircraft"
    assert sharp["aircraft"] < 0.2
    assert blurred["satellite"] < 0.1


def test_a_width_known_badly_decides_nothing():
    assert most_likely_class(probabilities_from_evidence(crossing(1.45, snr=8.0, scatter=0.4)))[
        0
    ] in {
        "undetermined",
        "satellite",
    }


@pytest.mark.parametrize("shorter_px", [0.0, 1.0, 2.0])
def test_one_end_that_dies_is_the_shadow_and_no_meteor(shorter_px):
    fading = Fading(shorter_px=shorter_px, longer_px=60.0, length_px=250.0)
    told = probabilities_from_evidence(
        replace(crossing(1.0), kind="streak", length_px=250.0, fading=fading)
    )
    assert told["satellite"] > told["meteor"]


@pytest.mark.parametrize("seed", range(5))
def test_no_pulse_is_seen_in_even_light(seed):
    for again in range(8):
        streak = seen(drawn("even", 2000 + 8 * seed + again))
        assert streak.modulation_period_px is None
        assert streak.modulation_depth is None


def test_a_pulse_is_reported_with_its_period_in_pixels_and_in_seconds():
    known = []
    for seed in SEEDS:
        one = drawn("tumbling", seed, ridge_snr=(5.0, 60.0), **TELESCOPE)
        streak = seen(one)
        if streak.modulation_period_px is None:
            continue
        pulses = streak.length_px / streak.modulation_period_px
        assert streak.modulation_period_s == pytest.approx(10.0 / pulses, rel=0.05)
        assert 0.0 < streak.modulation_depth <= 1.0
        known.append(abs(pulses / one.pulses - 1.0))
    five_percent = 0.05
    assert len(known) >= 0.75 * len(SEEDS)
    assert np.mean(np.array(known) < five_percent) > 0.9


def test_what_was_rejected_is_named_too_and_what_was_not_measured_is_not():
    one = drawn("even", 1)
    sky = local_background(one.frame.pixels)
    stars = find_stars(one.frame.pixels, sky)
    boxed = replace(one.streak, width_px=0.0, snr=0.0, method="box")
    trailed = NotAStreak(kind="stars' trails", value=30.0, limit=12.0)
    told = [Rejection(detection=each, reason=trailed) for each in (one.streak, boxed)]
    _, (first, second), _ = classify_streaks(one.frame, sky, stars, [], told)
    assert first.detection.object_class == "star chain"
    assert second.detection == boxed
    assert (first.reason, second.reason) == (trailed, trailed)


def test_a_streak_that_leaves_the_frame_is_looked_at_as_far_as_it_goes():
    one = drawn("even", 3)
    outside = replace(
        one.streak,
        x_b_px=one.streak.x_b_px + 900.0 * np.sign(one.streak.x_b_px - one.streak.x_a_px),
        kind="crossing",
        is_clipped=True,
    )
    sky = local_background(one.frame.pixels)
    (found,), *_ = classify_streaks(one.frame, sky, find_stars(one.frame.pixels, sky), [outside])
    assert 0.0 <= found.class_probability <= 1.0
    assert found.modulation_period_s is None
