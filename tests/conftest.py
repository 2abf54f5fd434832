"""What several files of tests ask for."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from rsoconsole.console import watch
from rsoconsole.session.writer import SessionWriter
from tests.record_differences import differences
from tests.seat_rig import FakeWire, written

# How fast this machine was while it did something else says nothing of the program.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Of two records that should be the same, the fields in which they are not."""
    return differences(left, right) if op == "==" else None


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Rescue sessions, locks of mounts and logs outlive a night: they stay out of the home."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="module")
def told_night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A night of twenty frames, closed."""
    writer = written(tmp_path_factory.mktemp("console") / "night")
    writer.close()
    return writer.folder


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[SessionWriter]:
    """A night that goes on; a test that asks for it is shown that one."""
    writer = written(tmp_path / "night")
    yield writer
    writer.close()


@pytest.fixture
def impatient_seat(monkeypatch: pytest.MonkeyPatch) -> None:
    """Watches that look often, a pilot that does not sleep."""
    monkeypatch.setattr(watch, "READ_S", 0.03)
    monkeypatch.setattr(watch, "ASK_S", 0.03)
    monkeypatch.setattr(watch, "CLOSED_CHECK_S", 0.1)
    # How long the pilot sleeps before it looks whether the program is idle.
    monkeypatch.setattr("textual._wait.SLEEP_GRANULARITY", 0.008)
    monkeypatch.setattr("textual._wait.SLEEP_IDLE", 0.004)


@pytest.fixture
def wire(request: pytest.FixtureRequest, impatient_seat: None) -> FakeWire:
    """An engine in the middle of a told night."""
    if "writer" in request.fixturenames:
        return FakeWire(request.getfixturevalue("writer").folder)
    return FakeWire(request.getfixturevalue("told_night"))
