"""``--wait``: an order's verb returns when the mount is measured to have done it, or why not."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.cli.telescope import waiting
from rsoconsole.control import (
    AskStatus,
    ControlServer,
    Goto,
    LastStop,
    MovePreview,
    Outcome,
    Park,
    Preview,
    Request,
    Status,
    default_socket_path,
    status_json,
    to_json_types,
)
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S

NOW = iso_to_utc_ns("2023-06-22T05:00:00Z")
VEGA = (279.2347, 38.7837)
"""Where the mount is told to go, not quite Vega: it looks beside where it is told."""
BEFORE: dict[str, Any] = {"state": "IDLE", "is_parked": False, "mount_motion": "tracks"}
SLEWS: dict[str, Any] = {"is_slewing": True, "mount_motion": "unknown"}
MOVES: dict[str, Any] = {"is_slewing": True, "mount_motion": "moves", "mount_rate_deg_s": 3.0}
THERE: dict[str, Any] = {
    "is_slewing": False,
    "mount_motion": "tracks",
    "mount_ra_icrs_deg": VEGA[0],
    "mount_dec_icrs_deg": VEGA[1],
}


class Engine:
    """Tells one status after another, a second of its own each, the last one for ever."""

    def __init__(self) -> None:
        self.before: dict[str, Any] = dict(BEFORE)
        self.then: list[dict[str, Any]] = []
        self.answer = Outcome(ok=True, message="the mount parks")
        self.orders: list[Request] = []
        self.looks = 0

    def __call__(self, request: Request) -> Outcome:
        command = request.command
        if isinstance(command, AskStatus):
            return Outcome(ok=True, data=status_json(self.status()))
        if isinstance(command, Preview):
            assert isinstance(command.move, Goto)
            ra, dec = command.move.ra_icrs_deg, command.move.dec_icrs_deg
            told = MovePreview(
                ra_icrs_deg=ra,
                dec_icrs_deg=dec,
                ra_date_deg=0.0,
                dec_date_deg=0.0,
                alt_deg=50.0,
                az_deg=180.0,
                way_deg=79.8,
                slew_s=52.0,
            )
            return Outcome(ok=True, data=to_json_types(told))
        self.orders.append(request)
        if isinstance(command, Goto):
            where = {"command_ra_icrs_deg": VEGA[0], "command_dec_icrs_deg": VEGA[1]}
            return Outcome(ok=self.answer.ok, message=self.answer.message, data=where)
        return self.answer

    def status(self) -> Status:
        now_ns = NOW + self.looks * NS_PER_S
        self.looks += 1
        told = dict(self.before)
        if self.orders and self.then:
            told |= self.then[0]
            if len(self.then) > 1:
                self.then.pop(0)
        fields = {"mount_ra_icrs_deg": 10.0, "mount_dec_icrs_deg": 10.0, "holder": "nobody"}
        return Status(
            **{**fields, "now_utc_ns": now_ns, "mount_t_utc_ns": now_ns, "pid": 7, **told}
        )


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Engine]:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run))
    config = tmp_path / "config.toml"
    config.write_text("[mount]\nslew_timeout_s = 30.0\n")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    monkeypatch.setattr(waiting, "LOOK_S", 0.005)
    engine = Engine()
    with ControlServer(default_socket_path(), engine):
        yield engine


def rsoconsole(*words: str) -> Result:
    return CliRunner().invoke(app, words)


GOTO = ("goto", "Vega", "--wait")
PARK, UNPARK = ("park", "--wait"), ("unpark", "--wait")


@pytest.mark.parametrize(
    ("words", "before", "then", "says"),
    [
        (GOTO, {}, [SLEWS, MOVES, MOVES, THERE], "arrived: it tracks, measured"),
        (GOTO, {}, [THERE | {"mount_motion": "stands"}], "arrived: it stands, measured"),
        # Its driver is busy for ever, or never: the measured motion counts.
        (GOTO, {}, [MOVES, THERE | {"is_slewing": True}], "arrived: it tracks, measured"),
        (
            GOTO,
            {},
            [MOVES | {"is_slewing": False}, MOVES | {"is_slewing": False}, THERE],
            "arrived: it tracks, measured",
        ),
        # It pauses between two axes, and stops a little short once.
        (GOTO, {}, [MOVES, *[BEFORE] * 5, MOVES, THERE], "arrived: it tracks, measured"),
        (
            GOTO,
            {},
            [MOVES, THERE | {"mount_motion": "unknown"}],
            "arrived, by its driver's word: how it moves is not known",
        ),
        (
            PARK,
            {},
            [MOVES, MOVES, {"is_parked": True, "mount_motion": "stands"}],
            "parked: it stands, measured",
        ),
        # Refused at first, it was told again.
        (
            PARK,
            {},
            [*[BEFORE] * 30, MOVES, {"is_parked": True, "mount_motion": "stands"}],
            "parked: it stands, measured",
        ),
        (
            PARK,
            {},
            [MOVES, {"is_parked": True, "mount_motion": "unknown"}],
            "parked, by its driver's word: how it moves is not known",
        ),
        (
            UNPARK,
            {"is_parked": True},
            [{"is_parked": True}, {"is_parked": False, "mount_motion": "stands"}],
            "released: it stands, measured",
        ),
    ],
)
def test_it_returns_when_the_mount_is_measured_to_have_done_it(
    words: tuple[str, ...], before, then, says: str, engine: Engine
):
    engine.before |= before
    engine.then = [*then]
    run = rsoconsole(*words)
    assert run.exit_code == 0, run.exception
    assert run.output.splitlines()[-2:] == [engine.answer.message, says]
    assert len(engine.then) == 1, "not before the end"


STOPPED = {"last_stop": LastStop(by="console b", t_utc_ns=NOW + 1), "mount_motion": "stands"}


@pytest.mark.parametrize(
    ("words", "then", "says"),
    [
        (GOTO, [MOVES, STOPPED], "not arrived: STOP by console b; the mount: stands, measured"),
        (
            GOTO,
            [MOVES, BEFORE | {"mount_alt_deg": 50.0, "mount_az_deg": 170.0}],
            "not arrived: the mount at alt 50.0 az 170.0: tracks, measured",
        ),
        (GOTO, [MOVES, MOVES | {"holder": "autonomy", "state": "SEARCH"}], "another order came"),
        (GOTO, [MOVES, {"state": "FAULT", "faults": ("no cable",)}], "not arrived: FAULT no cable"),
        (GOTO, [MOVES, MOVES | {"pid": 8}], "another engine runs now"),
        (GOTO, [MOVES], "not arrived in 90 s: the mount: slewing"),
        (
            PARK,
            [MOVES, {"is_parked": True, "mount_motion": "tracks"}],
            "not parked: the mount: parked, but it tracks, measured",
        ),
        (PARK, [MOVES, MOVES | {"state": "MANUAL"}], "another order came (MANUAL)"),
        (PARK, [MOVES, BEFORE], "not parked: the mount: tracks, measured"),
        (
            UNPARK,
            [{"is_parked": False, "mount_motion": "moves", "mount_rate_deg_s": 3.2}],
            "not released: the mount: moves at 3.2 deg/s, measured",
        ),
    ],
)
def test_what_kept_the_mount_from_it_is_said_and_it_exits_1(
    words: tuple[str, ...], then, says: str, engine: Engine
):
    engine.then = [*then]
    run = rsoconsole(*words)
    assert run.exit_code == 1
    assert says in str(run.exception)


def test_an_earlier_stop_ends_no_waiting(engine: Engine):
    engine.before["last_stop"] = LastStop(by="console a", t_utc_ns=NOW - 9)
    engine.then = [MOVES, THERE]
    assert rsoconsole(*GOTO).exit_code == 0


def test_what_the_mount_reported_before_the_order_counts_for_nothing(engine: Engine):
    engine.then = [THERE | {"mount_t_utc_ns": NOW - NS_PER_S}]
    run = rsoconsole(*GOTO)
    assert "not arrived in 90 s" in str(run.exception)


@pytest.mark.parametrize("words", [GOTO, PARK, UNPARK])
def test_a_refusal_is_not_waited_behind(words: tuple[str, ...], engine: Engine):
    engine.answer = Outcome(ok=False, message="the mount refused to: home first")
    run = rsoconsole(*words)
    assert (run.exit_code, str(run.exception)) == (1, engine.answer.message)


@pytest.mark.parametrize(
    ("words", "then"),
    [(GOTO, THERE), (PARK, {"is_parked": True, "mount_motion": "stands"}), (GOTO, STOPPED)],
)
def test_json_is_one_object_at_the_end(words: tuple[str, ...], then, engine: Engine):
    engine.then = [MOVES, then]
    run = rsoconsole(*words, "--json")
    told = json.loads(run.stdout)
    is_stopped = then is STOPPED
    assert (told["verb"], told["ok"]) == (words[0], not is_stopped)
    assert told["message"].startswith("not arrived: STOP" if is_stopped else ("arrived", "parked"))
    assert run.exit_code == int(is_stopped)


@pytest.mark.parametrize(
    "is_given", [lambda: rsoconsole("park"), lambda: rsoconsole("goto", "Vega")]
)
def test_without_it_the_answer_is_the_engines(is_given: Callable[[], Result], engine: Engine):
    run = is_given()
    assert run.output.splitlines()[-1] == "the mount parks"
    assert len(engine.orders) == 1
    assert isinstance(engine.orders[0].command, Park | Goto)


def test_other_orders_have_no_such_option():
    assert rsoconsole("hold", "--wait").exit_code == 2
