"""Figures from rows, counted by hand here, and the model card that holds them."""

import json
from dataclasses import asdict

import pytest

from models.card import CARD, FIGURES, PEERS, README, TIMES, read_json, rewritten
from models.figures import BELOW_TAU, average_precision, figures, outcome_of
from rsoconsole.vision import FEATURES, ConfidenceCurve, PointImage
from tests.makers import straight_detection

CURVE = ConfidenceCurve(tuple(1.0 if name.endswith("network") else 0.0 for name in FEATURES))
"""Says what the network said."""
TAU = 0.10


def test_the_curve_belongs_to_the_verifier_that_is_shipped():
    verifier = read_json(CARD.with_name("line_verifier.json"))
    assert read_json(CARD)["measured_confidence"]["verifier_sha256"] == verifier["sha256"]


def trail(peak_snr: float = 6.0, length_px: float = 118.0, lost: str = "") -> dict:
    return {
        "x_px": 300.0,
        "y_px": 200.0,
        "length_px": length_px,
        "peak_snr": peak_snr,
        "is_cut": False,
        "lost": lost,
    }


def candidate(confidence: float, on: int | None, error_px: float | None = None) -> dict:
    measured = asdict(straight_detection(confidence=confidence))
    light = {"roughness": 0.0}
    return {
        "measured": measured,
        "light": light,
        "trail": on,
        "is_taken": True,
        "error_px": error_px,
    }


def row(kind: str, number: int, trails: list[dict], candidates: list[dict]) -> dict:
    return {
        "kind": kind,
        "number": number,
        "focus": asdict(PointImage(fwhm_px=2.4)),
        "seeing_px": 2.2,
        "sky_e": 132.0,
        "stars": 200,
        "trails": trails,
        "candidates": candidates,
        "refused": {},
        "stage_ms": {},
    }


ROWS = [
    row("satellites", 0, [trail()], [candidate(0.9, 0, 0.2), candidate(0.3, 0, 9.0)]),
    row("satellites", 1, [trail(2.5), trail(lost="too faint")], [candidate(0.002, 0, 1.0)]),
    row("satellites", 2, [trail(2.5, 40.0)], [candidate(0.4, 0, 0.6), candidate(0.5, None)]),
    row("empty", 0, [], [candidate(0.00002, None)]),
    row("empty", 1, [], []),
    row("aircraft", 0, [], [candidate(0.8, None), candidate(0.7, None)]),
]
STATED = {"measured_confidence": {"population": {"one_frame_with_satellites_in": 2}}}


PEERS_TOLD = {
    "drawn": {
        "network": "streak_ssd 9 (12345678)",
        "lengths_px": [30.0, 150.0],
        "tuned_on": 4,
        "first_frames": 6,
        "peers": {
            "ours": {
                "failed": [],
                "wall_s": 0.05,
                "peak_mb": 300.4,
                "all": {
                    "all": {"frames": 60.0, "centroid_px": 0.13},
                    "1.5-2": {"average_precision": 0.91, "recall_at_0.1": 0.8},
                    "2-3": {"average_precision": None, "recall_at_0.1": 0.0},
                },
            },
            "slow": {
                "failed": ["time"],
                "wall_s": 12.0,
                "peak_mb": None,
                "all": {
                    "all": {"frames": 6.0, "centroid_px": None},
                    "1.5-2": {"average_precision": 0.1, "recall_at_0.1": 0.1},
                    "2-3": {"average_precision": None, "recall_at_0.1": None},
                },
            },
        },
    }
}


TIMED = {"background": 20.0, "map": 1.0, "stars": 9.0, "network": 15.0, "fit": 7.0}
TIMES_TOLD = {
    "network": "streak_ssd 9 (12345678)",
    "machine": "x86_64, 2 cores",
    "repeats": 9,
    "threads 1": {
        "frames": {"drawn: empty": TIMED | {"all": 80.0, "cold": 95.0, "detections": 0}},
        "extra_memory_mb": {"resident": 8.0},
    },
    "threads 2": {
        "frames": {"drawn: empty": TIMED | {"all": 52.0, "cold": 66.0, "detections": 0}},
        "extra_memory_mb": {"resident": 10.0},
    },
}


