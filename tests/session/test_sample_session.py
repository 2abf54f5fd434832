"""The session that is shipped: whole, small, of nobody's machine; every table of every sample."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from rsoconsole.library.notebook import session as session_room
from rsoconsole.library.notebook.session import open_session
from rsoconsole.pipeline import replay
from rsoconsole.records import (
    TABLES,
    Detection,
    Detections,
    FollowedAgain,
    Identified,
    Miss,
    NotSolved,
    OperatorAction,
    ParameterChange,
    Ruling,
    Solution,
    StateChange,
    Table,
    TrackState,
)
from rsoconsole.session import SessionReader, verify_session
from rsoconsole.session.log.codec import KINDS
from rsoconsole.session.log.schema import SCHEMA_VERSION
from tests.nights import engine_nights
from tests.nights.samples import SAMPLE

MAX_BYTES = 8_000_000
FRAMES = 36
TAU_AT = {9: 0.1, 13: 0.95}
"""The frames that kept their pixels, and the tau that was in force."""
SAME_PX, SAME_CONFIDENCE = 0.01, 1e-3
EVERY_SAMPLE = ("shipped", "busy", "ruled")


@pytest.fixture(scope="module")
def reader() -> SessionReader:
    return SessionReader(SAMPLE)


@pytest.fixture(scope="module")
def records(reader: SessionReader) -> list[Any]:
    return [record for _, _, record in reader.records()]


@pytest.fixture(scope="module", params=EVERY_SAMPLE)
def night(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> session_room.Session:
    """The shipped one, and two of an engine in which much happens."""
    if request.param == "shipped":
        return open_session(SAMPLE)
    made = {"busy": engine_nights.busy, "ruled": engine_nights.ruled}[request.param]()
    return open_session(made.written(tmp_path_factory.mktemp("made") / "night"))


# -- every table of every sample -------------------------------------------------------------


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_table_has_its_columns_and_units_also_where_it_is_empty(
    table: Table, night: session_room.Session
) -> None:
    found, frame = night.table(table.name), night.frame(table.name)
    named = {column.name.replace("_utc_ns", "_utc"): column for column in table.columns}
    assert [name for name in found.colnames if name != "direction"] == list(named)
    assert list(frame.columns) == list(named)
    assert len(found) == len(frame) == len(night._reader.view_rows(table.name))
    for name, column in named.items():
        unit = getattr(found[name], "unit", None)
        is_quantity = not (column.shape or column.name.endswith("_utc_ns"))
        assert (None if unit is None else str(unit)) == (column.unit if is_quantity else None)
    if {"ra_icrs_deg", "dec_icrs_deg"} <= set(named):
        assert found["direction"].frame.name == "icrs"
        assert found["direction"].shape == (len(found),)


OF_A_FIELD = {"pairs", "expected", "leaps", "low_passes"}
"""Tables of nights with several satellites or low ones: not the shipped, which misses nobody."""


@pytest.mark.parametrize("name", TABLES)
def test_no_table_of_the_shipped_one_is_empty(name: str) -> None:
    assert (len(open_session(SAMPLE).table(name)) > 0) != (name in OF_A_FIELD)


def test_every_kind_of_record_and_of_file_is_in_it(reader: SessionReader, records: list[Any]):
    of_a_field = {TABLES[name].kind.__name__ for name in OF_A_FIELD - {"expected"}}
    assert {type(record).__name__ for record in records} == set(KINDS) - of_a_field
    for number in (5, 13, 30):
        assert reader.preview_path(number) is not None
        assert reader.closeup_path(number) is not None


# -- the night ----------------------------------------------------------------------------


def test_it_locks_early_knows_the_orbit_and_the_name(records: list[Any]) -> None:
    begun = next(r for r in records if isinstance(r, TrackState) and r.kind == "initial")
    assert begun.frame_id == 4
    assert {r.track_id for r in records if isinstance(r, TrackState)} == {1}
    names = [r for r in records if isinstance(r, Identified)]
    assert {(r.verdict, r.matches[0].norad_id) for r in names} == {("identified", 36097)}


def test_clouds_hide_some_frames_and_the_operator_does_a_little_of_everything(
    records: list[Any],
) -> None:
    assert [r.frame_id for r in records if isinstance(r, NotSolved)] == [23]
    assert [r.frame_id for r in records if isinstance(r, Solution) and r.path == "shift"] == [24]
    hidden = [r.frame_id for r in records if isinstance(r, Miss) and r.reason.hidden_by]
    assert hidden == [23, 24, 25]
    done = {r.verb for r in records if isinstance(r, OperatorAction)}
    assert done == {"note", "set", "reject", "mark", "goto", "nudge", "resume"}
    changed = {r.name for r in records if isinstance(r, ParameterChange)}
    assert changed == {"detector.tau", "filter.q_multiplier", "filter.r_multiplier"}
    assert "MANUAL" in {r.after for r in records if isinstance(r, StateChange)}
    decisions = [r for r in records if isinstance(r, Ruling)]
    assert [r.frame_id for r in decisions] == [20, 35]
    assert [bool(r.refused) for r in decisions] == [True, False]
    again = [r.frame_id for r in records if isinstance(r, FollowedAgain)]
    assert again == [20, 35]


def test_a_replay_equals_the_record(reader: SessionReader, records: list[Any]) -> None:
    frames = list(replay(records, reader.config()))
    assert len(frames) >= FRAMES - 1
    assert all(frame.is_alike for frame in frames)


# -- what is kept of it ---------------------------------------------------------------------


def test_it_is_small_and_names_no_machine() -> None:
    paths = [path for path in SAMPLE.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in paths) <= MAX_BYTES
    named = re.compile(rb"/(home|root|tmp|work|Users)/")
    for path in paths:
        if path.suffix not in {".png", ".fz"}:
            assert not named.search(path.read_bytes()), path


def test_it_is_of_todays_schema_and_verifies_without_a_fault() -> None:
    found = verify_session(SAMPLE)
    assert (found.schema, found.state, found.digest) == (SCHEMA_VERSION, "closed", "confirmed")
    assert found.frames == FRAMES
    assert [(each.severity, each.place) for each in found.findings] == [("remark", "files")]
    done = CliRunner().invoke(app, ["sessions", "verify", str(SAMPLE)])
    assert done.exit_code == 0, done.output


def test_every_frame_has_its_hash_and_what_was_pruned_is_said(reader: SessionReader) -> None:
    rows = reader.view_rows("frames")
    assert len(rows) == FRAMES
    assert all(re.fullmatch("[0-9a-f]{64}", row["file_sha256"]) for row in rows)
    kept = [r["frame_id"] for r in rows if reader.frame_path(r["frame_id"]) is not None]
    assert kept == list(TAU_AT)
    assert reader.missing_pixels_reason(9) is None
    assert "pruned on 2023-06-23" in (reader.missing_pixels_reason(8) or "")


def test_the_notebook_counts_the_pixels_that_are_there() -> None:
    night = open_session(SAMPLE)
    assert f"{FRAMES}, {len(TAU_AT)} kept in full" in night._repr_html_()
    assert night.pixels(9).shape == (1760, 2328)
    with pytest.raises(SessionError, match=r"frame 8 .* pruned on 2023-06-23.*; kept: 9, 13"):
        night.pixels(8)


@pytest.mark.parametrize("number", TAU_AT)
def test_detect_finds_in_the_kept_pixels_what_was_recorded(number: int, records: list[Any]):
    path = SAMPLE / "frames" / f"{number:06d}.fits.fz"
    words = ["detect", str(path), "--tau", str(TAU_AT[number]), "--json"]
    done = CliRunner().invoke(app, [*words, "--config", str(SAMPLE / "config.toml")])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    (recorded,) = [r for r in records if isinstance(r, Detections) and r.frame_id == number]
    assert _places(found["detections"]) == _as_recorded(list(recorded.detections))
    rejected = [each.detection for each in recorded.rejected]
    assert _places(found["rejected"]) == _as_recorded(rejected)


def _places(found: list[dict[str, Any]]) -> list[tuple[float, ...]]:
    return [(d["confidence"], d["x_px"], d["y_px"], d["length_px"]) for d in found]


def _as_recorded(recorded: list[Detection]) -> list[Any]:
    """The same of the record, as far as another processor may differ."""
    return [
        (
            pytest.approx(d.confidence, abs=SAME_CONFIDENCE),
            *(pytest.approx(value, abs=SAME_PX) for value in (d.x_px, d.y_px, d.length_px)),
        )
        for d in recorded
    ]


def test_the_path_in_the_documentation_is_the_samples() -> None:
    guide = Path(__file__).parents[2] / "rsoconsole" / "cli" / "guide"
    for page in ("console.md", "morning.md"):
        assert f"sessions/{SAMPLE.name}" in (guide / page).read_text(encoding="utf-8")
