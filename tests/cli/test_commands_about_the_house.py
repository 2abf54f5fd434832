"""Each command of the pages about configuration, catalogue, sessions, service: run as printed.

Each night with the installed program, else in the process of the tests.
"""

import json
import shlex
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.config import Config, load_config
from rsoconsole.instruments import list_index_files
from rsoconsole.instruments.solver.index_files import shipped_index_dir
from rsoconsole.session import SessionReader, archive_session, verify_session
from rsoconsole.session.files import upkeep_log
from tests.children.bad_server import BadServer, bad_server, send
from tests.nights.target_night import INDEX
from tests.pages.command_house import PROGRAM, House, NearHouse, Recipes, a_house
from tests.pipeline.test_catalogue_update import GOOD
from tests.rigs.session_rig import NOW_UTC_NS, cut_off, make

RECIPES = Recipes()
pytestmark = [
    pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not installed"),
    pytest.mark.timeout(300),
]


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    with a_house(tmp_path) as own:
        yield own


@pytest.mark.parametrize("command", RECIPES)
def test_it_runs_in_this_process(command: str, tmp_path: Path) -> None:
    house = NearHouse(tmp_path)
    RECIPES[command](house, command)
    assert command in house.ran


@pytest.mark.nightly("starts the program for each command")
@pytest.mark.parametrize("command", RECIPES)
def test_it_runs_as_printed(command: str, house: House) -> None:
    RECIPES[command](house, command)
    assert command in house.ran


# ---- configuration -----------------------------------------------------------------------------


@RECIPES.of("rsoconsole config init")
def config_init(house: House, command: str) -> None:
    assert str(house.config) in house.run(command).stdout
    assert load_config(house.config, environ={}) == Config()
    assert "latitude_deg" in house.config.read_text(encoding="utf-8")


@RECIPES.of("rsoconsole config show")
def config_show(house: House, command: str) -> None:
    house.configure("[detector]\ntau = 0.25\n")
    house.environment["RSOCONSOLE_SITE__LATITUDE_DEG"] = "51.5"
    rows = {line.split()[0]: line.split()[1:3] for line in house.run(command).stdout.splitlines()}
    assert rows["detector.tau"] == ["0.25", "file"]
    assert rows["site.latitude_deg"] == ["51.5", "RSOCONSOLE_SITE__LATITUDE_DEG"]


@RECIPES.of("rsoconsole config check --config night.toml")
def config_check_file(house: House, command: str) -> None:
    (house.here / "night.toml").write_text("[site]\nlatitude_deg = 47.0\n", encoding="utf-8")
    assert "night.toml: the configuration is sound" in house.run(command).stdout


@RECIPES.of("rsoconsole config check")
def config_check(house: House, command: str) -> None:
    house.configure("[site]\nlatitude_deg = 47.0\n")
    assert f"{house.config}: the configuration is sound" in house.run(command).stdout


# ---- index files -------------------------------------------------------------------------------


@RECIPES.of("rsoconsole index list")
def index_list(house: House, command: str) -> None:
    said = house.run(command).stdout
    for file in list_index_files([shipped_index_dir()]):
        assert str(file.path) in said
    assert said.splitlines()[-1] == "your field needs scales 8, 9, 10"


@RECIPES.of("rsoconsole index install --from /usr/share/astrometry")
def index_install_from(house: House, command: str) -> None:
    shutil.copytree(shipped_index_dir(), house.inside("/usr/share/astrometry"), dirs_exist_ok=True)
    house.run(command)
    installed = list_index_files([house.data / "index"])
    assert [each.scale for each in installed] == [8, 9, 10]
    assert all(each.is_healthy for each in installed)


@RECIPES.of("rsoconsole index install")
def index_install(house: House, command: str) -> None:
    if not INDEX.exists():
        pytest.skip(f"{INDEX} is not here: without it this would ask the network for them")
    house.data.mkdir(parents=True)
    (house.data / "index").symlink_to(INDEX)
    lines = house.run(command).stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["8", "9", "10"]


