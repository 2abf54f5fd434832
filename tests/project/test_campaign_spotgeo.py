"""The live tracker links points of real sequences; the campaign's page has every sequence."""

import pytest

from rsoconsole.tracking.initiation import chains
from tests.campaign import spotgeo
from tests.campaign.rows_kept import PAGE, RESULTS, read
from tests.tracking.test_link import SPOTGEO, annotated

SEQUENCES = range(0, 400, 8)


@pytest.mark.shared_data
@pytest.mark.skipif(not SPOTGEO.exists(), reason=f"{SPOTGEO} is not here")
@pytest.mark.nightly("statistics over many sequences")
def test_links_after_frame_5_of_every_eighth_sequence() -> None:
    rows = [spotgeo.row_of(11, number) for number in SEQUENCES]
    value, _, high = spotgeo.f1(rows)
    assert value >= 0.97
    assert high >= 0.99


@pytest.mark.shared_data
@pytest.mark.skipif(not SPOTGEO.exists(), reason=f"{SPOTGEO} is not here")
def test_the_judge_sees_a_tracker_that_takes_any_two_points_for_one_object(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import numpy as np

    monkeypatch.setattr(chains, "uses_window", lambda _: False)
    right = off = 0
    for number in range(12):
        sequence = annotated()[number]
        points, owners = spotgeo.spoilt(sequence, np.random.default_rng([1, number]))
        found = spotgeo.linked(points)
        true = spotgeo.true_links(owners)
        right, off = right + len(found & true), off + len(found ^ true)
    assert 2 * right / (2 * right + off) < 0.9


def test_the_page_has_what_the_kept_rows_say() -> None:
    rows = [row for path in sorted((RESULTS / "spotgeo").glob("*.jsonl")) for row in read(path)]
    assert spotgeo.table(rows) in PAGE.read_text(encoding="utf-8")
    assert spotgeo.f1(rows)[0] >= 0.99
