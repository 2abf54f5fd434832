"""Names for all tracks of a field together: each object once, and doubt where there is doubt."""

import itertools

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.orbits import (
    CatalogueEntry,
    Identification,
    MeasuredDirections,
    compare_with_catalogue,
    identify_jointly,
    parse_element_sets,
)
from rsoconsole.orbits.identification._assignments import best_assignments
from rsoconsole.orbits.identification.joint_identification import simultaneous_tracks
from rsoconsole.orbits.identification.single import GATE_DEG, identify_alone
from rsoconsole.pipeline.orbits._naming import TrackIdentifier
from rsoconsole.records import FloatArray
from rsoconsole.sky import IntArray
from rsoconsole.words import NS_PER_DAY
from tests.makers import identify
from tests.truth.seen_satellites import DAYTONA, SHARED, T0_UTC_NS, geostationary, instants, seen

DAYS_OLD = 4.0
OFF_DEG = 0.03
"""What the elements of a slot are off together, as far as two of its members stand apart."""
SLOT = {1: -60.09, 2: -60.03, 3: -60.0}


def catalogue(*numbers: int, slot: dict[int, float] | None = None) -> tuple[CatalogueEntry, ...]:
    places = slot or SLOT
    members = [
        geostationary(
            90000 + n,
            places[n],
            name=f"MEMBER {n}",
            epoch_utc_ns=T0_UTC_NS - round(DAYS_OLD * NS_PER_DAY),
        )
        for n in numbers
    ]
    return parse_element_sets(
        "\n".join(f"{m.name}\n{m.line_1}\n{m.line_2}" for m in members)
    ).entries


def tracks(
    *numbers: int,
    off_deg: float = 0.0,
    slot: dict[int, float] | None = None,
    since_s: float = 0.0,
    seed: int = 5,
) -> list[MeasuredDirections]:
    """What is seen of members that stand beside where their elements put them."""
    random, places = np.random.default_rng(seed), slot or SLOT
    return [
        seen(
            geostationary(
                90000 + n,
                places[n] + off_deg,
                epoch_utc_ns=T0_UTC_NS - round(DAYS_OLD * NS_PER_DAY),
            ),
            instants(since_s),
            random=random,
        )
        for n in numbers
    ]


def named(found: tuple[Identification, ...]) -> list[int | None]:
    return [
        each.matches[0].norad_id - 90000 if each.verdict == "identified" else None for each in found
    ]


def by_hand(scores: FloatArray, rivals: np.ndarray, most: int) -> list[float]:
    """The largest sums of all assignments there are."""
    none = scores.shape[1] - 1
    sums = []
    for taken in itertools.product(range(none + 1), repeat=len(scores)):
        pairs = itertools.combinations(range(len(scores)), 2)
        if all(taken[a] != taken[b] or taken[a] == none or not rivals[a, b] for a, b in pairs):
            sums.append(sum(scores[t, n] for t, n in enumerate(taken)))
    return sorted((each for each in sums if np.isfinite(each)), reverse=True)[:most]


@pytest.mark.parametrize("seed", range(12))
def test_the_best_assignments_are_those_of_a_search_through_all(seed: int) -> None:
    random = np.random.default_rng(seed)
    scores = random.normal(0.0, 3.0, (4, 5))
    scores[random.random(scores.shape) < 0.2] = -np.inf
    scores[:, -1] = -4.0
    rivals = random.random((4, 4)) < 0.7
    rivals |= rivals.T
    found = best_assignments(scores, rivals, 10)
    sums = [float(sum(scores[t, n] for t, n in enumerate(each))) for each in found]
    assert sums == pytest.approx(by_hand(scores, rivals, 10))
    assert len(set(found)) == len(found)


@pytest.mark.parametrize("seed", range(6))
def test_so_are_those_of_rows_that_were_all_seen_at_once(seed: int) -> None:
    random = np.random.default_rng(seed)
    scores = random.normal(0.0, 2.0, (4, 5))
    scores[random.random(scores.shape) < 0.3] = -np.inf
    scores[:, -1] = random.normal(-4.0, 1.0, 4)
    rivals = np.ones((4, 4), bool)
    found = best_assignments(scores, rivals, 15)
    sums = [float(sum(scores[t, n] for t, n in enumerate(each))) for each in found]
    assert sums == pytest.approx(by_hand(scores, rivals, 15))
    assert len(set(found)) == len(found)


