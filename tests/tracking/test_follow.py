"""What is followed: how a track starts, what it takes, what it refuses, when it is lost."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.config import FilterConfig
from rsoconsole.records import HiddenBy, Measurement, Miss, Missed, NotFollowed, StateChange
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from rsoconsole.tracking.initiation import chains
from rsoconsole.words import text
from tests.makers import GEO_RATE_DEG_S, NS, T0_UTC_NS, geo_measurement

SETTINGS = FollowSettings(filter=FilterConfig(), half_field_deg=0.62)


def seen(frame_id: int, *measurements: Measurement, cadence_s: float = 30.0) -> FrameInput:
    return FrameInput(
        frame_id=frame_id,
        t_mid_utc_ns=T0_UTC_NS + round((frame_id - 1) * cadence_s * NS),
        exposure_s=10.0,
        measurements=measurements,
    )


def chosen(measurement: Measurement) -> FrameInput:
    """A frame with this measurement, which the operator wants followed."""
    sight = seen(measurement.frame_id, measurement)
    return dataclasses.replace(sight, chosen=measurement)


def locked(
    *, ra_deg: float = 150.0, frames: int = 4, settings: FollowSettings = SETTINGS
) -> Following:
    following = Following()
    for frame_id in range(1, frames + 1):
        sight = seen(frame_id, geo_measurement(frame_id, ra_deg=ra_deg))
        following, _ = follow(following, sight, settings)
    return following


def test_two_successive_frames_that_agree_start_a_track():
    first, _ = follow(Following(), seen(1, geo_measurement(1)), SETTINGS)
    second, records = follow(first, seen(2, geo_measurement(2)), SETTINGS)
    assert (first.state, second.state) == ("ACQUIRE", "TRACK")
    assert isinstance(records[-1], StateChange)


def test_a_miss_between_them_returns_to_search():
    first, _ = follow(Following(), seen(1, geo_measurement(1)), SETTINGS)
    missed, _ = follow(first, seen(2), SETTINGS)
    third, _ = follow(missed, seen(3, geo_measurement(3)), SETTINGS)
    assert (missed.state, third.state) == ("SEARCH", "ACQUIRE")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"rate_deg_s": GEO_RATE_DEG_S / 3.0}, "long"),
        ({"dec_deg": -5.3}, "off the expected motion"),
    ],
    ids=["displacement shorter than the streaks say", "displacement across the streaks"],
)
def test_two_streaks_that_cannot_be_one_object_start_no_track(change, word):
    honest = geo_measurement(2)
    moved = geo_measurement(2, **change)
    second = dataclasses.replace(
        honest, ra_icrs_deg=moved.ra_icrs_deg, dec_icrs_deg=moved.dec_icrs_deg
    )
    first, _ = follow(Following(), seen(1, geo_measurement(1)), SETTINGS)
    after, records = follow(first, seen(2, second), SETTINGS)
    assert after.state == "ACQUIRE"
    told = [r for r in records if isinstance(r, NotFollowed)]
    assert [r.frame_id for r in told] == [1]
    assert word in text(told[0].reason)


def test_of_two_objects_the_pair_that_agrees_is_taken():
    """An edge-on galaxy looks like a streak in both frames, and stays where it is."""
    galaxy = geo_measurement(1, ra_deg=150.3)
    again = dataclasses.replace(galaxy, frame_id=2, t_mid_utc_ns=geo_measurement(2).t_mid_utc_ns)
    first, _ = follow(Following(), seen(1, galaxy, geo_measurement(1)), SETTINGS)
    after, _ = follow(first, seen(2, again, geo_measurement(2)), SETTINGS)
    assert after.track is not None
    assert after.track.x[1] == pytest.approx(GEO_RATE_DEG_S, rel=1e-3)


@pytest.mark.parametrize(
    ("faint", "bright", "leads"), [(0.993, 0.98, "bright"), (0.91, 0.75, "faint")]
)
def test_of_two_as_good_as_certain_the_better_measured_leads(faint, bright, leads):
    def pair(frame_id: int) -> tuple[Measurement, Measurement]:
        east = dataclasses.replace(
            geo_measurement(frame_id, ra_deg=150.2),
            confidence=faint,
            cov_sky_arcsec2=(1.2, 0.0, 0.1),
        )
        west = dataclasses.replace(
            geo_measurement(frame_id), confidence=bright, cov_sky_arcsec2=(0.02, 0.0, 0.02)
        )
        return (east, west) if faint > bright else (west, east)

    first, _ = follow(Following(), seen(1, *pair(1)), SETTINGS)
    after, _ = follow(first, seen(2, *pair(2)), SETTINGS)
    assert after.lead_measured is not None
    assert after.lead_measured.confidence == {"faint": faint, "bright": bright}[leads]
    by_paper = dataclasses.replace(SETTINGS, choice="most confident")
    first, _ = follow(Following(), seen(1, *pair(1)), by_paper)
    after, _ = follow(first, seen(2, *pair(2)), by_paper)
    assert after.lead_measured is not None
    assert after.lead_measured.confidence == max(faint, bright)


def test_a_clipped_streak_starts_no_track():
    first, records = follow(Following(), seen(1, geo_measurement(1, is_clipped=True)), SETTINGS)
    assert first.state == "SEARCH"
    assert "clipped" in text(records[0].reason)


def test_the_operator_may_follow_what_the_program_takes_for_an_aircraft():
    one, two = (geo_measurement(n, object_class="aircraft") for n in (1, 2))
    first, _ = follow(Following(), chosen(one), SETTINGS)
    after, _ = follow(first, chosen(two), SETTINGS)
    assert (first.state, after.state) == ("ACQUIRE", "TRACK")


def test_nobody_can_follow_a_crossing_and_the_miss_says_why():
    across = geo_measurement(5, **ACROSS)
    after, records = follow(locked(), chosen(across), SETTINGS)
    assert after.state == "COAST"
    (miss,) = (r for r in records if isinstance(r, Miss))
    assert text(miss.reason).startswith("what was detected crosses the whole frame")
    (told,) = (r for r in records if isinstance(r, NotFollowed))
    assert (told.measurement, told.track_id) == (across, 1)


def test_a_missed_frame_coasts_and_the_next_measurement_resumes():
    coasting, records = follow(locked(), seen(5), SETTINGS)
    assert coasting.state == "COAST"
    assert coasting.track is not None
    assert coasting.track.misses == 1
    assert any(isinstance(r, Miss) for r in records)
    again, _ = follow(coasting, seen(6, geo_measurement(6)), SETTINGS)
    assert again.state == "TRACK"


def test_a_neighbour_at_another_place_is_refused_with_its_reason():
    neighbour = geo_measurement(5, ra_deg=150.19, confidence=0.99)
    after, records = follow(locked(), seen(5, neighbour, geo_measurement(5)), SETTINGS)
    assert after.lead_measured is not None
    assert after.lead_measured.ra_icrs_deg == geo_measurement(5).ra_icrs_deg
    assert any(isinstance(r, NotFollowed) and text(r.reason).startswith("NIS") for r in records)


def test_a_streak_across_the_motion_is_refused_even_at_the_right_place():
    right = geo_measurement(5)
    crossing = dataclasses.replace(
        right, ends_icrs_deg=((right.ra_icrs_deg, -5.02), (right.ra_icrs_deg, -4.98))
    )
    after, _ = follow(locked(), seen(5, crossing), SETTINGS)
    assert after.state == "COAST"


def turned(m: Measurement, by_deg: float, stretched: float = 1.0) -> Measurement:
    """The same middle; its ends turned about it."""
    (ra_a, dec_a), (ra_b, dec_b) = m.ends_icrs_deg
    angle = math.radians(by_deg)
    cos_dec = math.cos(math.radians(m.dec_icrs_deg))
    ends = []
    for ra, dec in ((ra_a, dec_a), (ra_b, dec_b)):
        east, north = (ra - m.ra_icrs_deg) * cos_dec * stretched, (dec - m.dec_icrs_deg) * stretched
        x = east * math.cos(angle) - north * math.sin(angle)
        y = east * math.sin(angle) + north * math.cos(angle)
        ends.append((m.ra_icrs_deg + x / cos_dec, m.dec_icrs_deg + y))
    return dataclasses.replace(m, ends_icrs_deg=tuple(ends))


@pytest.mark.parametrize(
    ("by_deg", "stretched", "is_taken"),
    [(15.0, 1.0, True), (-19.0, 1.0, True), (22.0, 1.0, False), (15.0, 0.65, False)],
)
def test_drift_bends_a_whole_streak_at_the_right_place_and_it_is_taken(
    by_deg: float, stretched: float, is_taken: bool
):
    """Fifteen pixels of drift and wind over a streak of 118; what is cut short points as ever."""
    following = locked(frames=6)
    bent = turned(geo_measurement(7), by_deg, stretched)
    after, records = follow(following, seen(7, bent), SETTINGS)
    assert after.state == ("TRACK" if is_taken else "COAST")
    refused = [r.reason.kind for r in records if isinstance(r, NotFollowed)]
    assert refused == ([] if is_taken else ["moves otherwise"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chains, "uses_window", lambda _: False)  # as the other presets
        as_ever, _ = follow(following, seen(7, bent), SETTINGS)
    assert as_ever.state == "COAST"


def test_a_track_is_lost_when_its_bounds_outgrow_the_field():
    narrow = dataclasses.replace(SETTINGS, half_field_deg=0.01)
    following = locked()
    for frame_id in range(5, 200):
        following, _ = follow(following, seen(frame_id), narrow)
        if following.state == "LOST":
            break
    assert following.state == "LOST"
    back, _ = follow(following, seen(201), narrow)
    assert back.state == "SEARCH"


def test_ten_minutes_of_cloud_do_not_lose_it():
    following = locked(frames=8)
    for frame_id in range(9, 29):
        following, _ = follow(following, seen(frame_id), SETTINGS)
    assert following.state == "COAST"
    after, _ = follow(following, seen(29, geo_measurement(29)), SETTINGS)
    assert after.state == "TRACK"


@given(shift_deg=st.floats(-360, 360))
def test_where_right_ascension_starts_changes_nothing(shift_deg):
    """Shifting all right ascensions, across 0h too, shifts the track and nothing else."""
    here, there = locked(), locked(ra_deg=150.0 + shift_deg)
    assert here.track is not None
    assert there.track is not None
    a_millionth_arcsec_s = 1e-6 / 3600.0
    assert there.track.x[1] == pytest.approx(here.track.x[1], abs=a_millionth_arcsec_s)
    off = (there.track.x[0] - here.track.x[0] - shift_deg + 180.0) % 360.0 - 180.0
    assert abs(off) * 3600.0 < 1e-3


CROSSING = ((150.0 + GEO_RATE_DEG_S * 120, -5.02), (150.0 + GEO_RATE_DEG_S * 120, -4.98))
MAX_CONFIDENT = dataclasses.replace(SETTINGS, choice="most confident")
ACROSS = {"is_clipped": True, "is_crossing": True, "confidence": 0.99}
TABLE = [
    # name, state before, what is seen, settings, state after, verdicts in order
    ("nothing while searching", "SEARCH", [], SETTINGS, "SEARCH", []),
    ("a first streak", "SEARCH", [{}], SETTINGS, "ACQUIRE", []),
    ("a clipped one", "SEARCH", [{"is_clipped": True}], SETTINGS, "SEARCH", ["clipped by the"]),
    ("its second", "ACQUIRE", [{}], SETTINGS, "TRACK", []),
    *(
        (f"a first {name}", "SEARCH", [{"object_class": name}], SETTINGS, "SEARCH", [name])
        for name in ("aircraft", "meteor", "cosmic ray", "star chain")
    ),
    ("a satellite", "SEARCH", [{"object_class": "satellite"}], SETTINGS, "ACQUIRE", []),
    (
        "its second, an aircraft",
        "ACQUIRE",
        [{"object_class": "aircraft"}],
        SETTINGS,
        "SEARCH",
        ["no second frame: no detection", "aircraft: starts no track"],
    ),
    ("a crossing", "SEARCH", [ACROSS], SETTINGS, "SEARCH", ["crosses the whole frame"]),
    ("its second and a crossing", "ACQUIRE", [ACROSS, {}], SETTINGS, "TRACK", ["crosses"]),
    ("it and a crossing", "TRACK", [ACROSS, {}], SETTINGS, "TRACK", ["crosses the whole"]),
    ("a crossing alone", "TRACK", [ACROSS], SETTINGS, "COAST", ["crosses the whole"]),
    ("a crossing by the paper's rule", "TRACK", [ACROSS, {}], MAX_CONFIDENT, "TRACK", ["crosses"]),
    ("no second", "ACQUIRE", [], SETTINGS, "SEARCH", ["no second frame: no detection"]),
    (
        "two seconds, one fits",
        "ACQUIRE",
        [{"dec_deg": -5.5}, {}],
        SETTINGS,
        "TRACK",
        ["another one leads"],
    ),
    ("another one", "ACQUIRE", [{"dec_deg": -5.5}], SETTINGS, "ACQUIRE", ["no second frame: st"]),
    ("the one followed", "TRACK", [{}], SETTINGS, "TRACK", []),
    ("a miss", "TRACK", [], SETTINGS, "COAST", []),
    ("a neighbour alone", "TRACK", [{"ra_deg": 150.19}], SETTINGS, "COAST", ["NIS"]),
    ("a neighbour as well", "TRACK", [{"ra_deg": 150.19}, {}], SETTINGS, "TRACK", ["NIS"]),
    ("across", "TRACK", [{"ends_icrs_deg": CROSSING}], SETTINGS, "COAST", ["streak runs 90"]),
    ("twice as fast", "TRACK", [{"exposure_s": 20.0}], SETTINGS, "COAST", ["streak is 300"]),
    ("half as fast", "TRACK", [{"exposure_s": 5.0}], SETTINGS, "COAST", ["streak is 75"]),
    (
        "part of a streak elsewhere",
        "TRACK",
        [{"ra_deg": 150.05, "is_clipped": True, "cov_sky_arcsec2": (4e4, 0.0, 1.0)}],
        SETTINGS,
        "COAST",
        ["clipped, and 179 arcsec"],
    ),
    (
        "found twice",
        "TRACK",
        [{"ra_deg": 150.0001}, {}],
        SETTINGS,
        "TRACK",
        ["another one is taken"],
    ),
    (
        "the paper's rule takes the most confident",
        "TRACK",
        [{"ra_deg": 150.19}, {}],
        MAX_CONFIDENT,
        "TRACK",
        ["another one is taken"],
    ),
    ("again after a miss", "COAST", [{}], SETTINGS, "TRACK", []),
    ("another miss", "COAST", [], SETTINGS, "COAST", []),
    ("after a loss nothing", "LOST", [], SETTINGS, "SEARCH", []),
    ("after a loss a streak", "LOST", [{}], SETTINGS, "ACQUIRE", []),
]
STATES = {
    "SEARCH": Following(),
    "ACQUIRE": Following(state="ACQUIRE", candidates=(geo_measurement(4),)),
    "TRACK": locked(),
    "LOST": Following(state="LOST"),
}
STATES["COAST"] = follow(locked(frames=3), seen(4), SETTINGS)[0]


@pytest.mark.parametrize(
    ("before", "shown", "settings", "after", "verdicts"),
    [row[1:] for row in TABLE],
    ids=[row[0] for row in TABLE],
)
def test_every_passage_of_the_fold(before, shown, settings, after, verdicts):
    """From this state, seeing this: the next state, a verdict on all that was not taken."""
    sight = seen(5, *(geo_measurement(5, **change) for change in shown))
    found, records = follow(STATES[before], sight, settings)
    assert found.state == after
    told = [text(r.reason) for r in records if isinstance(r, NotFollowed)]
    assert len(told) == len(verdicts)
    assert all(words.startswith(start) for words, start in zip(told, verdicts, strict=True))
    changes = [r for r in records if isinstance(r, StateChange)]
    assert [(c.before, c.after) for c in changes] == ([] if before == after else [(before, after)])
    misses = sum(isinstance(r, Miss) for r in records)
    assert misses == (after == "COAST")


def test_of_two_near_neighbours_each_is_paired_with_itself():
    """40 arcsec apart both pairs agree within the tolerances; crossed ones fit worse."""
    beside = 40.0 / 3600.0
    first = [geo_measurement(1), geo_measurement(1, ra_deg=150.0 - beside)]
    second = [geo_measurement(2), geo_measurement(2, ra_deg=150.0 - beside)]
    for order in ([0, 1], [1, 0]):
        waiting, _ = follow(Following(), seen(1, *(first[n] for n in order)), SETTINGS)
        after, _ = follow(waiting, seen(2, *second), SETTINGS)
        assert after.track is not None
        assert after.track.x[1] == pytest.approx(GEO_RATE_DEG_S, rel=1e-6)


def test_what_a_miss_is_put_down_to_is_on_record():
    cloud = Missed(kind="no detection", hidden_by=(HiddenBy(kind="few stars", stars=3),))
    sight = dataclasses.replace(seen(5), absence=cloud)
    _, records = follow(locked(), sight, SETTINGS)
    assert [r.reason for r in records if isinstance(r, Miss)] == [sight.absence]


def test_the_same_inputs_give_the_same_track_bit_for_bit():
    assert locked() == locked()
