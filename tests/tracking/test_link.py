"""Tracklets: points of one night joined by their common motion, arcs of two nights by one orbit."""

import json
from collections import defaultdict
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from rsoconsole.orbits import probability_from_log_odds, tracklet_orbit
from rsoconsole.orbits.determination.join import log_odds_same_object
from rsoconsole.records import FloatArray
from rsoconsole.tracking import MotionPrior, link_points
from rsoconsole.tracking.initiation.link import best_disjoint_sets
from tests.truth.seen_satellites import SHARED, geostationary, instants, seen

SPOTGEO = SHARED / "linking" / "spotgeo_truth_1_640.json"
WIDTH_PX, HEIGHT_PX = 640.0, 480.0
FRAMES = 5
KNOWN = MotionPrior(sigma=0.55, area=WIDTH_PX * HEIGHT_PX, largest_speed=60.0)
"""0.5 px of noise, and annotations good to 0.2 px."""
Point = tuple[int, int]


@cache
def annotated() -> tuple[tuple[FloatArray, ...], ...]:
    """Object positions (M, 2) in the five frames of each sequence that has objects."""
    frames: dict[int, dict[int, FloatArray]] = defaultdict(dict)
    for row in json.loads(SPOTGEO.read_text()):
        frames[row["sequence_id"]][row["frame"]] = np.reshape(row["object_coords"], (-1, 2))
    sequences = (tuple(each[n] for n in sorted(each)) for _, each in sorted(frames.items()))
    return tuple(each for each in sequences if len(each[0]))


def spoilt(
    sequence: tuple[FloatArray, ...], random: np.random.Generator
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Points with 0.5 px of noise, a tenth gone and two false ones a frame; and whose each is."""
    points, owners = [], []
    for objects in sequence:
        kept = random.random(len(objects)) > 0.1
        true = objects[kept] + random.normal(0.0, 0.5, (int(kept.sum()), 2))
        false = random.uniform((0.0, 0.0), (WIDTH_PX, HEIGHT_PX), (2, 2))
        order = random.permutation(len(true) + 2)
        points.append(np.concatenate([true, false])[order])
        owners.append(np.concatenate([np.flatnonzero(kept), [-1, -1]])[order])
    return points, owners


def true_links(owners: list[FloatArray]) -> set[tuple[Point, Point]]:
    """Each point of an object and the next one of it."""
    found: set[tuple[Point, Point]] = set()
    for number in {int(n) for each in owners for n in each} - {-1}:
        own = [
            (frame, int(np.flatnonzero(each == number)[0]))
            for frame, each in enumerate(owners)
            if number in each
        ]
        found |= set(pairwise(own))
    return found


@pytest.mark.nightly("many real sequences")
@pytest.mark.shared_data
@pytest.mark.skipif(not SPOTGEO.exists(), reason=f"{SPOTGEO} is not here")
@pytest.mark.parametrize("seed", [1, 2])
def test_links_of_real_sequences_are_right_and_as_sure_as_they_claim(seed: int) -> None:
    """F1 counts links: a point and the next one of the same object."""
    random = np.random.default_rng(seed)
    right = wrong = missed = 0
    claims: list[tuple[float, bool]] = []
    sequences = annotated()
    for n in random.choice(len(sequences), 80, replace=False):
        points, owners = spoilt(sequences[n], random)
        found = link_points(range(FRAMES), points, KNOWN)
        links = {
            link for each in found if each.probability >= 0.5 for link in pairwise(each.points)
        }
        truth = true_links(owners)
        right += len(links & truth)
        wrong += len(links - truth)
        missed += len(truth - links)
        for each in found:
            whose = {int(owners[frame][place]) for frame, place in each.points}
            claims.append((each.probability, len(whose) == 1 and -1 not in whose))
    assert 2 * right / (2 * right + wrong + missed) >= 0.95
    sure = [is_right for probability, is_right in claims if probability > 0.95]
    assert np.mean(sure) > 0.97
    stated, was_right = np.mean(claims, axis=0)
    assert stated == pytest.approx(was_right, abs=0.05)


def test_chance_alone_makes_no_tracklet_that_one_could_trust() -> None:
    random = np.random.default_rng(3)
    for _ in range(40):
        points = [random.uniform((0, 0), (WIDTH_PX, HEIGHT_PX), (2, 2)) for _ in range(FRAMES)]
        found = link_points(range(FRAMES), points, KNOWN)
        assert all(each.probability < 0.5 for each in found)


def test_two_points_are_linked_only_in_company() -> None:
    way = np.array([30.0, -20.0])
    lone = [np.array([[100.0, 400.0]]) + way * n for n in range(2)]
    empty = [np.empty((0, 2))] * 3
    assert all(each.probability < 0.5 for each in link_points(range(5), [*lone, *empty], KNOWN))
    company = [np.array([[300.0, 300.0], [200.0, 200.0]]) + way * n for n in range(5)]
    points = [np.concatenate([company[n], lone[n]]) if n < 2 else company[n] for n in range(5)]
    found = link_points(range(5), points, KNOWN)
    assert {each.points for each in found if each.probability > 0.9} >= {((0, 2), (1, 2))}


def test_no_point_is_used_twice_where_paths_cross() -> None:
    points = [
        np.array([[100.0 + 30.0 * n, 200.0], [160.0 + 30.0 * n, 140.0 + 30.0 * n]])
        for n in range(FRAMES)
    ]
    found = link_points(range(FRAMES), points, KNOWN)
    used = [point for each in found for point in each.points]
    assert len(used) == len(set(used)) == 2 * FRAMES
    assert {tuple(place for _, place in each.points) for each in found} == {(0,) * 5, (1,) * 5}


def test_the_best_choice_is_found_where_the_greedy_one_is_not() -> None:
    a, b, c, d = (0, 0), (1, 0), (2, 0), (3, 0)
    candidates = [((b, c), 10.0), ((a, b), 7.0), ((c, d), 7.0)]
    assert sorted(best_disjoint_sets(candidates)) == [1, 2]


NIGHT_S = 86_400.0 + 900.0


def test_three_satellites_of_two_nights_two_of_them_in_one_slot_are_joined() -> None:
    random = np.random.default_rng(8)
    sets = (
        geostationary(90001, -60.0, e=3e-4, perigee_deg=20.0, i_deg=0.06, node_deg=80.0),
        geostationary(90002, -60.03, e=2e-4, perigee_deg=130.0, i_deg=0.03, node_deg=200.0),
        geostationary(90003, -95.0, e=1e-4, i_deg=2.0),
    )
    first, second = (
        [tracklet_orbit(seen(each, instants(since), random=random), "geo") for each in sets]
        for since in (0.0, NIGHT_S)
    )
    found = np.array(
        [[probability_from_log_odds(log_odds_same_object(a, b)) for b in second] for a in first]
    )
    assert np.all(np.diag(found) > 0.9)
    assert np.all(found[~np.eye(3, dtype=bool)] < 0.05)


def test_a_satellite_that_was_not_there_the_night_before_is_joined_to_none() -> None:
    random = np.random.default_rng(10)
    ours = tracklet_orbit(seen(geostationary(90001, -60.0), instants(0.0), random=random), "geo")
    other = geostationary(90002, -60.05, i_deg=0.2, node_deg=300.0)
    new = tracklet_orbit(seen(other, instants(NIGHT_S), random=random), "geo")
    assert log_odds_same_object(ours, new) < -5.0
