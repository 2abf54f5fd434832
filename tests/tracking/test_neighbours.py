"""Neighbours of a slot: which of several alike is what is followed, and when nobody can tell."""

import dataclasses

import numpy as np
import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.records import HiddenBy, Miss, Missed, NotFollowed, TrackState
from rsoconsole.sky import tan_wcs
from rsoconsole.tracking import Field, Following, FollowSettings, follow, sky_covariance_arcsec2
from rsoconsole.tracking._gates import INDISTINGUISHABLE
from rsoconsole.tracking.association.neighbours import (
    MIN_MARGIN,
    UNKNOWN_COST,
    UNSEEN_COST,
    Neighbour,
    best_match,
)
from rsoconsole.words import text
from tests.makers import T0_UTC_NS, geo_measurement
from tests.tracking.test_follow import SETTINGS as EVERY_DAY
from tests.tracking.test_follow import locked, seen

SETTINGS = dataclasses.replace(EVERY_DAY, filter=FilterConfig(preset="tuned"))
"""Its bounds after a coast are what the figures here are computed from."""

NEIGHBOUR_DEG = 0.06
"""A slot's mates: 3.6 arcmin."""
LONG, SHORT = 70, 40
"""Frames until something is seen again: 30 and 15 minutes unseen, bounds of 130 and 42 arcsec."""
SWAPPED = "the neighbour is taken for it"


def after_a_coast(
    shift_deg: float,
    *,
    target: bool,
    neighbour: bool,
    until: int = LONG,
    field: Field | None = None,
    settings: FollowSettings = SETTINGS,
) -> tuple[Following, str, str]:
    """Unseen for so many frames beside a known neighbour; then both stand beside the prediction.

    Returns what is followed, the verdict on what is shown first, and the miss.
    """
    following = Following()
    for frame_id in range(1, 10):
        both = (
            geo_measurement(frame_id, confidence=0.8),
            geo_measurement(frame_id, ra_deg=150.0 + NEIGHBOUR_DEG, confidence=0.7),
        )
        following, _ = follow(following, seen(frame_id, *both), settings)
    for frame_id in range(10, until):
        following, _ = follow(following, seen(frame_id), settings)
    assert following.state == "COAST"
    shown = []
    if target:
        shown.append(geo_measurement(until, ra_deg=150.0 + shift_deg))
    if neighbour:
        shown.append(geo_measurement(until, ra_deg=150.0 + NEIGHBOUR_DEG + shift_deg))
    sight = dataclasses.replace(seen(until, *shown), field=field)
    after, records = follow(following, sight, settings)
    told = [text(r.reason) for r in records if isinstance(r, NotFollowed)]
    missed = [text(r.reason) for r in records if isinstance(r, Miss)]
    return after, "; ".join(told), "; ".join(missed)


@pytest.mark.parametrize("shift_deg", [-0.05, -0.035, 0.0, 0.035])
def test_after_a_long_coast_a_known_neighbour_is_not_taken_for_it(shift_deg):
    """Even where the prediction's error brings the neighbour nearer than the one followed."""
    after, told, _ = after_a_coast(shift_deg, target=True, neighbour=True)
    assert after.state == "TRACK"
    assert after.lead_measured is not None
    assert (
        after.lead_measured.ra_icrs_deg
        == geo_measurement(LONG, ra_deg=150.0 + shift_deg).ra_icrs_deg
    )
    assert told == "stands where a neighbour of the one followed was"


@pytest.mark.parametrize("shift_deg", [-0.01, 0.0, 0.01])
def test_after_a_shorter_coast_one_streak_alone_is_enough(shift_deg):
    """Bounds of 42 arcsec tell 216 arcsec apart."""
    after, _, _ = after_a_coast(shift_deg, target=True, neighbour=False, until=SHORT)
    assert after.state == "TRACK"
    alone, told, _ = after_a_coast(shift_deg, target=False, neighbour=True, until=SHORT)
    assert alone.state == "COAST"
    assert told.startswith(("stands where a neighbour", "NIS"))


