"""The page on the program's JSON holds what the program prints."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.cli.telescope.order import shell_verb
from rsoconsole.cli.words.output import WITH_UNITS, emit_json
from rsoconsole.control import (
    COMMANDS,
    SCHEMA,
    ControlServer,
    LastStop,
    Machine,
    Outcome,
    PartHealth,
    Status,
    default_socket_path,
    read_status,
    status_json,
)
from rsoconsole.control.status import FIRST_NAMES
from rsoconsole.records import Detection, Detections, Frame, NotSolved
from tests.makers import straight_detection
from tests.pages.json_page import expect_documented, first_keys, keys_of

WHOLE = Status(
    state="TRACK",
    holder="autonomy",
    frame_id=7,
    markable_frames=(5, 6),
    ra_icrs_deg=150.0,
    dec_icrs_deg=-5.0,
    alt_deg=41.0,
    az_deg=171.0,
    t_utc_ns=5,
    mount_ra_icrs_deg=151.0,
    mount_dec_icrs_deg=-6.0,
    is_parked=False,
    is_slewing=True,
    is_tracking=False,
    is_parking=False,
    mount_motion="moves",
    mount_rate_deg_s=3.2,
    pier_side="west",
    now_utc_ns=9,
    exposing_until_utc_ns=10,
    next_start_utc_ns=11,
    next_limit="pier",
    next_limit_utc_ns=12,
    is_held=True,
    resumes_when_clear=True,
    lifted=("sun",),
    faults=("camera is silent",),
    temporary={"detector.tau": 3},
    last_stop=LastStop(number=2, by="ann", motion="tracks", measured_ms=3100.0, is_over=True),
    health=(PartHealth(name="disk", ok=False, text="4 GB"),),
    machine=Machine(cpu_temperature_c=51.6, troubles=("hot",)),
    seat="ann@tty1",
    seat_asked_by="bob@tty2",
    session=Path("/nights/one"),
    pid=4,
)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return default_socket_path()


def printed(*words: str) -> dict[str, object]:
    run = CliRunner().invoke(app, [*words, "--json"])
    assert run.exit_code == 0, run.output
    found: dict[str, object] = json.loads(run.stdout)
    return found


def test_the_table_of_units_is_the_programs():
    assert first_keys() == dict(WITH_UNITS)


def test_a_status_crosses_as_itself():
    assert read_status(json.loads(json.dumps(status_json(WHOLE)))) == WHOLE
    assert read_status({}) == Status()


@pytest.mark.parametrize(
    ("name", "odd"),
    [("frame_id", "seven"), ("tracks", 3), ("machine", ["hot"]), ("mount_rate_deg_s", {})],
)
def test_a_field_that_cannot_be_used_counts_as_not_said(name: str, odd: object):
    told = read_status({**status_json(WHOLE), name: odd})
    assert told == replace(WHOLE, **{name: getattr(Status(), name)})


def test_what_would_command_a_terminal_is_taken_out_of_texts_and_a_path_kept(tmp_path: Path):
    night = tmp_path / "night\u3000one"
    told = Status(target="A\x1b[2JB", session=night, health=(PartHealth(name="d", text="\x07"),))
    there = read_status(json.loads(json.dumps(status_json(told))))
    assert (there.target, there.health[0].text) == ("A [2JB", " ")
    assert there.session == night


def test_an_engine_of_the_first_version_is_read_too():
    told = status_json(WHOLE)
    for name in FIRST_NAMES:
        del told[name]
    assert read_status(told) == WHOLE


def test_every_key_of_a_status_says_its_unit_beside_the_first_name():
    told = status_json(WHOLE)
    assert {each.name for each in fields(Status)} <= told.keys()
    for name, first in FIRST_NAMES.items():
        assert told[first] == told[name]


def test_status_and_stop_print_the_keys_of_the_page(place: Path):
    stopped = {"is_answered": True, "motion": "tracks", "ms": 12.0, "path": "mount"}

    def handle(request: object) -> Outcome:
        is_stop = "Stop" in str(request)
        return Outcome(ok=True, data=stopped if is_stop else status_json(WHOLE))

    with ControlServer(place, handle):
        expect_documented("status", printed("status"))
        expect_documented("stop", printed("stop"))


def test_each_command_of_the_shell_is_on_the_page(place: Path):
    verbs = [shell_verb(command) for command in COMMANDS.values() if command.shell]
    assert {"schema", "verb", "ok", "message"} == set.union(*(keys_of(verb) for verb in verbs))
    with ControlServer(place, lambda _request: Outcome(ok=True, message="done")):
        expect_documented("hold", printed("hold"))


def test_keys_with_units_stand_beside_the_first_ones_at_every_depth(capsys):
    emit_json({"ra": 1.0, "frames": [{"x": 2.0, "box": (0, 1, 2, 3)}], "nis": float("nan")})
    assert json.loads(capsys.readouterr().out) == {
        "schema": SCHEMA,
        "ra": 1.0,
        "ra_icrs_deg": 1.0,
        "frames": [{"x": 2.0, "x_px": 2.0, "box": [0, 1, 2, 3], "box_px": [0, 1, 2, 3]}],
        "nis": None,
    }


def test_what_one_record_has_of_another_is_a_key_too(capsys):
    from rsoconsole.night import recorded_figures

    emit_json(recorded_figures([]))
    printed = json.loads(capsys.readouterr().out)
    assert {"updates", "frames", "is_nis_sound", "log_likelihood_mean"} <= printed.keys()


def test_detections_and_solutions_are_as_on_the_page(capsys):
    from rsoconsole.pipeline import detections_report, solved_report

    seen: Detection = straight_detection()
    found = Detections(frame_id=1, width_px=64, height_px=48, detections=(seen,))
    emit_json(detections_report("a.fits", found))
    frame = Frame(frame_id=1, name="a.fits", pixels=np.zeros((48, 64), np.uint16))
    emit_json(solved_report("a.fits", NotSolved(frame_id=1, reason="7 stars", ms=3.0), frame))
    detect, solve = map(json.loads, capsys.readouterr().out.splitlines())
    expect_documented("detect", detect)
    expect_documented("solve", solve)
    assert detect["detections"][0]["length_px"] == detect["detections"][0]["length"]
