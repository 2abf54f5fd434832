"""What is kept of orbits and names on record, and what the log says of them."""

from dataclasses import replace

import pytest

from rsoconsole.night import line_of
from rsoconsole.records import FollowedAgain, Identified
from tests.nights import made_up_night as night
from tests.nights.orbit_night import (
    BEST,
    FOLLOWED,
    estimate_of,
    folded,
    identified_of,
    state,
    to,
)

NOW = night.t_of(20)
HINT = "perhaps INTELSAT 14 (36097) has the right motion, 900″ (60 s) ahead of its elements"


def test_the_last_orbit_and_name_are_known() -> None:
    found = folded(*FOLLOWED, identified_of(5), state(6), estimate_of(6))
    view = found.view()
    assert view.orbit == estimate_of(6)
    assert view.orbit_utc_ns == night.t_of(6)
    assert view.identified == identified_of(5)
    assert not view.is_orbit_of_past_lead


def test_after_a_loss_they_stay_as_of_the_past_until_another_track_has_an_orbit() -> None:
    found = folded(*FOLLOWED, identified_of(5), to(7, "COAST", "LOST"))
    assert found.view().is_orbit_of_past_lead
    assert found.view().orbit == estimate_of(5)
    folded(state(11, "initial", 2), to(11, "ACQUIRE", "TRACK"), before=found)
    assert found.view().is_orbit_of_past_lead
    assert found.view().identified == identified_of(5)
    folded(state(12, track_id=2), estimate_of(12, track_id=2), before=found)
    assert not found.view().is_orbit_of_past_lead
    assert found.view().orbit == estimate_of(12, track_id=2)
    assert found.view().identified is None


def test_a_name_of_another_track_is_none_of_the_orbit_before() -> None:
    name = identified_of(12, track_id=2)
    found = folded(*FOLLOWED, to(7, "COAST", "LOST"), state(11, "initial", 2), name)
    assert found.view().orbit is None
    assert found.view().identified == name


def test_what_the_operator_took_the_mount_from_is_followed_again_with_its_orbit() -> None:
    found = folded(*FOLLOWED, to(6, "TRACK", "MANUAL"))
    assert found.view().is_orbit_of_past_lead
    assert not folded(to(7, "MANUAL", "COAST"), before=found).view().is_orbit_of_past_lead


def test_after_a_word_on_a_frame_the_last_orbit_stands_until_the_next_one() -> None:
    found = folded(*FOLLOWED, identified_of(5), FollowedAgain(frame_id=4))
    assert found.view().being_fitted_again == frozenset()  # its orbit had heard of frame 5
    folded(FollowedAgain(frame_id=5), before=found)
    view = found.view()
    assert (view.orbit, view.identified) == (estimate_of(5), identified_of(5))
    assert view.being_fitted_again == {1}
    folded(replace(estimate_of(5), a_km=42000.0), before=found)
    assert found.view().being_fitted_again == frozenset()
    assert found.view().orbit.a_km == 42000.0


def test_a_night_that_goes_back_has_the_orbit_of_then() -> None:
    found = folded(*FOLLOWED, identified_of(5))
    kept = found.checkpoint()
    before = found.view()
    folded(state(6), estimate_of(6), replace(identified_of(6), hint=HINT), before=found)
    found.restore(kept)
    assert found.view() == before


def test_a_name_that_is_no_news_is_told_once() -> None:
    found = folded(*FOLLOWED, identified_of(4), identified_of(5), identified_of(6, hint=HINT))
    said = [line.text for line in found.log if line.text.startswith("identified")]
    assert len(said) == 2
    assert HINT in said[1]


# -- the log ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("record", "level", "text"),
    [
        (
            identified_of(9),
            "good",
            "identified: INTELSAT 14 (36097), 3.1″ off; then SES 10 at 12.0′",
        ),
        (
            identified_of(9, matches=(replace(BEST, name=""),)),
            "good",
            "identified: 36097, 3.1″ off",
        ),
        (
            identified_of(9, verdict="ambiguous", reason="A and B fit alike"),
            "info",
            "ambiguous: A and B fit alike",
        ),
        (
            identified_of(9, verdict="unknown", reason="no catalogued object near", matches=()),
            "info",
            "unknown: no catalogued object near",
        ),
        (
            identified_of(9, verdict="unknown", reason="none near", hint=HINT),
            "warning",
            f"unknown: none near; {HINT}",
        ),
    ],
)
def test_the_log_says_which_object_it_is(record: Identified, level: str, text: str) -> None:
    line = line_of(record, NOW)
    assert line is not None
    assert (line.level, line.text, line.frame_id) == (level, text, 9)
    assert line_of(estimate_of(9), NOW) is None
