"""The curve that turns a measured candidate into a confidence, as shipped."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import ModelError, model_file_path
from rsoconsole.vision import FEATURES, Candidate, ConfidenceCurve, LineLight, PointImage
from rsoconsole.vision.detector.confidence import LENGTH_ERROR
from tests.makers import straight_detection

CARD = json.loads(model_file_path("streak_ssd.json").read_text(encoding="utf-8"))
CURVE = ConfidenceCurve.from_card(CARD)
PSF_PX = 2.4
FOCUS = PointImage(fwhm_px=PSF_PX)


def seen_so(even: bool = True, **found: float) -> Candidate:
    detection = straight_detection(**found)
    quartile = detection.snr if even else 0.3 * detection.snr
    light = LineLight(lower_quartile_snr=quartile, roughness=0.0 if even else 0.6)
    return Candidate(found=detection, light=light)


@given(
    network=st.floats(1e-6, 0.999),
    snr=st.floats(1.0, 500.0),
    length_px=st.floats(1.0, 600.0),
)
def test_confidence_is_a_probability_and_grows_with_what_is_seen(network, snr, length_px):
    given_so = {"width_px": PSF_PX, "length_px": length_px}
    seen = seen_so(confidence=network, snr=snr, **given_so)
    clearer = seen_so(confidence=network, snr=2.0 * snr, **given_so)
    believed = seen_so(confidence=min(0.999, 2.0 * network), snr=snr, **given_so)
    p = CURVE.confidence(seen, FOCUS)
    assert 0.0 <= p <= 1.0
    assert CURVE.confidence(clearer, FOCUS) >= p
    assert CURVE.confidence(believed, FOCUS) >= p


@given(
    network=st.floats(1e-6, 0.999),
    snr=st.floats(1.0, 500.0),
    length_px=st.floats(1.0, 600.0),
    width_px=st.floats(0.5, 8.0),
)
def test_no_measurement_lifts_a_proposal_above_the_highest(network, snr, length_px, width_px):
    seen = seen_so(confidence=network, snr=snr, length_px=length_px, width_px=width_px)
    highest = CURVE.highest_confidence(network, length_px / LENGTH_ERROR, FOCUS)
    assert CURVE.confidence(seen, FOCUS) <= highest * (1 + 1e-9)
    assert highest <= CURVE.highest_confidence(network, focus=FOCUS) * (1 + 1e-9)
    best = seen_so(confidence=network, snr=500.0, length_px=150.0, width_px=PSF_PX)
    assert CURVE.confidence(best, FOCUS) == pytest.approx(
        CURVE.highest_confidence(network, focus=FOCUS), rel=0.02
    )


def test_a_bright_chain_of_stars_that_the_network_does_not_believe_stays_below_tau():
    """What was met on the real sky: 55 px of stars at a signal to noise of 64."""
    chain = seen_so(False, confidence=0.003, snr=64.0, length_px=55.0, width_px=2.4)
    satellite = seen_so(confidence=0.5, snr=64.0, length_px=118.0, width_px=2.4)
    assert CURVE.confidence(chain, FOCUS) < CURVE.confidence(satellite, FOCUS)
    assert CURVE.confidence(satellite, FOCUS) > 0.5


@pytest.mark.parametrize("card", [{}, {"measured_confidence": {}}, {"measured_confidence": None}])
def test_a_card_without_the_curve_is_refused_with_the_remedy(card):
    with pytest.raises(ModelError, match=r"models\.confidence"):
        ConfidenceCurve.from_card(card)


def test_the_card_says_how_the_curve_was_judged():
    judged = CARD["measured_confidence"]["judged"]
    assert set(CARD["measured_confidence"]["weights"]) == set(FEATURES)
    assert judged["false_above_tau"] / judged["frames"] <= 1 / 200
    worst_bin = judged.get("worst_of_bins_with_enough")
    assert worst_bin is None or worst_bin <= 0.05


def test_a_card_whose_curve_was_made_for_other_features_is_refused():
    weights = CARD["measured_confidence"]["weights"]
    fewer = {name: weights[name] for name in FEATURES[:-1]}
    for odd in (fewer, weights | {"colour": 1.0}):
        with pytest.raises(ModelError, match=r"other features: (trailed drifted|colour)"):
            ConfidenceCurve.from_card({"measured_confidence": {"weights": odd}})


def test_drawn_out_stars_keep_a_streak_no_company():
    """Their trails are parallel lines of many lengths: under drift that tells of no aircraft."""
    streak = seen_so(confidence=0.05, snr=80.0, length_px=120.0, width_px=PSF_PX)
    beside = seen_so(
        confidence=0.05, snr=90.0, length_px=40.0, width_px=PSF_PX, x_px=500.0, y_px=300.0
    )
    still = CURVE.confidence(streak, FOCUS, [streak, beside])
    drift = PointImage(fwhm_px=PSF_PX, trail_px=25.0, trail_deg=90.0)
    assert CURVE.confidence(streak, FOCUS) > still
    assert CURVE.confidence(streak, drift, [streak, beside]) == CURVE.confidence(streak, drift)


def test_under_drift_what_runs_as_the_stars_do_is_believed_less():
    streak = seen_so(confidence=0.05, snr=80.0, length_px=120.0, width_px=PSF_PX)
    angle = streak.found.angle_deg
    said = [
        CURVE.confidence(
            streak, PointImage(fwhm_px=PSF_PX, trail_px=25.0, trail_deg=(angle + off) % 180.0)
        )
        for off in (0.0, 10.0, 30.0, 80.0)
    ]
    assert said[0] < said[1] < said[2] == said[3]
    assert said[2] > 0.5


def test_a_clear_line_is_believed_although_the_network_sees_nothing():
    """As in the video frames: sixty pixels long, each quarter of it far above the noise."""
    wide = PointImage(fwhm_px=4.7)
    clear = seen_so(confidence=0.0017, snr=166.0, length_px=64.0, width_px=2.8)
    dim = seen_so(confidence=0.0017, snr=16.0, length_px=64.0, width_px=2.8)
    assert CURVE.confidence(clear, wide) > max(0.1, CURVE.confidence(dim, wide))