# ---- elements ----------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def server() -> Iterator[BadServer]:
    with bad_server() as running:
        SERVERS[:] = [running]
        yield running


SERVERS: list[BadServer] = []
"""Where the recipes' elements come from and messages go to, while a test runs."""


def sources_of(house: House, *sources: str) -> None:
    """A configuration that fetches from here."""
    SERVERS[0].default = send(GOOD)
    house.configure(
        f'[catalogue]\ncelestrak_url = "{SERVERS[0].url}"\nsources = {json.dumps(sources)}\n'
    )


@RECIPES.of("rsoconsole catalogue add supgp:intelsat celestrak:geo")
def catalogue_add(house: House, command: str) -> None:
    sources_of(house)
    assert "not fetched yet" in house.run(command).stdout
    catalogue = load_config(house.config, environ={}).catalogue
    assert catalogue.sources == ("supgp:intelsat", "celestrak:geo")
    assert catalogue.tle_files, "the cache is read from now on"
    assert SERVERS[0].asked == [], "nothing is fetched unasked"


@RECIPES.of("rsoconsole catalogue add SOURCE")
def catalogue_add_file(house: House, command: str) -> None:
    sources_of(house)
    (house.here / "mine.json").write_bytes(GOOD)
    assert "2 objects" in house.run(command, {"SOURCE": "mine.json"}).stdout


@RECIPES.of("rsoconsole catalogue update")
def catalogue_update(house: House, command: str) -> None:
    sources_of(house, "celestrak:geo")
    assert house.run(command).stdout.startswith("new  celestrak:geo")
    assert [path.partition("?")[2] for path in SERVERS[0].asked] == ["GROUP=geo&FORMAT=json"]
    # Within two hours nothing is asked for again.
    assert house.run(command).stdout.startswith("-    celestrak:geo")
    assert len(SERVERS[0].asked) == 1


@RECIPES.of("rsoconsole catalogue list --json", "rsoconsole catalogue list")
def catalogue_list(house: House, command: str) -> None:
    sources_of(house, "celestrak:geo")
    house.run("rsoconsole catalogue update")
    done = house.run(command)
    if "--json" in command:
        assert (done.object["source"], done.object["objects"]) == ("celestrak:geo", 2)
    else:
        assert "celestrak:geo" in done.stdout
        assert "2 objects" in done.stdout


@RECIPES.of("rsoconsole alerts test")
def alerts_test(house: House, command: str) -> None:
    url = SERVERS[0].url
    SERVERS[0].default = send(b"{}")
    service = url.replace("http://", "json://")
    house.configure(f'[alerts]\nservices = ["{service}"]\nheartbeat_url = "{url}/beat"\n')
    said = house.run(command).stdout
    assert [line.split()[0] for line in said.splitlines()] == ["ok", "ok"]
    assert sorted(SERVERS[0].asked) == ["/", "/beat"]
    assert any(b"a test: word reaches you" in body for body in SERVERS[0].bodies)


# ---- sessions ----------------------------------------------------------------------------------


@RECIPES.of("rsoconsole sessions --root /media/usb/sessions")
def sessions_on_a_disk(house: House, command: str) -> None:
    make(house.inside("/media/usb") / "sessions" / "monday")
    expect_listed(house.run(command).stdout, "monday")


@RECIPES.of("rsoconsole sessions")
def sessions(house: House, command: str) -> None:
    make(house.data / "sessions" / "monday")
    expect_listed(house.run(command).stdout, "monday")


def expect_listed(said: str, *names: str) -> None:
    """Under a heading one line a session."""
    assert [line.split()[-1] for line in said.splitlines()[1:]] == list(names)


@RECIPES.of("rsoconsole sessions list --json")
def sessions_list(house: House, command: str) -> None:
    folder = make(house.data / "sessions" / "monday")
    found = house.run(command).object
    assert (found["folder"], found["frames"]) == (str(folder), 4)


