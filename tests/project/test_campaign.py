"""A campaign's answers are kept, added up rightly, and not asked for twice."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.campaign import runner
from tests.campaign.__main__ import PAGE
from tests.campaign.arguments import seeds_of
from tests.campaign.cases import GROUPS, Case
from tests.campaign.table import row, table


def test_seeds_are_read_as_people_write_them() -> None:
    assert seeds_of("1-3,7") == [1, 2, 3, 7]
    with pytest.raises(ValueError, match="invalid literal"):
        seeds_of("one")


def night(**changes: Any) -> dict[str, Any]:
    each = {
        "norad": 36097,
        "name": "INTELSAT 14",
        "detections": 9,
        "visible_frames": 10,
        "track_frames": 5,
        "measured_rms_arcsec": 0.5,
        "prediction_rms_arcsec": 1.0,
        "identified": True,
        "false_measurements": 1,
    }
    return {"objects": [each | changes]}


def test_a_row_adds_up_over_objects_and_nights() -> None:
    found = [
        night(),
        night(detections=3, identified=False),
        night(visible_frames=0),
        {"error": "x"},
    ]
    cells = [cell.strip() for cell in row("title", found).split("|")[1:-1]]
    assert cells[:5] == ["title", "3 (1 failed)", "20", "60 %", "50 %"]
    # Older answers do not tell what came after lock.
    assert cells[5:7] == ["-", "-"]
    assert cells[7:] == ["1 of 2", '0.50"', '1.00"', "2"]


def test_after_lock_only_what_was_detected_counts() -> None:
    found = [
        night(detected_after_lock=20, tracked_after_lock=19, inside_3sigma=1.0),
        night(detected_after_lock=5, tracked_after_lock=5, inside_3sigma=0.9),
        night(detected_after_lock=0, tracked_after_lock=0, inside_3sigma=None),
    ]
    cells = [cell.strip() for cell in row("title", found).split("|")[1:-1]]
    assert cells[5:7] == ["96 %", "95 %"]


def test_what_is_found_in_invisible_frames_does_not_make_up_for_what_is_missed() -> None:
    found = [night(visible_frames=2), night(detections=0, track_frames=0)]
    cells = [cell.strip() for cell in row("title", found).split("|")[1:-1]]
    assert cells[2:5] == ["12", "17 %", "17 %"]


def test_a_night_without_anything_visible_gives_no_share() -> None:
    cells = row("title", [night(visible_frames=0)]).split("|")
    assert [cell.strip() for cell in cells[3:6]] == ["0", "-", "-"]


def test_the_shutters_nights_are_told_by_their_scatter() -> None:
    text = table({"shutter": {"scatter-0.2-seed-1": night(), "scatter-1-seed-1": night()}})
    assert "shutter scattered by 0.2 s | 1 |" in text
    assert "shutter scattered by 1 s | 1 |" in text


def test_what_is_done_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def run(case: Case, sessions: Path | None) -> dict[str, Any]:
        asked.append(case.name)
        return night()

    monkeypatch.setattr(runner, "run", run)
    cases = GROUPS["shutter"].cases((1,))
    for case in cases[:2]:
        list(runner.run_missing([case], tmp_path, 1))
    assert {case.name for case, _ in runner.run_missing(cases, tmp_path, 2)} == {
        case.name for case in cases[2:]
    }
    assert sorted(asked) == sorted(case.name for case in cases)
    assert runner.answers(cases, tmp_path).keys() == {case.name for case in cases}


def test_the_answers_lie_beside_the_table_one_night_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "RESULTS", tmp_path / "results")
    runner.keep("worlds", {"world-001": night(), "world-002": {"error": "x"}})
    runner.keep("gps", {})
    [kept] = (tmp_path / "results").iterdir()
    text = kept.read_text(encoding="utf-8")
    assert json.loads(text) == {"world-001": night(), "world-002": {"error": "x"}}
    assert len(text.splitlines()) == 4
    runner.go_on(GROUPS, tmp_path / "folder")
    known = runner.answers(GROUPS["worlds"].cases((1, 2, 3)), tmp_path / "folder")
    assert known == {"world-001": night(), "world-002": {"error": "x"}}


def test_names_within_a_group_are_its_own() -> None:
    for group in GROUPS.values():
        names = [case.name for case in group.cases(group.seeds)]
        assert len(names) == len(set(names)), group.name


def test_the_page_has_a_place_for_the_table() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page.index("<!-- table: begin -->\n") < page.index("<!-- table: end -->")
