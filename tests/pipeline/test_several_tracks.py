"""What takes one track takes several: fold, orbits, names, export, and what is shown of them."""

import dataclasses
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from rsoconsole.cli.demo.demo import _track_words
from rsoconsole.cli.judge.summary import summarise
from rsoconsole.config import Config
from rsoconsole.library.formats.night import read_exported_night as exported
from rsoconsole.library.notebook.night.night import read_drawn_night
from rsoconsole.night import Night
from rsoconsole.pipeline import OnlineOrbit, Orbits
from rsoconsole.pipeline.orbits.orbit_online import RefinedOrbit
from rsoconsole.records import (
    CatalogueMatch,
    FoldRecord,
    FrameTaken,
    Identified,
    Measurement,
    Miss,
    Missed,
    NotFollowed,
    OrbitEstimate,
    Record,
    StateChange,
    TrackLost,
    TrackState,
)
from rsoconsole.session import SessionWriter
from rsoconsole.tracking import Following, LiveTrack, follow
from rsoconsole.tracking.filters import lqe
from tests.makers import geo_measurement
from tests.nights.made_up_night import taken
from tests.pipeline.test_orbit_online import GEO, config, every_frame, flight, measured_at
from tests.tracking.test_follow import SETTINGS as EVERY_DAY
from tests.tracking.test_follow import seen

SETTINGS = dataclasses.replace(
    EVERY_DAY, filter=EVERY_DAY.filter.model_copy(update={"most_tracks": 1})
)
"""The tracks are given: no other begins."""
LEAD_DEC, OTHER_DEC = -5.0, -5.2


def lead(n: int) -> Measurement:
    return geo_measurement(n, dec_deg=LEAD_DEC)


def other(n: int) -> Measurement:
    return geo_measurement(n, dec_deg=OTHER_DEC)


def begun(ids: tuple[int, ...] = (1, 2)) -> Following:
    """Both after the second frame."""
    tracks = []
    for number, made in zip(ids, (lead, other), strict=False):
        state = lqe.initialise(made(1), made(2), SETTINGS.filter, track_id=number)
        state = dataclasses.replace(state, is_lead=number == ids[0])
        tracks.append(LiveTrack(track=state, taken=made(2)))
    return Following(state="TRACK", tracks=tuple(tracks), last_track_id=max(ids))


def followed(
    frames: range,
    *,
    lead_missed: Collection[int] = (),
    other_missed: Collection[int] = (),
    before: Following | None = None,
) -> Iterator[tuple[int, Following, tuple[FoldRecord, ...]]]:
    following = begun() if before is None else before
    for n in frames:
        shown = [lead(n)] if n not in lead_missed else []
        shown += [other(n)] if n not in other_missed else []
        following, records = follow(following, seen(n, *shown), SETTINGS)
        yield n, following, records


def test_each_track_takes_its_own_and_is_as_it_would_be_alone():
    alone = {1: {}, 2: {}}
    for number in (1, 2):
        start = begun()
        only = dataclasses.replace(start, tracks=(start.tracks[number - 1],))
        for n, _, records in followed(range(3, 9), before=only):
            alone[number][n] = [r for r in records if isinstance(r, TrackState)]
    for n, following, records in followed(range(3, 9)):
        assert following.state == "TRACK"
        assert [each.taken for each in following.tracks] == [lead(n), other(n)]
        for number in (1, 2):
            states = [r for r in records if isinstance(r, TrackState) and r.track_id == number]
            assert [(s.x, s.P, s.nis) for s in states] == [
                (s.x, s.P, s.nis) for s in alone[number][n]
            ]
        assert [r.is_lead for r in records if isinstance(r, TrackState)] == [True] * 2 + [False] * 2
        # What one track has taken no other one refuses.
        assert not [r for r in records if isinstance(r, NotFollowed)]


def test_one_that_is_missed_coasts_while_the_lead_goes_on():
    for n, following, records in followed(range(3, 9), other_missed=(5, 6)):
        misses = [r for r in records if isinstance(r, Miss)]
        assert [m.track_id for m in misses] == ([2] if n in (5, 6) else [])
        assert following.state == "TRACK"
        assert not [r for r in records if isinstance(r, StateChange)]
        assert following.tracks[1].track.misses == {5: 1, 6: 2}.get(n, 0)


