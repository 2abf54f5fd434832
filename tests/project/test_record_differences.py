"""What a failing test shows of records."""

from dataclasses import replace

from rsoconsole.records import Cause, Event, StateChange
from tests.nights.record_differences import MAX_CHARACTERS, differences

EVENT = Event(level="info", text="a" * 500, frame_id=3)
CHANGE = StateChange(frame_id=1, before="IDLE", after="SEARCH", reason=Cause(kind="waiting"))


def test_of_two_records_only_what_differs_is_shown_and_that_is_short() -> None:
    lines = differences(EVENT, replace(EVENT, frame_id=4))
    assert lines == ["Event:", "  frame_id: 3 == 4"]
    (_, line) = differences(EVENT, replace(EVENT, text="b")) or []
    assert len(line) < MAX_CHARACTERS + 30


def test_what_differs_within_is_named_by_its_path() -> None:
    other = replace(CHANGE, reason=Cause(kind="waiting", detections=2))
    assert differences(CHANGE, other) == ["StateChange:", "  reason.detections: None == 2"]


def test_of_many_records_the_place_is_told_and_what_one_side_lacks() -> None:
    lines = differences((EVENT, CHANGE), (EVENT, replace(CHANGE, frame_id=2), EVENT)) or []
    assert lines[1:4] == ["2 records == 3 records", "1: StateChange:", "  frame_id: 1 == 2"]
    assert lines[4].startswith("2: one side alone has Event(")


def test_anything_else_is_left_to_pytest() -> None:
    assert differences(1, 2) is None
    assert differences([EVENT], [1]) is None
