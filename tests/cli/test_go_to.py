"""The shell's goto takes what the console's takes, says what it understood, and never guesses."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.control import (
    AskStatus,
    ControlServer,
    Goto,
    MovePreview,
    Outcome,
    Preview,
    Request,
    Status,
    default_socket_path,
    status_json,
    to_json_types,
)
from rsoconsole.records import Site
from rsoconsole.sky import icrs_to_altaz, iso_to_utc_ns

NOW = iso_to_utc_ns("2023-06-22T05:00:00Z")
HILL = Site(latitude_deg=47.1, longitude_deg=8.5, elevation_m=620.0)


class Engine:
    """Answers as one does that may go anywhere; ``moves`` is what it was sent."""

    refusal = ""

    def __init__(self) -> None:
        self.moves: list[Goto] = []

    def __call__(self, request: Request) -> Outcome:
        command = request.command
        if isinstance(command, AskStatus):
            return Outcome(ok=True, data=status_json(Status(state="IDLE", now_utc_ns=NOW)))
        if isinstance(command, Preview):
            move = command.move
            assert isinstance(move, Goto)
            told = MovePreview(
                ra_icrs_deg=move.ra_icrs_deg,
                dec_icrs_deg=move.dec_icrs_deg,
                ra_date_deg=0.0,
                dec_date_deg=0.0,
                alt_deg=50.0,
                az_deg=180.0,
                way_deg=79.8,
                slew_s=52.0,
                margins_deg=(("altitude", 30.0),),
            )
            return Outcome(ok=True, data=to_json_types(told))
        assert isinstance(command, Goto)
        self.moves.append(command)
        return Outcome(ok=not self.refusal, message=self.refusal or "on its way")


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Engine]:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run))
    config = tmp_path / "config.toml"
    config.write_text("[site]\nlatitude_deg = 47.1\nlongitude_deg = 8.5\nelevation_m = 620\n")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    engine = Engine()
    with ControlServer(default_socket_path(), engine):
        yield engine


def goto(*words: str) -> Result:
    return CliRunner().invoke(app, ["goto", *words])


def test_altitude_and_azimuth_are_those_of_the_engines_time_and_site(engine: Engine):
    run = goto("alt 50 az 180")
    assert run.exit_code == 0, run.output
    (move,) = engine.moves
    seen = icrs_to_altaz(HILL, move.ra_icrs_deg, move.dec_icrs_deg, NOW)
    assert seen == pytest.approx((50.0, 180.0), abs=1e-6)


@pytest.mark.parametrize(
    ("words", "ra_deg"),
    [
        (["Vega"], 279.23),
        (["20.9h", "-4.8"], 313.5),
        (["20.9d", "-4.8", "--override", "sun"], 20.9),
        (["05:32:11", "-04:52:10"], 83.046),
        (["83.05", "-4.87"], 83.05),
    ],
)
def test_what_was_understood_is_said_before_it_is_sent(words, ra_deg, engine: Engine):
    run = goto(*words)
    assert run.exit_code == 0, run.output
    assert engine.moves[0].ra_icrs_deg == pytest.approx(ra_deg, abs=0.01)
    said = run.output.splitlines()
    assert said[0].startswith("understood: ")
    assert "alt 50.0 az 180.0" in said[2]
    assert said[-1] == "on its way"


def test_an_override_goes_along(engine: Engine):
    goto("alt", "50", "az", "180", "--override", "sun")
    assert engine.moves[0].override == ("sun",)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["20.9", "-4.8"], "write 20.9h or 20.9d"),
        (["banana", "1"], "no star known here"),
        (["Sun"], "no telescope is sent to the Sun"),
    ],
)
def test_what_may_be_two_things_or_is_none_moves_nothing(words, says, engine: Engine):
    run = goto(*words)
    assert run.exit_code == 2
    assert says in " ".join(run.output.replace("│", " ").split())
    assert engine.moves == []


def test_json_says_what_was_understood_and_a_refusal_is_exit_1(engine: Engine):
    engine.refusal = "altitude 3 deg is 17 below the limit of 20"
    run = goto("M31", "--json")
    assert run.exit_code == 1
    assert str(run.exception) == engine.refusal
    told = json.loads(run.stdout)
    assert (told["understood"], told["ok"], told["slew_s"]) == ("M31 of Messier's list", False, 52)
    assert told["margins_deg"] == {"altitude": 30.0}