def test_the_state_is_the_leads_and_where_the_lead_ends_the_next_one_leads():
    states, leads = [], []
    for n, following, records in followed(range(3, 200), lead_missed=range(5, 200)):
        states.append(following.state)
        leads.append(following.track_id)
        for change in (r for r in records if isinstance(r, StateChange)):
            assert (n, change.after) == (5, "COAST") or leads[-2:] == [1, 2]
        if following.track_id == 2:
            assert [each.track.track_id for each in following.tracks] == [2]
            break
    assert states[:3] == ["TRACK", "TRACK", "COAST"]
    assert states[-1] == "TRACK"
    after, records = follow(following, seen(n + 1, other(n + 1)), SETTINGS)
    assert [r.is_lead for r in records if isinstance(r, TrackState)] == [True, True]
    for number in range(n + 2, n + 300):
        after, records = follow(after, seen(number), SETTINGS)
        if not after.tracks:
            break
    assert after.state == "LOST"


def night_of_two() -> list[Record]:
    """Two satellites of the belt, followed together for 30 frames."""
    import numpy as np

    random = np.random.default_rng(4)
    ways = [every_frame(flight(*GEO, ahead_deg=ahead), 30) for ahead in (0.0, 0.3)]
    records: list[Record] = []
    following = Following()
    for n in range(30):
        measured = [
            dataclasses.replace(
                measured_at(way, n, n + 1, random, 0.5), measurement_id=f"{n + 1}-{k}"
            )
            for k, way in enumerate(ways)
        ]
        if n == 1:
            before = [r for r in records if isinstance(r, Measurement)]
            tracks = []
            for k in (0, 1):
                state = lqe.initialise(before[k], measured[k], SETTINGS.filter, track_id=k + 1)
                state = dataclasses.replace(state, is_lead=k == 0)
                tracks.append(LiveTrack(track=state, taken=measured[k]))
            following = Following(state="TRACK", tracks=tuple(tracks), last_track_id=2)
            told: tuple[FoldRecord, ...] = tuple(each.track for each in tracks)
        else:
            sight = dataclasses.replace(
                seen(n + 1, *measured), t_mid_utc_ns=measured[0].t_mid_utc_ns
            )
            following, told = (following, ()) if n == 0 else follow(following, sight, SETTINGS)
        records += [taken(n + 1, 150.0, -5.0), *measured, *told]
    return records


@pytest.fixture(scope="module")
def two() -> list[Record]:
    return night_of_two()


def only(records: list[Record], track_id: int) -> list[Record]:
    return [r for r in records if not isinstance(r, TrackState) or r.track_id == track_id]


def refined_of(records: list[Record]) -> list[RefinedOrbit]:
    """Asked behind each frame, as the engine does."""
    online, found = OnlineOrbit(config()), []
    for number, record in enumerate(records):
        online.receive(record)
        if number + 1 == len(records) or type(records[number + 1]) is type(records[0]):
            found += online.refine()
    assert online.lead_orbit is not None
    return found


def last_orbits(records: list[Record]) -> dict[int, OrbitEstimate]:
    return {each.estimate.track_id: each.estimate for each in refined_of(records)}


def test_every_track_has_an_orbit_that_is_the_one_it_would_have_alone(two):
    together = last_orbits(two)
    assert sorted(together) == [1, 2]
    for track_id in (1, 2):
        assert together[track_id] == last_orbits(only(two, track_id))[track_id]
    assert together[1].r_gcrs_km != together[2].r_gcrs_km


def test_the_log_says_whose_orbit_it_is_and_who_guides_of_the_lead_alone(two):
    words: dict[int, list[str]] = {1: [], 2: []}
    for refined in refined_of(two):
        words[refined.estimate.track_id] += [event.text for event in refined.events]
    assert any("aims by" in each for each in words[1])
    assert not any(each.startswith("track") for each in words[1])
    assert words[2]
    assert all(each.startswith("track 2: orbit: ") for each in words[2])


def told_with_names(records: list[Record]) -> list[Record]:
    from tests.pipeline.test_orbit_online import TLE

    orbits = Orbits(config(catalogue={"tle_files": [str(TLE)]}))
    told: list[Record] = []
    for number, record in enumerate(records):
        told.append(record)
        orbits.receive(record)
        if number + 1 == len(records) or type(records[number + 1]) is type(records[0]):
            told += orbits.derive_frame_records()
    assert set(orbits.last) == {1, 2}
    return told


@pytest.fixture(scope="module")
def told(two) -> list[Record]:
    return told_with_names(two)


def test_each_is_asked_for_its_name_as_often_as_one_alone(told):
    asked = [(r.track_id, r.observations) for r in told if isinstance(r, Identified)]
    for track_id in (1, 2):
        assert [n for t, n in asked if t == track_id] == [3, 4, 6, 9, 14, 21]