ALONE = [
    # name, the prediction's error, who shows itself, what position alone would make of it
    ("the neighbour, nearer", -0.04, "neighbour", SWAPPED),
    ("the neighbour, at the prediction itself", -0.06, "neighbour", SWAPPED),
    ("the neighbour, half way", -0.031, "neighbour", SWAPPED),
    ("the neighbour, at its own place", -0.01, "neighbour", "left alone"),
    ("the one followed, nearer", 0.01, "target", "taken back"),
    ("the one followed, nearer the neighbour's place", 0.04, "target", "left alone"),
]


@pytest.mark.parametrize(
    ("shift_deg", "who", "by_position"), [row[1:] for row in ALONE], ids=[row[0] for row in ALONE]
)
def test_after_a_long_coast_one_streak_alone_is_nobodys(monkeypatch, shift_deg, who, by_position):
    """Bounds of 130 arcsec hold two objects 216 apart: without a margin it was a coin's toss."""
    shown = {"target": who == "target", "neighbour": who == "neighbour"}
    after, told, missed = after_a_coast(shift_deg, **shown)
    assert (after.state, told, missed) == (
        "COAST",
        text(INDISTINGUISHABLE),
        text(INDISTINGUISHABLE),
    )

    monkeypatch.setattr("rsoconsole.tracking._gates.MIN_MARGIN", 0.0)
    before, _, _ = after_a_coast(shift_deg, **shown)
    taken = {"target": "taken back", "neighbour": SWAPPED}[who]
    assert by_position == ("left alone" if before.state == "COAST" else taken)


def test_the_pair_together_ends_the_doubt():
    after, _, _ = after_a_coast(-0.04, target=True, neighbour=True)
    assert after.state == "TRACK"


def test_with_the_papers_bounds_no_margin_is_asked():
    """They are wider than any field: nothing seen alone could ever be told apart in them."""
    paper = dataclasses.replace(SETTINGS, filter=FilterConfig(preset="paper"))
    after, _, _ = after_a_coast(0.01, target=True, neighbour=False, settings=paper)
    assert after.state == "TRACK"


def test_what_a_miss_without_a_known_identity_is_put_down_to():
    sight = geo_measurement(LONG, ra_deg=150.0 + NEIGHBOUR_DEG - 0.04)
    following = coasting(LONG)
    beside = (Neighbour(east_arcsec=216.0, north_arcsec=0.0, t_utc_ns=T0_UTC_NS),)
    lead = dataclasses.replace(following.tracks[0], neighbours=beside)
    following = dataclasses.replace(following, tracks=(lead,))
    absence = Missed(kind="nothing fits", hidden_by=(HiddenBy.by_faint_stars(0.9),))
    _, records = follow(
        following, dataclasses.replace(seen(LONG, sight), absence=absence), SETTINGS
    )
    (miss,) = [r for r in records if isinstance(r, Miss)]
    assert text(miss.reason) == f"cloud: the stars are 0.9 mag fainter; {text(INDISTINGUISHABLE)}"


def test_without_that_memory_the_neighbour_would_be_taken():
    """The bounds after such a coast really hold both."""
    nearer = geo_measurement(LONG, ra_deg=150.0 + NEIGHBOUR_DEG - 0.05)
    after, _ = follow(coasting(LONG), seen(LONG, nearer), SETTINGS)
    assert after.state == "TRACK"


def coasting(until: int) -> Following:
    following = locked(frames=9, settings=SETTINGS)
    for frame_id in range(10, until):
        following, _ = follow(following, seen(frame_id), SETTINGS)
    return following


def predicted(until: int = LONG) -> TrackState:
    _, records = follow(coasting(until), seen(until), SETTINGS)
    (state,) = [r for r in records if isinstance(r, TrackState)]
    return state


def field_about(east_deg: float, half_width_deg: float = 0.3, rotation_deg: float = 0.0) -> Field:
    """A square field whose centre lies so far east of the prediction at frame LONG."""
    at = predicted()
    size_px = round(half_width_deg * 2.0 * 3600.0)
    wcs = tan_wcs(
        at.x[0] + east_deg / np.cos(np.radians(at.x[2])),
        at.x[2],
        scale_arcsec_px=1.0,
        rotation_deg=rotation_deg,
        is_flipped=False,
        width_px=size_px,
        height_px=size_px,
    )
    return Field(wcs=wcs, width_px=size_px, height_px=size_px)


