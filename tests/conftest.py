"""What several files of tests ask for."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

from rsoconsole.console.watches import watch
from rsoconsole.session import SessionWriter
from tests import durations
from tests.nights.record_differences import differences
from tests.rigs.seat_rig import FakeWire, written

# How fast this machine was while it did something else says nothing of the program.
settings.register_profile("plain", deadline=None, derandomize=True, max_examples=50)
settings.register_profile("nightly", deadline=None)

TOOK = durations.read()
FAST = durations.fast_files(TOOK)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The tiers."""
    parser.addoption("--fast", action="store_true", help="only the files with the quickest tests")
    parser.addoption("--all", action="store_true", help="also what is marked nightly")
    parser.addoption("--part", metavar="K/N", help="of what is nightly alone, the K-th of N parts")
    parser.addoption(
        "--write-durations", action="store_true", help="put on record what each file takes"
    )


def pytest_configure(config: pytest.Config) -> None:
    """What Hypothesis draws is new each night, and the same for every change in between.

    With ``--write-durations`` the process that hears of all tests notes them.
    """
    is_nightly = config.getoption("--all") or config.getoption("--part")
    settings.load_profile("nightly" if is_nightly else "plain")
    if config.getoption("--write-durations") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(_Durations())


class _Durations:
    """Notes what each test takes, with what is set up for it."""

    def __init__(self) -> None:
        self._took: dict[str, durations.NodeTook] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        before = self._took.get(report.nodeid)
        self._took[report.nodeid] = durations.NodeTook(
            report.duration + (before.seconds if before else 0.0), "nightly" in report.keywords
        )

    def pytest_sessionfinish(self) -> None:
        durations.write(self._took)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """The fast tier does not even read the other files."""
    if not config.getoption("--fast") or not collection_path.name.startswith("test_"):
        return None
    name = collection_path.relative_to(durations.HERE).as_posix()
    return True if name in TOOK and name not in FAST else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The slowest files first; what is nightly waits for ``--all``, or for its file's name."""
    part, does_all = config.getoption("--part"), config.getoption("--all")

    def seconds_of(path: Path) -> float:
        took = TOOK.get(path.relative_to(durations.HERE).as_posix()) or durations.Took()
        of_plain = 0.0 if part else took.seconds
        return of_plain + (took.nightly_s if part or does_all else 0.0)

    items.sort(key=lambda item: -seconds_of(item.path))
    nightly = {item for item in items if item.get_closest_marker("nightly")}
    if part:
        files = durations.part(part, {item.path for item in nightly}, seconds_of)
        run = {item for item in nightly if item.path in files}
    elif does_all:
        return
    else:
        named = {Path(each.partition("::")[0]).resolve() for each in config.args if ".py" in each}
        run = {item for item in items if item not in nightly or item.path in named}
    config.hook.pytest_deselected(items=[item for item in items if item not in run])
    items[:] = [item for item in items if item in run]


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


SETTINGS = [name for name in os.environ if name.startswith("RSOCONSOLE_") and "WRITE" not in name]
HOMES = {
    "HOME": "home",
    "XDG_CONFIG_HOME": "home/.config",
    "XDG_DATA_HOME": "home/.local/share",
    "XDG_STATE_HOME": "home/.local/state",
    "XDG_CACHE_HOME": "home/.cache",
    "XDG_RUNTIME_DIR": "run",
}


def set_homes(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """A user's folders of one's own: empty, whatever this machine's user has installed."""
    for name, place in HOMES.items():
        (folder / place).mkdir(mode=0o700, parents=True, exist_ok=True)
        patch.setenv(name, str(folder / place))


@pytest.fixture(scope="session", autouse=True)
def files_homes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """For what files of tests set up once."""
    with pytest.MonkeyPatch.context() as patch:
        # matplotlib reads all fonts of the machine where it finds no list of them.
        patch.setenv("MPLCONFIGDIR", str(durations.HERE.parent / ".cache" / "matplotlib"))
        set_homes(patch, tmp_path_factory.mktemp("user"))
        yield


@pytest.fixture(autouse=True)
def own_homes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """For each test, and none of the settings of who runs it."""
    with pytest.MonkeyPatch.context() as patch:
        set_homes(patch, tmp_path_factory.mktemp("u"))
        for name in SETTINGS:
            patch.delenv(name, raising=False)
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
