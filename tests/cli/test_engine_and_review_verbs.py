"""What the verbs that go on for hours hand over: to the engine, to the console, to a review.

That they really run is shown by ``test_commands_at_the_telescope.py`` each night.
"""

from pathlib import Path
from typing import Any

import pytest

from rsoconsole.session import SessionReader
from rsoconsole.simulator import scenario_named
from tests.pages.command_things import pass_over
from tests.rigs.in_process import run_here


class Called:
    """In the place of what a verb starts: how it was called."""

    def __init__(self, returned: Any = None) -> None:
        self.arguments: tuple[Any, ...] = ()
        self.options: dict[str, Any] = {}
        self._returned = returned

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        self.arguments, self.options = arguments, options
        return self._returned


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Called:
    called = Called()
    monkeypatch.setattr("rsoconsole.engine.service.service.run_engine", called)
    return called


@pytest.fixture
def console(monkeypatch: pytest.MonkeyPatch) -> Called:
    called = Called("leave")
    monkeypatch.setattr("rsoconsole.console.run_console", called)
    return called


@pytest.fixture
def review(monkeypatch: pytest.MonkeyPatch) -> Called:
    called = Called()
    monkeypatch.setattr("rsoconsole.console.run_review", called)
    return called


def done(*words: str | Path) -> str:
    """What is said on stderr by a verb that ends well."""
    run = run_here(*words)
    assert run.returncode == 0, run.stderr
    assert run.stdout == ""
    return run.stderr


def test_an_engine_waits_to_be_armed(engine: Called, tmp_path: Path) -> None:
    done("engine", "--session", tmp_path / "night", "--frames", "7")
    config, settings = engine.arguments
    assert not settings.is_armed
    assert (settings.session, settings.frames) == (tmp_path / "night", 7)
    assert not config.leap.enabled


def test_an_engine_is_armed_at_once_with_the_configuration_that_is_named(
    engine: Called, tmp_path: Path
) -> None:
    (tmp_path / "config.toml").write_text("[site]\nlatitude_deg = 47.0\n", encoding="utf-8")
    done("engine", "--config", tmp_path / "config.toml", "--arm", "--override", "disk")
    config, settings = engine.arguments
    assert settings.is_armed
    assert settings.lifted == {"disk"}
    assert config.site.latitude_deg == 47.0


def test_an_engine_waits_for_a_pass(engine: Called, tmp_path: Path) -> None:
    tle = tmp_path / "active.tle"
    tle.write_text(pass_over(scenario_named("ses-10").t_start_utc_ns), encoding="ascii")
    done("engine", "--pass", "25544", "--tle", tle)
    config, settings = engine.arguments
    assert not settings.is_armed
    assert (config.leap.enabled, config.leap.pass_norad) == (True, 25544)
    assert config.catalogue.tle_files == (tle,)


def test_elements_without_a_pass_are_wrong_usage(engine: Called, tmp_path: Path) -> None:
    run = run_here("engine", "--tle", tmp_path / "active.tle")
    assert run.returncode == 2
    assert "--tle belongs to --pass" in run.stderr
    assert engine.arguments == ()


def test_the_console_is_that_of_the_usual_engine(console: Called) -> None:
    assert done("console") == ""
    assert console.options["socket"] is None
    assert console.options["session"] is None
    assert console.options["read_only"] is False
    assert console.options["stop_directly"].__name__ == "stop_without_engine"


def test_a_review_begins_where_that_is_asked_for(review: Called, tmp_path: Path) -> None:
    done("review", tmp_path, "--at", "12")
    assert review.arguments == (tmp_path,)
    assert review.options["start"] == "12"
    assert review.options["stop_directly"].__name__ == "stop_without_engine"
    review.arguments = ()
    assert run_here("review", tmp_path, "--at", "noon").returncode == 2
    assert review.arguments == ()


def test_the_sample_is_a_session_of_ones_own(
    review: Called, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RSOCONSOLE_SESSION__ROOT", str(tmp_path / "sessions"))
    done("review", "--sample")
    (own,) = review.arguments
    assert own.parent == tmp_path / "sessions"
    assert SessionReader(own).counts().frames == 36


def test_a_review_finds_a_session_by_its_name(
    review: Called, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RSOCONSOLE_SESSION__ROOT", str(tmp_path))
    (tmp_path / "monday").mkdir()
    done("review", "monday")
    assert review.arguments == (tmp_path / "monday",)