@RECIPES.of("rsoconsole sessions verify NIGHT NIGHT.tar")
def sessions_verify(house: House, command: str) -> None:
    folder = make(house.here / "monday")
    archive_session(folder, house.here, NOW_UTC_NS, remove=False)
    said = house.run(command, {"NIGHT": "monday"}).stdout
    assert "monday: sound" in said
    assert "monday.tar: sound" in said


@RECIPES.of("rsoconsole sessions repair NIGHT")
def sessions_repair(house: House, command: str) -> None:
    folder = make(house.here / "monday")
    cut_off(folder)
    assert not SessionReader(folder).read_meta()["is_closed"]
    house.run(command, {"NIGHT": "monday"})
    assert SessionReader(folder).read_meta()["is_closed"]
    assert verify_session(folder).is_sound


@RECIPES.of("rsoconsole sessions archive NIGHT --out /media/usb --remove")
def sessions_archive(house: House, command: str) -> None:
    folder = make(house.here / "monday")
    assert "the original is removed" in house.run(command, {"NIGHT": "monday"}).stdout
    assert not folder.exists()
    with tarfile.open(house.inside("/media/usb") / "monday.tar") as packed:
        assert any(name.endswith("session.db") for name in packed.getnames())


@RECIPES.of("rsoconsole sessions prune --keep-days 30 --keep-last 5 --free 20")
def sessions_prune(house: House, command: str) -> None:
    root = house.data / "sessions"
    for n in range(7):
        make(root / f"night-{n}", frames=1)
    said = house.run(command).stdout.splitlines()
    # Which of the two older ones goes is a matter of how full the disk is: shown, and not done.
    assert sum("one of the last 5" in line for line in said) == 5
    assert "would go" in said[-1]
    assert all(list((root / f"night-{n}" / "frames").iterdir()) for n in range(7))


@RECIPES.of('rsoconsole sessions keep NIGHT --why "first light"')
def sessions_keep(house: House, command: str) -> None:
    folder = make(house.here / "monday")
    assert "monday: kept" in house.run(command, {"NIGHT": "monday"}).stdout
    assert "first light" in (folder / upkeep_log.KEEP).read_text(encoding="utf-8")


# ---- the service -------------------------------------------------------------------------------


def with_systemd(house: House) -> Path:
    """Stand-ins that write down what they were told, and answer as a live systemd; that record."""
    told = house.folder / "told"
    house.program(
        "systemctl",
        f'echo "$@" >> {shlex.quote(str(told))}\n'
        'case "$2" in is-enabled) echo enabled;; is-active) echo active;; esac',
    )
    house.program("systemd-run", "exit 0")
    house.configure("[site]\nlatitude_deg = 47.0\n")
    return told


def unit_of(house: House) -> Path:
    return house.home / ".config" / "systemd" / "user" / "rsoconsole.service"


@RECIPES.of("rsoconsole service show")
def service_show(house: House, command: str) -> None:
    with_systemd(house)
    unit = house.run(command).stdout
    assert f'ExecStart="{PROGRAM}" "engine" "--config" "{house.config}"' in unit.splitlines()


@RECIPES.of(
    "rsoconsole service install --config ~/.config/rsoconsole/config.toml",
    "rsoconsole service install",
)
def service_install(house: House, command: str) -> None:
    told = with_systemd(house)
    house.run(command)
    assert f'"engine" "--config" "{house.config}"' in unit_of(house).read_text(encoding="utf-8")
    assert told.read_text().splitlines()[0] == "--user daemon-reload"


@RECIPES.of("rsoconsole service status --json")
def service_status(house: House, command: str) -> None:
    with_systemd(house)
    house.run("rsoconsole service install")
    row = house.run(command).object
    assert (row["installed"], row["active"], row["unit"]) == (True, "active", str(unit_of(house)))


@RECIPES.of("rsoconsole service remove")
def service_remove(house: House, command: str) -> None:
    told = with_systemd(house)
    house.run("rsoconsole service install")
    house.run(command)
    assert not unit_of(house).exists()
    assert "--user disable --now rsoconsole.service" in told.read_text().splitlines()
