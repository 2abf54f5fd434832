"""Trackers on the same nights: one judge that sees a swap, GOSPA as Stone Soup has it, one page."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import own_tracker, trackers_table
from tests.campaign.rows_kept import PAGE, read
from tests.campaign.slots import ELEMENTS, Night, Sight, drawn
from tests.campaign.slots_judge import CUT_ARCSEC, FROM_FRAME, At, gospa, judged
from tests.campaign.trackers import KEPT_ROWS

needs_elements = pytest.mark.skipif(not ELEMENTS.exists(), reason=f"{ELEMENTS} is not here")


def test_gospa_of_sets_that_are_one_can_work_out_by_hand() -> None:
    two = np.array([[0.0, 0.0], [100.0, 0.0]])
    assert gospa(two, two) == 0.0
    assert gospa(two + np.array([3.0, 4.0]), two) == pytest.approx(math.sqrt(50.0))
    # One missed, one false: half of the squared cut each.
    assert gospa(two[:1], two) == pytest.approx(CUT_ARCSEC / math.sqrt(2.0))
    assert gospa(np.empty((0, 2)), two) == pytest.approx(CUT_ARCSEC)
    assert gospa(two + np.array([60.0, 0.0]), two[:1]) == pytest.approx(math.sqrt(1.5) * CUT_ARCSEC)


def test_gospa_is_as_stone_soup_has_it() -> None:
    pytest.importorskip("stonesoup", reason="requirements-peers.txt is not installed")
    import datetime

    from stonesoup.metricgenerator.ospametric import GOSPAMetric
    from stonesoup.types.state import State

    theirs = GOSPAMetric(p=2.0, c=CUT_ARCSEC)
    random = np.random.default_rng(4)
    time = datetime.datetime(2023, 6, 22)  # noqa: DTZ001 -- Stone Soup's times have no zone
    for _ in range(50):
        sets = [random.uniform(0.0, 60.0, (random.integers(1, 6), 2)) for _ in range(2)]
        states = [[State(at.reshape(2, 1), timestamp=time) for at in each] for each in sets]
        metric, _ = theirs.compute_gospa_metric(*states)
        assert gospa(*sets) == pytest.approx(metric.value["distance"])


def two_satellites(frames: int) -> tuple[Night, list[list[At]]]:
    """A night of two, and a tracker that makes no error."""
    night = drawn("30.5E", 1, frames)
    told = []
    for k, sight in enumerate(night.frames):
        own = {night.owner.get(m.measurement_id): m.measurement_id for m in sight.measurements}
        told.append(
            [
                At(track_id=n + 1, place=tuple(night.truth[k, n]), taken=own.get(n))  # type: ignore[arg-type]
                for n in (0, 1)
            ]
        )
    return night, told


@needs_elements
def test_the_judge_sees_a_swap() -> None:
    night, told = two_satellites(20)
    fair = judged(night, told)
    assert (fair["swaps"], fair["gospa"], fair["taken"]) == (0, 0.0, fair["shown"])
    swapped = [
        [replace(each, track_id=3 - each.track_id) for each in tracks] if k >= 10 else tracks
        for k, tracks in enumerate(told)
    ]
    found = judged(night, swapped)
    assert found["swaps"] == 2
    assert found["gospa"] == 0.0, "places alone do not tell"


@needs_elements
def test_a_night_has_what_it_should() -> None:
    nights = [drawn("30W", seed) for seed in range(1, 5)]
    shown = [len(night.owner) / night.truth[:, :, 0].size for night in nights]
    assert np.mean(shown) == pytest.approx(0.9, abs=0.05)
    sights: list[Sight] = [sight for night in nights for sight in night.frames]
    true = sum(len(night.owner) for night in nights)
    false = (sum(len(s.measurements) for s in sights) - true) / len(sights)
    assert false == pytest.approx(2.0, abs=0.5)
    closest = min(
        float(np.linalg.norm(night.truth[:, 1] - night.truth[:, 2], axis=-1).min())
        for night in nights
    )
    assert closest < 10.0


@needs_elements
def test_close_satellites_keep_their_tracks_as_well_as_with_the_best_of_the_peers() -> None:
    """Against the kept rows, so that Stone Soup is not needed."""
    rows = read(KEPT_ROWS)
    for slot in ("30W", "30.5E"):
        figures = judged(night := drawn(slot, 1), own_tracker.followed(night))
        peers = [trackers_table.nights_of(rows, slot, each)[1] for each in ("GNN", "JPDA")]
        assert figures["swaps"] <= min(row["swaps"] for row in peers)
        assert figures["gospa"] <= 2.0 * min(row["gospa"] for row in peers)
        assert figures["taken"] >= 0.9 * figures["shown"]


def test_the_page_has_what_the_kept_rows_say() -> None:
    rows = read(KEPT_ROWS)
    assert trackers_table.table(rows) in PAGE.read_text(encoding="utf-8")
    nights = [row for row in rows if row["tracker"] == trackers_table.OURS]
    assert len(nights) >= 5 * 20
    # The promise: no more swaps than one in a thousand track-frames.
    assert sum(row["swaps"] for row in nights) <= sum(row["taken"] for row in nights) / 1000.0


def test_nights_that_parameters_were_chosen_on_are_in_no_figure() -> None:
    rows = read(KEPT_ROWS)
    assert {row["seed"] for row in rows if row["tracker"] == "GNN"} > {101}
    assert max(trackers_table.nights_of(rows, "30W", "GNN")) <= 20
    assert FROM_FRAME == 3
