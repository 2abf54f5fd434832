"""The rule that judges detectors side by side, on cases whose answers can be worked out by hand."""

import math

import numpy as np
import pytest

from tests.bench.peers.frames import ridge_share
from tests.bench.peers.joining import joined
from tests.bench.peers.scoring import (
    Candidate,
    Line,
    TrueStreak,
    average_precision,
    is_found,
    judge,
    recall_at,
    summary,
)

BINS = ((1.5, 3.0), (3.0, 10.0))


def line(x, y, length=100.0, angle_deg=0.0):
    """A streak about (x, y)."""
    dx = length / 2 * math.cos(math.radians(angle_deg))
    dy = length / 2 * math.sin(math.radians(angle_deg))
    return Line(x_a_px=x - dx, y_a_px=y - dy, x_b_px=x + dx, y_b_px=y + dy)


def said(score, *where, **how):
    return Candidate(line=line(*where, **how), score=score)


def true(snr, *where, **how):
    return TrueStreak(line=line(*where, **how), snr=snr)


@pytest.mark.parametrize(
    ("candidate", "is_same"),
    [
        (line(500, 500), True),
        (line(529, 500), True),  # 0.3 lengths are 30 px
        (line(531, 500), False),
        (line(500, 500, angle_deg=14), True),
        (line(500, 500, angle_deg=16), False),
        (line(500, 500, angle_deg=-14), True),
        (line(500, 500, angle_deg=180), True),  # an axis has no head
        (line(500, 500, length=300), True),  # the length itself is not asked for
    ],
)
def test_a_streak_is_found_by_its_midpoint_and_its_axis(candidate, is_same):
    assert is_found(candidate, line(500, 500)) is is_same


def test_ten_pixels_are_granted_to_short_streaks():
    assert is_found(line(109.5, 100, length=20), line(100, 100, length=20))
    assert not is_found(line(110.5, 100, length=20), line(100, 100, length=20))


def test_an_axis_wraps_at_180_degrees():
    assert is_found(line(0, 0, angle_deg=176), line(0, 0, angle_deg=3))


def test_each_streak_is_found_once_and_a_second_candidate_on_it_counts_neither_way():
    judged = judge([said(0.9, 500, 500), said(0.8, 505, 500)], [true(5, 500, 500)])
    assert [(score, error) for _, score, error in judged.found] == [(0.9, 0.0)]
    assert judged.false_scores == ()


def test_a_candidate_across_a_streak_is_no_invention_but_one_beside_it_is():
    judged = judge([said(0.9, 540, 500, angle_deg=90), said(0.7, 500, 515)], [true(5, 500, 500)])
    assert judged.found[0][1] == 0.7  # within 0.3 lengths
    assert judged.false_scores == ()
    beside = judge([said(0.7, 500, 535)], [true(5, 500, 500)])
    assert beside.found[0][1] is None
    assert beside.false_scores == (0.7,)


def test_a_candidate_goes_to_the_nearer_of_two_streaks():
    judged = judge([said(0.9, 500, 511)], [true(5, 500, 500), true(6, 500, 520)])
    assert [score for _, score, _ in judged.found] == [None, 0.9]


def test_average_precision_of_a_hand_made_ranking():
    # true, false, true, and one of three streaks never found:
    # precision 1 up to recall 1/3, 2/3 up to 2/3, nothing beyond.
    ap = average_precision(np.array([0.9, 0.7]), np.array([0.8]), 3)
    assert ap == pytest.approx((1 + 2 / 3) / 3)


def test_average_precision_of_a_perfect_and_of_an_empty_answer():
    assert average_precision(np.array([0.9, 0.8]), np.array([0.1]), 2) == 1.0
    assert average_precision(np.array([]), np.array([0.1]), 2) == 0.0
    assert average_precision(np.array([]), np.array([]), 2) == 0.0
    assert math.isnan(average_precision(np.array([]), np.array([0.1]), 0))


def test_equal_scores_are_no_ranking():
    # A detector without a score cannot gain from the order in which it names things.
    ap = average_precision(np.array([1.0]), np.array([1.0, 1.0, 1.0]), 1)
    assert ap == pytest.approx(0.25)


def test_precision_is_made_monotonic():
    # false, true, true: 2/3 at the end lifts the 1/2 before it.
    ap = average_precision(np.array([0.8, 0.7]), np.array([0.9]), 2)
    assert ap == pytest.approx(2 / 3)


def test_recall_at_equal_false_candidates():
    found, false = np.array([0.9, 0.6, 0.4]), np.array([0.7, 0.5])
    assert recall_at(found, false, 4, 0) == 0.25
    assert recall_at(found, false, 4, 1) == 0.5
    assert recall_at(found, false, 4, 2) == 0.75
    assert recall_at(found, false, 4, 99) == 0.75


def test_recall_does_not_count_what_ties_with_the_false_one():
    assert recall_at(np.array([0.7]), np.array([0.7]), 1, 0) == 0.0


def test_a_range_of_signal_is_charged_with_all_inventions_and_with_no_other_streak():
    judged = [
        judge([said(0.9, 500, 500), said(0.5, 900, 900)], [true(5, 500, 500)]),
        judge([said(0.4, 300, 304)], [true(2, 300, 300)]),
    ]
    report = summary(judged, BINS, (0.0, 0.5))
    assert report["3-10"]["average_precision"] == 1.0
    assert report["1.5-3"]["average_precision"] == 0.5
    assert report["1.5-3"]["recall_at_0"] == 0.0
    assert report["1.5-3"]["recall_at_0.5"] == 1.0
    assert report["1.5-3"]["centroid_px"] == pytest.approx(4.0)
    assert report["all"]["asked"] == 2
    assert report["all"]["centroid_px"] == pytest.approx(2.0)
    assert report["all"]["false_per_frame"] == 0.5


def test_two_edges_and_two_pieces_of_a_streak_are_joined():
    edges = [said(5, 100, 98), said(4, 100, 102), said(3, 190, 100, length=70)]
    (whole,) = joined([*edges, said(1, 100, 300), said(1, 100, 100, angle_deg=60)][:3])
    assert whole.score == 5
    x, y = whole.line.middle_px
    assert (x, y) == pytest.approx((137.5, 100.0))
    assert whole.line.length_px == pytest.approx(175.0)


def test_neighbours_and_crossing_lines_stay_apart():
    apart = [said(3, 100, 100), said(2, 100, 120), said(1, 100, 100, angle_deg=60)]
    assert len(joined(apart)) == 3


@pytest.mark.parametrize("fwhm_px", [1.8, 3.2])
def test_the_drawn_ridge_is_as_high_as_the_truth_says(fwhm_px):
    from dataclasses import replace

    from rsoconsole.simulator import FieldContent, SensorModel, straight_streak
    from rsoconsole.simulator.camera.rendering import expected_electrons

    sensor = replace(
        SensorModel(width_px=240, height_px=160),
        vignetting_corner=0.0,
        prnu=0.0,
        hot_fraction=0.0,
        dark_e_s=0.0,
    )
    content = FieldContent(
        sky_electrons_px=0.0,
        fwhm_px=fwhm_px,
        streaks=(straight_streak((50.0, 80.0), (190.0, 80.0), 140 * 100.0),),
    )
    ridge_e = float(np.median(expected_electrons(sensor, content)[:, 80:160].max(axis=0)))
    three_percent = 0.03
    assert ridge_e == pytest.approx(100.0 * ridge_share(fwhm_px), rel=three_percent)
