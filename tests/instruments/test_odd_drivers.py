"""The odd mounts of ``engine/test_odd_mounts.py`` in process: what the mount's own process says."""

from collections.abc import Mapping
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.sky import jnow_to_icrs
from tests.rigs.odd_mount import COORDINATES, PARK, Oddities
from tests.rigs.odd_sequence import OddNight

INTO_SLEW_S = 2.5
EASILY_PARKED = "ha_deg=50"


def night_of(oddities: str) -> OddNight:
    """Its mount is known, and nobody has ordered anything."""
    night = OddNight(0, Oddities.parse(oddities))
    night.pass_s(5.0)
    return night


def slew(night: OddNight) -> None:
    """To the north-east."""
    ra_deg = (night.model.ra_deg + night.model.ha_deg - 40.0) % 360.0
    ra_icrs_deg, dec_icrs_deg = jnow_to_icrs(ra_deg, 55.0, night.utc_ns())
    night.order(
        "slew",
        ra_icrs_deg=float(ra_icrs_deg),
        dec_icrs_deg=float(dec_icrs_deg),
        now_utc_ns=night.utc_ns(),
    )


def slewing(oddities: str) -> OddNight:
    """At full speed."""
    night = night_of(oddities)
    slew(night)
    night.pass_s(INTO_SLEW_S)
    assert night.model.is_moving_by_itself
    return night


def measured(night: OddNight) -> list[str]:
    """What a STOP came to, in the order in which it was known."""
    said: list[Mapping[str, Any]] = night.voice.said
    stops = [each["motion"] for each in said if each.get("event") == "stop measured"]
    return [motion["kind"] for motion in stops if motion is not None]


@pytest.mark.parametrize(
    ("oddities", "kind"),
    [
        ("", "tracks"),
        ("noidle", "tracks"),
        ("badutf8", "tracks"),
        ("aborts_ignored=2", "tracks"),
        ("notrackstate", "stands"),
        ("slowreport=5 nopollingperiod", "unknown"),
    ],
)
def test_a_stop_that_is_answered_comes_to_what_was_measured(oddities: str, kind: str):
    night = slewing(oddities)
    assert night.order("abort")["is_answered"]
    night.pass_s(12.0)
    assert measured(night) == [kind]
    assert not night.model.is_moving_by_itself


@pytest.mark.parametrize(
    ("oddities", "detail"),
    [
        ("lieabort", None),
        ("abortalert", "answers ABORT with Alert: [ERROR] Abort failed: serial timeout"),
        ("abortignored", "says that it still moves after 4 aborts"),
        ("noabort", "its driver has no ABORT"),
    ],
)
def test_a_mount_that_does_not_obey_is_said_to_move_until_it_rests(
    oddities: str, detail: str | None
):
    night = slewing(oddities)
    answer = night.order("abort")
    assert answer["is_answered"] == (detail is None)
    assert detail is None or detail in answer["detail"]
    while not measured(night):
        assert night.model.is_moving_by_itself
        night.pass_s(0.2)
    assert measured(night) == ["moves"]
    assert night.model.is_moving_by_itself
    night.pass_s(12.0)
    # It arrives where it was going.
    assert measured(night) == ["moves", "tracks"]
    assert not night.model.is_moving_by_itself


def test_a_driver_that_stays_busy_is_seen_to_rest():
    night = slewing("busyforever")
    assert not night.order("abort")["is_answered"]
    night.pass_s(12.0)
    assert measured(night) == ["stands"]


@pytest.mark.parametrize("oddity", ["", "parklies", "parkok_instant", "trackwhileparked"])
def test_a_mount_on_its_way_to_park_is_not_said_to_be_parked(oddity: str):
    night = night_of(f"{oddity} {EASILY_PARKED}")
    night.order("park")
    night.pass_s(INTO_SLEW_S)
    assert night.model.is_moving_by_itself
    assert not night.report().is_parked
    night.pass_s(40.0)
    assert not night.model.is_moving_by_itself
    assert night.report().is_parked
    assert night.report().motion.kind == "stands"  # one that tracks is stopped by the watch


def test_a_park_that_fails_has_its_driver_s_own_reason():
    with pytest.raises(InstrumentError, match="Parking failed"):
        night_of("parkfails").order("park")


def test_without_a_park_position_nothing_is_sent():
    night = night_of("nopark")
    with pytest.raises(InstrumentError, match="no park position"):
        night.order("park")
    assert not [each for each in night.model.received if each[1] == PARK]


def test_a_parked_mount_takes_no_slew():
    night = night_of("startparked")
    with pytest.raises(InstrumentError, match="parked"):
        slew(night)
    assert not [each for each in night.model.received if each[1] == COORDINATES]


@pytest.mark.parametrize(
    ("oddity", "lacks"),
    [
        ("noabort", "can_abort"),
        ("nopark", "can_park"),
        ("notrackstate", "can_set_tracking"),
        ("noside", "has_pier_side"),
        ("nogeo", "has_site"),
        ("notime", "has_time"),
    ],
)
def test_what_a_mount_lacks_is_found_by_what_its_driver_defines(oddity: str, lacks: str):
    able = night_of(oddity).abilities()
    assert [name for name in able.__slots__ if not getattr(able, name)] == [lacks]