@pytest.mark.parametrize(
    ("east_deg", "rotation_deg", "state"),
    [(0.0, 0.0, "COAST"), (-0.27, 0.0, "TRACK"), (-0.27, 90.0, "TRACK"), (0.27, 0.0, "COAST")],
    ids=["both ought to be seen", "only the one followed", "turned", "only the neighbour, surely"],
)
def test_what_ought_to_lie_outside_the_field_is_not_missed(east_deg, rotation_deg, state):
    """A streak at the prediction: the neighbour would stand 216 arcsec east of it."""
    field = field_about(east_deg, rotation_deg=rotation_deg)
    after, _, _ = after_a_coast(0.0, target=True, neighbour=False, field=field)
    assert after.state == state


def test_a_streak_that_would_be_cut_by_the_edge_is_not_missed_either():
    """75 arcsec of it and its own uncertainty must lie inside before its absence says a thing."""
    at = predicted()
    neighbour = Neighbour(east_arcsec=216.0, north_arcsec=0.0, t_utc_ns=T0_UTC_NS)
    here = geo_measurement(LONG, ra_deg=150.0)
    margins = []
    for edge_arcsec in (250.0, 600.0):  # east of the prediction
        field = field_about(edge_arcsec / 3600.0 - 0.3)
        match = best_match((here,), at, (neighbour,), streak_arcsec=150.0, field=field)
        margins.append(match.margin)
    assert margins[0] == pytest.approx(margins[1] + UNSEEN_COST, abs=0.1)


def test_the_margin_is_what_the_next_identity_costs_more():
    at, neighbour = predicted(), Neighbour(east_arcsec=216.0, north_arcsec=0.0, t_utc_ns=T0_UTC_NS)
    alone = best_match((geo_measurement(LONG),), at, (neighbour,))
    sigma_arcsec = np.sqrt(sky_covariance_arcsec2(at)[0, 0] + 1.0)
    wider_arcsec = np.hypot(sigma_arcsec, neighbour.sigma_arcsec(at.t_utc_ns))
    assert alone.margin == pytest.approx((216.0 / wider_arcsec) ** 2, rel=0.01)
    assert alone.margin < MIN_MARGIN
    both = (geo_measurement(LONG), geo_measurement(LONG, ra_deg=150.0 + 216.0 / 3586.3))
    paired = best_match(both, at, (neighbour,))
    assert paired.measurement is both[0]
    assert paired.margin > UNSEEN_COST + UNKNOWN_COST / 2.0


def test_the_same_streak_found_twice_is_no_doubt():
    at, neighbour = (
        predicted(20),
        Neighbour(east_arcsec=216.0, north_arcsec=0.0, t_utc_ns=T0_UTC_NS),
    )
    twice = (geo_measurement(20), geo_measurement(20, ra_deg=150.0001))
    assert best_match(twice, at, (neighbour,)).margin > MIN_MARGIN


@pytest.mark.parametrize(("error_arcsec", "is_known"), [(0.0, False), (20.0, True)])
def test_a_pattern_is_believed_as_far_as_its_streaks_are_known_to_err(error_arcsec, is_known):
    """Both are seen, 50 arcsec nearer to each other than before: streaks that end in clouds."""
    at = predicted(SHORT)
    neighbour = Neighbour(
        east_arcsec=300.0, north_arcsec=0.0, t_utc_ns=at.t_utc_ns, error_arcsec=error_arcsec
    )
    both = (geo_measurement(SHORT), geo_measurement(SHORT, ra_deg=150.0 + 250.0 / 3586.3))
    match = best_match(both, at, (neighbour,), errors_arcsec=(error_arcsec, error_arcsec))
    assert (match.measurement is both[0] and match.margin > MIN_MARGIN) is is_known
