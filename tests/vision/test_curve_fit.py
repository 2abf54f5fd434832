"""The fit of the curve of confidence: probabilities in a stated population, and tau within it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models.curve_fit import (
    SHARES,
    Candidates,
    fit_curve,
    fit_scale,
    fit_weights,
    population_weights,
    reliability,
)
from rsoconsole.vision import (
    FEATURE_NAMES,
    FEATURES,
    IMAGE_KINDS,
    Candidate,
    LineLight,
    PointImage,
    confidence_features,
)
from tests.makers import straight_detection

NETWORK, SAID, WIDE = (FEATURES.index(name) for name in ("network", "verifier", "wide"))
PSF_PX = 2.4


def drawn(seed: int, frames: dict[str, int], *, false_network: float = -6.0) -> Candidates:
    """Candidates of made-up frames: one satellite a frame that has any; aircraft are wide."""
    rng = np.random.default_rng(seed)
    features, is_true, kinds, numbers = [], [], [], []
    for kind, count in frames.items():
        for number in range(count):
            some = {"aircraft": 2.0, "jitter": 1.0, "rays": 1.0}.get(kind, 0.3)
            truths = [True] * (kind in {"satellites", "clouds"}) + [False] * rng.poisson(some)
            for truth in truths:
                row = np.zeros(len(FEATURES))
                row[0] = 1.0
                row[NETWORK] = rng.normal(0.5 if truth else false_network, 2.0)
                row[SAID] = rng.normal(0.0 if truth else -0.7, 0.4)
                row[WIDE] = max(0.0, rng.normal(0.4, 0.1)) * (kind == "aircraft" and not truth)
                features.append(row)
                is_true.append(truth)
                kinds.append(kind)
                numbers.append(number)
    return Candidates(
        features=np.array(features),
        is_true=np.array(is_true),
        kind=tuple(kinds),
        frame=np.array(numbers),
        frames=frames,
    )


FRAMES = {"empty": 900, "satellites": 700, "clouds": 100, "aircraft": 80, "jitter": 60, "rays": 60}


@pytest.mark.parametrize("one_in", [2, 20])
def test_confidence_is_a_probability_in_the_stated_population(one_in):
    many = {kind: 8 * count for kind, count in FRAMES.items()}
    curve, fresh = fit_curve(drawn(1, many), one_in), drawn(2, many)
    confidence = curve.confidence(fresh.features)
    table = reliability(confidence, fresh.is_true, population_weights(fresh, one_in))
    judged = [each for each in table if each["candidates"] >= 200]
    assert len(judged) >= 3
    for each in judged:
        assert each["said"] == pytest.approx(each["share"], abs=0.05)


def test_a_row_weighs_as_often_as_it_comes_in_a_frame_of_the_population():
    them = drawn(3, FRAMES)
    weights = population_weights(them, 10)
    satellites = them.is_true & them.of_kind("satellites")
    clear_with_satellites = SHARES["clear"] / 10
    assert weights[satellites].sum() == pytest.approx(clear_with_satellites)
    aircraft = them.of_kind("aircraft")
    two_a_frame = 2.0
    assert weights[aircraft].sum() == pytest.approx(SHARES["aircraft"] * two_a_frame, rel=0.2)


def test_the_rarer_satellites_are_the_less_is_believed_and_the_fewer_false_ones_pass():
    them = drawn(4, FRAMES)
    often, seldom = fit_curve(them, 2), fit_curve(them, 100)
    one = np.zeros((1, len(FEATURES)))
    one[0, 0], one[0, NETWORK] = 1.0, -2.0
    assert seldom.confidence(one)[0] < often.confidence(one)[0]
    false = them.features[~them.is_true]
    assert (seldom.confidence(false) > 0.1).sum() < (often.confidence(false) > 0.1).sum()


def test_the_prevalence_is_lowered_until_tau_keeps_ordinary_nights():
    many = {kind: 4 * count for kind, count in FRAMES.items()}
    them = drawn(15, many, false_network=-10.0)
    curve = fit_curve(them)
    assert curve.keeps_ordinary
    assert curve.frames_per_satellite > 2
    fresh = drawn(16, {"empty": 20_000}, false_network=-10.0)
    false_a_thousand = (curve.confidence(fresh.features) > 0.1).sum() / 20.0
    assert false_a_thousand <= 1.0
    before = fit_curve(them, 2)
    assert not before.keeps_ordinary
    assert (before.confidence(fresh.features) > 0.1).sum() / 20.0 > 1.0


def test_no_weight_takes_the_sign_that_would_make_it_a_quirk_of_the_sample():
    rng = np.random.default_rng(7)
    features = np.zeros((400, len(FEATURES)))
    features[:, 0] = 1.0
    is_true = rng.random(400) < 0.5
    features[:, NETWORK] = np.where(is_true, -3.0, 3.0) + rng.normal(0, 1, 400)
    features[:, WIDE] = is_true * rng.random(400)
    weights = fit_weights(features, is_true)
    assert weights[NETWORK] == 0.0
    assert weights[WIDE] == 0.0


def test_the_scale_returns_the_odds_that_weighed_rows_were_drawn_with():
    rng = np.random.default_rng(8)
    z = rng.uniform(-4, 4, 60_000)
    is_true = rng.random(z.size) < 1 / (1 + np.exp(-(1.7 * z - 0.8)))
    slope, constant = fit_scale(z, is_true, np.where(is_true, 0.1, 1.0))
    assert slope == pytest.approx(1.7, abs=0.1)
    assert constant == pytest.approx(-0.8 + math.log(0.1), abs=0.1)


def _seen(detection, *others):
    one, *rest = (
        Candidate(found=each, light=LineLight(roughness=0.0)) for each in (detection, *others)
    )
    features = confidence_features(one, PointImage(fwhm_px=PSF_PX), (one, *rest))
    return dict(zip(FEATURES, features, strict=True))


def test_the_width_speaks_against_only_beyond_what_noise_leaves_open():
    wide = straight_detection(width_px=1.4 * PSF_PX, snr=60.0)
    narrow = straight_detection(width_px=PSF_PX / 1.4, snr=60.0)
    faint = straight_detection(width_px=1.2 * PSF_PX, snr=9.0)
    assert _seen(wide)["wide"] > 0.2
    assert _seen(narrow)["wide"] == _seen(faint)["wide"] == 0.0


def test_flashes_on_one_line_and_lights_beside_a_long_trail_are_known_by_their_company():
    one = straight_detection(x_px=300.0, y_px=200.0, angle_deg=20.0, length_px=100.0)
    cos, sin = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
    ahead = straight_detection(
        x_px=300.0 + 900.0 * cos, y_px=200.0 + 900.0 * sin, angle_deg=20.0, length_px=100.0
    )
    beside = straight_detection(
        x_px=300.0 - 90.0 * sin, y_px=200.0 + 90.0 * cos, angle_deg=20.4, length_px=104.0
    )
    long = straight_detection(x_px=900.0, y_px=700.0, angle_deg=20.3, length_px=900.0)
    alone = _seen(one)
    assert (alone["in_line"], alone["parallel_unlike"]) == (0.0, 0.0)
    further = straight_detection(
        x_px=300.0 - 700.0 * cos, y_px=200.0 - 700.0 * sin, angle_deg=20.0, length_px=100.0
    )
    assert _seen(one, ahead, further)["in_line"] == 1.0
    assert _seen(one, ahead)["in_line"] == 0.0, "two of a slot are often in line"
    neighbours_in_a_slot = _seen(one, beside)
    assert (neighbours_in_a_slot["in_line"], neighbours_in_a_slot["parallel_unlike"]) == (0.0, 0.0)
    assert _seen(one, replace(beside, length_px=130.0))["parallel_unlike"] == 1.0
    assert _seen(one, long)["parallel_unlike"] == 1.0
    # A bright one of another length is a light too, a faint one may be a few stars in a row.
    assert _seen(long, replace(one, snr=60.0))["parallel_unlike"] == 1.0
    assert _seen(long, replace(one, snr=10.0))["parallel_unlike"] == 0.0
    cut_by_the_edge = replace(one, snr=60.0, is_clipped=True)
    assert _seen(long, cut_by_the_edge)["parallel_unlike"] == 0.0


def test_each_way_of_showing_stars_has_weights_of_its_own_where_satellites_tell_them():
    sharp, wide = drawn(17, FRAMES), drawn(18, FRAMES)
    moved = np.roll(wide.features, len(FEATURE_NAMES), axis=1)
    # There the network is wrong as often as right.
    moved[:, NETWORK + len(FEATURE_NAMES)] = np.random.default_rng(19).normal(0.0, 2.0, len(moved))
    both = replace(
        sharp,
        features=np.concatenate([sharp.features, moved]),
        is_true=np.concatenate([sharp.is_true, wide.is_true]),
        kind=sharp.kind + wide.kind,
        frame=np.concatenate([sharp.frame, wide.frame + sum(FRAMES.values())]),
        frames={kind: 2 * count for kind, count in FRAMES.items()},
    )
    weights = dict(zip(FEATURES, fit_curve(both, 10).weights, strict=True))
    assert weights["network"] > 5.0 * weights["joined network"]
    assert weights["joined verifier"] > 0.5
    for name in FEATURE_NAMES:
        assert weights[f"trailed {name}"] == weights[name]
    assert IMAGE_KINDS == ("", "joined ", "trailed ")