def test_an_export_holds_both_tracks_and_figures_are_the_leads(told, tmp_path: Path):
    writer = SessionWriter.create(tmp_path / "two", Config(), {"title": "two"})
    for record in told:
        writer.append(record, getattr(record, "t_mid_utc_ns", None) or 10**18)
    writer.close()
    night = exported(tmp_path / "two")
    assert night.tracks == (1, 2)
    for track_id in (1, 2):
        rows = night.track_measurements(track_id)
        assert sorted(row.frame_id for row in rows) == list(range(1, 31))
        assert all(row.is_taken and row.not_taken_because is None for row in rows)
        assert all(row.predicted_ra_icrs_deg is not None for row in rows[2:])
        away = [abs(row.residual_ra_arcsec or 0.0) for row in rows]
        assert max(away) < 5.0, "each beside its own prediction"
    shown = read_drawn_night(tmp_path / "two")
    assert [f.updated.track_id for f in shown.frames if f.updated] == [1] * 29
    assert [sorted(f.other_track_states) for f in shown.frames] == [[]] + [[2]] * 29
    assert not [f for f in shown.frames if f.lead_miss_reason]
    figures = summarise(told, [])
    assert figures["misses"] == 0


MATCH = CatalogueMatch(
    norad_id=42432,
    name="SES-10",
    separation_arcsec=0.1,
    along_track_s=0.0,
    cross_track_arcsec=0.0,
    rate_difference_percent=None,
    tle_age_days=1.0,
    score=0.1,
    probability=0.99,
)


def test_the_summary_has_a_line_for_each_satellite(told):
    first, second = summarise(told, [])["tracks"]
    assert [each["tracks"] for each in (first, second)] == [[1], [2]]
    assert [each["frames"] for each in (first, second)] == [30, 30]
    assert {each["state"] for each in (first, second)} == {"TRACK"}
    assert first["orbit"]["a_km"] != second["orbit"]["a_km"]
    last = max(r.frame_id for r in told if isinstance(r, FrameTaken))
    lost = Missed(kind="no detection", lost=TrackLost.by_time(7260.0))
    gone = summarise([*told, Miss(frame_id=last, reason=lost, track_id=2)], [])["tracks"][1]
    assert (gone["state"], gone["last_frame"]) == ("LOST", last)
    assert "121 min" in gone["lost"]
    # Of one catalogue number: one satellite, though its track began twice.
    match = next(r for r in reversed(told) if isinstance(r, Identified) and r.track_id == 1)
    names = [
        replace(match, verdict="identified", track_id=track_id, matches=(MATCH,))
        for track_id in (1, 2)
    ]
    (only,) = summarise([*told, *names], [])["tracks"]
    assert (only["name"], only["tracks"], only["frames"]) == ("SES-10", [1, 2], 60)
    said = _track_words(only)
    assert said[0] == "SES-10: measured in 60 frames, followed to the end"
    assert " km" in said[1]
    assert "lost in frame" in _track_words(gone)[0]
    assert "unidentified (track 2)" in _track_words(gone)[0]


def test_the_console_knows_all_and_shows_the_lead(told):
    night = Night(Path("two"), {}, Config())
    for record in told:
        night.fold_record(10**18, record)
    view = night.view()
    assert view.track is not None
    assert view.track.track_id == 1
    assert list(view.beside) == [2]
    assert sorted(view.orbits) == [1, 2]
    assert view.orbit == view.orbits[1]
    assert sorted(view.identifications) == [1, 2]
    assert view.identified == view.identifications[1]


def test_a_miss_of_another_track_is_none_of_the_leads():
    night = Night(Path("two"), {}, Config())
    for n in (1, 2):
        night.fold_record(n, taken(n, 150.0, -5.0))
    for each in begun().tracks:
        night.fold_record(3, dataclasses.replace(each.track, frame_id=2))
    for n, _, records in followed(range(3, 6), other_missed=(4,)):
        night.fold_record(n, taken(n, 150.0, -5.0))
        for record in records:
            night.fold_record(n, record)
    assert [row.miss for row in night.view().rows] == [None] * 5


def test_what_the_operator_chose_for_the_lead_is_none_of_the_next_one_s():
    """The fold hands over a copy of the measurement, with the ruling's own instant."""
    shown = seen(3, lead(3))
    shown = dataclasses.replace(shown, chosen=dataclasses.replace(lead(3)))
    _, records = follow(begun(), shown, SETTINGS)
    updated = [r for r in records if isinstance(r, TrackState) and r.kind == "updated"]
    assert [r.track_id for r in updated] == [1]