def test_many_alike_still_have_an_answer_and_it_is_the_best() -> None:
    """Twelve rows that differ by next to nothing: a search through all would be of 10^8 steps."""
    scores = np.random.default_rng(1).normal(0.0, 1e-3, (12, 13))
    scores[:, -1] = -50.0
    best = best_assignments(scores, np.ones((12, 12), bool), 12)[0]
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(scores[:, :-1], maximize=True)
    assert sum(scores[t, n] for t, n in enumerate(best)) == pytest.approx(
        float(scores[rows, columns].sum())
    )


def test_one_track_alone_has_the_name_that_it_had() -> None:
    (track,) = tracks(2)
    entries = catalogue(1, 2, 3)
    by_itself = identify_alone(compare_with_catalogue(track, DAYTONA, entries), GATE_DEG)
    assert identify_jointly([track], DAYTONA, entries) == (by_itself,)


def test_where_a_whole_slot_is_off_its_members_are_told_by_where_they_stand() -> None:
    """Each by itself, the second stands where the elements have the third, and is taken for it."""
    entries, observed = catalogue(1, 2, 3), tracks(1, 2, 3, off_deg=OFF_DEG)
    alone = [identify(each, DAYTONA, entries) for each in observed]
    assert named(tuple(alone)) != [1, 2, 3]
    found = identify_jointly(observed, DAYTONA, entries)
    assert named(found) == [1, 2, 3]
    assert [each.named_with for each in found] == [2, 2, 2]


def test_two_of_three_alike_are_ambiguous_with_their_probabilities() -> None:
    """Two tracks as far apart as the first from the second, and the second from the third."""
    slot = {1: -60.06, 2: -60.03, 3: -60.0}
    found = identify_jointly(
        tracks(1, 2, slot=slot, off_deg=OFF_DEG / 2.0), DAYTONA, catalogue(1, 2, 3, slot=slot)
    )
    assert [each.verdict for each in found] == ["ambiguous", "ambiguous"]
    for each, candidates in zip(found, ({1, 2}, {2, 3}), strict=True):
        likely = {m.norad_id - 90000 for m in each.matches if m.probability > 0.05}
        assert likely == candidates
        total = sum(m.probability for m in each.matches) + each.not_catalogued
        assert total == pytest.approx(1.0, abs=1e-6)


def test_what_is_another_tracks_is_no_name() -> None:
    """Of two that stand 5 arcsec apart the catalogue knows one: it is one of them, not both."""
    slot = {1: -60.0, 2: -60.0012}
    found = identify_jointly(tracks(1, 2, slot=slot), DAYTONA, catalogue(1, slot=slot))
    assert named(found) in ([1, None], [None, 1], [None, None])
    shares = [sum(m.probability for m in each.matches if m.norad_id == 90001) for each in found]
    assert sum(shares) == pytest.approx(1.0, abs=0.02)
    assert all(each.matches[0].norad_id == 90001 for each in found if each.matches)


def test_an_uncatalogued_neighbour_far_off_all_elements_is_unknown() -> None:
    slot = {1: -60.0, 2: -60.03, 3: -60.5}
    found = identify_jointly(tracks(1, 2, 3, slot=slot), DAYTONA, catalogue(1, 2, slot=slot))
    assert named(found) == [1, 2, None]
    assert found[2].verdict == "unknown"


def test_a_track_that_ended_and_the_next_one_may_be_of_one_object() -> None:
    before, after = tracks(2)[0], tracks(2, since_s=1800.0)[0]
    assert named(identify_jointly([before, after], DAYTONA, catalogue(1, 2, 3))) == [2, 2]


def track_at(number: int, t_utc_ns: IntArray, seed: int = 5) -> MeasuredDirections:
    elements = geostationary(
        90000 + number, SLOT[number], epoch_utc_ns=T0_UTC_NS - round(DAYS_OLD * NS_PER_DAY)
    )
    return seen(elements, t_utc_ns, random=np.random.default_rng(seed))