def test_every_trail_and_every_false_alarm_is_counted_once():
    told = figures(ROWS, CURVE, STATED, TAU)
    bright = told["recall"]["5-30"]["90-150"]
    assert (bright["found"], bright["of"]) == (1, 2)
    assert told["recall"]["2-3"]["90-150"]["found"] == 0
    assert told["recall"]["2-3"]["30-60"]["recall"] == 1.0
    assert told["lost"]["5-30"] == {"too faint": 1}
    assert told["lost"]["2-3"] == {BELOW_TAU: 1}
    assert told["midpoint_error_px"]["5-30"]["median"] == 0.2
    assert told["second_detections"] == [1, 4]
    alarms = {name: each and each["count"] for name, each in told["false_alarms"].items()}
    assert alarms["ordinary, no satellite"] == 0
    assert alarms["ordinary, beside satellites"] == 1
    assert (alarms["aircraft"], alarms["jitter"], alarms["all hard kinds"]) == (2, None, 2)
    three_over_two_thousandths = 2.996 / 0.002
    limit = told["false_alarms"]["ordinary, no satellite"]["upper_limit"]
    assert limit == pytest.approx(three_over_two_thousandths, rel=1e-3)


def test_average_precision_is_the_area_counted_by_hand():
    """By confidence: hit .9, false .5, hit .4, hit .002, false .00002 (weighing 3 / 2)."""
    by_hand = (1 / 1 + 2 / 3 + 3 / 4) / 4
    assert average_precision(outcome_of(ROWS, CURVE, TAU), 0.8) == pytest.approx(by_hand, abs=1e-4)


def test_the_model_card_holds_the_measured_figures_and_no_others():
    text = README.read_text(encoding="utf-8")
    told = (read_json(path) for path in (FIGURES, CARD, PEERS, TIMES))
    assert rewritten(text, *told) == text


@pytest.mark.skipif(not FIGURES.exists(), reason="nothing measured yet: python -m models.measure")
def test_the_figures_are_of_the_network_and_the_curve_that_ship():
    told, card = read_json(FIGURES), read_json(CARD)
    assert told["network"] == f"{card['name']} {card['version']} ({card['sha256'][:8]})"
    assert told["curve"] == pytest.approx(card["measured_confidence"]["weights"])
    assert told["product_as_it_is"]["differing"] == []
    assert read_json(PEERS)["drawn"]["network"] == told["network"]
    assert read_json(TIMES)["network"] == told["network"]


def test_the_card_of_figures_can_be_written_from_any_measurement():
    shares = {"clear": 0.9, "clouds": 0.1}
    card = {
        "measured_confidence": {
            "population": {"one_frame_with_satellites_in": 2, "shares_of_frames": shares}
        }
    }
    told = figures(ROWS, CURVE, card, TAU) | {
        "network": "streak_ssd 9 (12345678)",
        "product_as_it_is": {
            "frames": 3,
            "differing": [],
        },
    }
    written = rewritten(
        README.read_text(encoding="utf-8"),
        json.loads(json.dumps(told)),
        card,
        PEERS_TOLD,
        TIMES_TOLD,
    )
    assert "**0.50** (0.01-0.99; 1 of 2)" in written
    assert "| aircraft | 2 in 1 |" in written
    assert "one clear or cloudy frame in 2 holds" in written
    assert "| ours | 60 | 0.91 / 0.80 | - / 0.00 | 0.13 | 0.05 | 300 |" in written
    assert "| drawn: empty | 80 (95) | 52 (66) | 20 | 1 | 9 | 15 | 7 | 0 |" in written
    assert "| slow | 6 (1 without an answer) | 0.10 | - | - | 12.00 | - |" in written
