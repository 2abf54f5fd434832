"""What several files of tests ask for."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

from rsoconsole.console.watches import watch
from rsoconsole.session.writing.writer import SessionWriter
from tests.fast_tier import is_slow, slow_tests
from tests.nights.record_differences import differences
from tests.rigs.seat_rig import FakeWire, written

# How fast this machine was while it did something else says nothing of the program.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--fast``."""
    parser.addoption("--fast", action="store_true", help="leave out what tests/slow.txt names")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """A file that is left out whole is not even read."""
    if not config.getoption("--fast") or collection_path.suffix != ".py":
        return None
    name = collection_path.relative_to(Path(__file__).parent).as_posix()
    return True if name in slow_tests() else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The fast tier."""
    if config.getoption("--fast"):
        slow = slow_tests()
        left = [item for item in items if is_slow(item.nodeid, slow)]
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if not is_slow(item.nodeid, slow)]


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Of two records that should be the same, the fields in which they are not."""
    return differences(left, right) if op == "==" else None


@pytest.fixture(autouse=True)
def doors_as_found() -> Iterator[None]:
    """A front door keeps what it has handed on: what a test puts in a file's place is asked for."""
    forget_handed_on()
    yield
    forget_handed_on()


def forget_handed_on() -> None:
    """Every room's names are looked up in their files again."""
    for name, module in list(sys.modules.items()):
        opener = module.__dict__.get("__getattr__") if name.startswith("rsoconsole.") else None
        if getattr(opener, "__module__", "") == "lazy_loader":
            for each in module.__dict__["__all__"]:
                found = module.__dict__.get(each)
                if not isinstance(found, ModuleType):
                    module.__dict__.pop(each, None)


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