def test_what_was_seen_while_another_was_lost_may_be_of_the_same_object() -> None:
    """The first was lost and found again; between, three frames made a track of their own."""
    first = track_at(2, np.concatenate([instants(0.0), instants(2700.0)]))
    between = track_at(2, instants(1500.0, count=3), seed=6)
    assert named(identify_jointly([first, between], DAYTONA, catalogue(1, 2, 3))) == [2, 2]
    assert not simultaneous_tracks([first, between])[0, 1]
    # While the first was seen every half minute, what is seen beside it is another.
    beside = track_at(2, instants(15.0, count=3), seed=6)
    assert simultaneous_tracks([first, beside])[0, 1]
    assert named(identify_jointly([first, beside], DAYTONA, catalogue(1, 2, 3))) != [2, 2]


def config_of(tmp_path, *numbers: int) -> Config:
    path = tmp_path / "elements.tle"
    members = [
        geostationary(
            90000 + n,
            SLOT[n],
            name=f"MEMBER {n}",
            epoch_utc_ns=T0_UTC_NS - round(DAYS_OLD * NS_PER_DAY),
        )
        for n in numbers
    ]
    path.write_text("\n".join(f"{m.name}\n{m.line_1}\n{m.line_2}" for m in members))
    site = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
    return Config.model_validate({"site": site, "catalogue": {"tle_files": [str(path)]}})


def test_a_name_that_another_track_takes_goes_on_record_again(tmp_path) -> None:
    """The second track alone is taken for the third member, until that has a track of its own."""
    naming = TrackIdentifier(config_of(tmp_path, 2, 3))
    second, third = tracks(2, 3, off_deg=OFF_DEG)
    (alone,) = naming.identify_due_tracks(20, {7: second}, {7})
    assert alone.matches[0].norad_id == 90003
    said = {each.track_id: each for each in naming.identify_due_tracks(21, {9: third}, {7, 9})}
    assert {n: each.matches[0].norad_id for n, each in said.items()} == {7: 90002, 9: 90003}
    assert {each.named_with for each in said.values()} == {1}
    assert naming.identify_due_tracks(22, {9: third}, {7, 9}) == ()


def test_a_track_that_was_taken_back_competes_for_nothing(tmp_path) -> None:
    naming = TrackIdentifier(config_of(tmp_path, 2, 3))
    second, third = tracks(2, 3)
    naming.identify_due_tracks(20, {7: second, 8: third}, {7, 8})
    (again,) = naming.identify_due_tracks(21, {9: second}, {9})
    assert again.named_with == 0
    assert again.matches[0].norad_id == 90002


@pytest.mark.nightly("many real fields")
@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_members_of_a_real_slot_by_elements_a_week_old() -> None:
    """Astra 19.2E, all off as a satellite is that was measured against elements 5 to 9 days old:
    of 24 nights no name twice, and fewer wrong ones than each by itself has."""
    from rsoconsole.orbits import SURE
    from tests.bench.bench_element_errors import measured_errors
    from tests.bench.bench_identify_jointly import SITE, SLOTS, members_of, night

    text = (SHARED / "tles" / "geo_all_20230622.tle").read_text(encoding="ascii")
    entries = parse_element_sets(text).entries
    history = measured_errors()
    chosen = history[(history[:, 0] >= 5) & (history[:, 0] < 9), 1:]
    members = members_of(entries, SLOTS["Astra 19.2E"])
    random, wrong = np.random.default_rng(3), np.zeros(2, int)
    near = [each for each in entries if 0.9 < each.revolutions_a_day < 1.1]
    for _ in range(24):
        observed, true = night(members, 7.0, chosen, is_shared=True, random=random)
        alone = [identify(each, SITE, near) for each in observed]
        joint = identify_jointly(observed, SITE, near)
        for n, found in enumerate((alone, joint)):
            sure = [f.matches[0].norad_id for f in found if f.verdict == "identified"]
            of = [t for f, t in zip(found, true, strict=True) if f.verdict == "identified"]
            wrong[n] += sum(a != b for a, b in zip(sure, of, strict=True))
            assert n == 0 or len(sure) == len(set(sure))
            assert all(f.matches[0].probability >= SURE for f in found if f.verdict == "identified")
    assert wrong[1] <= wrong[0] / 2
