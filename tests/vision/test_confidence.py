"""The curve that turns a measured candidate into a confidence, as shipped."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import ModelError, model_file_path
from rsoconsole.vision import FEATURES, Candidate, ConfidenceCurve, LineLight, PointImage
from tests.makers import straight_detection

CARD = json.loads(model_file_path("streak_ssd.json").read_text(encoding="utf-8"))
CURVE = ConfidenceCurve.from_card(CARD)
PSF_PX = 2.4
FOCUS = PointImage(fwhm_px=PSF_PX)


def seen_so(log_odds: float, *, is_even: bool = True, **found: float) -> Candidate:
    detection = straight_detection(**found)
    roughness = 0.0 if is_even else 0.6
    light = LineLight(roughness=roughness, log_odds=log_odds)
    return Candidate(found=detection, light=light)


@given(
    network=st.floats(1e-6, 0.4), log_odds=st.floats(-20.0, 20.0), length_px=st.floats(1.0, 600.0)
)
def test_confidence_is_a_probability_and_grows_with_what_both_networks_say(
    network, log_odds, length_px
):
    given_so = {"width_px": PSF_PX, "length_px": length_px}
    p = CURVE.confidence(seen_so(log_odds, confidence=network, **given_so), FOCUS)
    assert 0.0 <= p <= 1.0
    for more in (
        seen_so(log_odds + 1.0, confidence=network, **given_so),
        seen_so(log_odds, confidence=2.0 * network, **given_so),
    ):
        assert CURVE.confidence(more, FOCUS) >= p


def test_the_verifier_s_word_decides_whatever_the_first_network_says():
    for network in (1e-5, 0.5):
        given_so = {"confidence": network, "snr": 60.0, "length_px": 118.0, "width_px": PSF_PX}
        assert CURVE.confidence(seen_so(9.0, **given_so), FOCUS) > 0.5
        assert CURVE.confidence(seen_so(-4.0, **given_so), FOCUS) < 0.1


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
    streak = seen_so(5.0, confidence=0.05, snr=80.0, length_px=120.0, width_px=PSF_PX)
    beside = seen_so(
        5.0, confidence=0.05, snr=90.0, length_px=40.0, width_px=PSF_PX, x_px=500.0, y_px=300.0
    )
    still = CURVE.confidence(streak, FOCUS, [streak, beside])
    drift = PointImage(fwhm_px=PSF_PX, trail_px=25.0, trail_deg=90.0)
    assert CURVE.confidence(streak, FOCUS) > still
    assert CURVE.confidence(streak, drift, [streak, beside]) == CURVE.confidence(streak, drift)
