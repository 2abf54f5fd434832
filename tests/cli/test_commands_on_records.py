"""Each command of the pages that works on frames, nights and elements, run as it is printed.

Each night with the installed program; else one of each kind, in the process of the tests.
"""

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.config import load_config
from rsoconsole.orbits import parse_elements
from rsoconsole.pipeline import branches_of
from rsoconsole.session import (
    SessionReader,
    change_ledger,
    keep_change,
    read_element_ledger,
    read_ledger,
)
from tests.nights.light_worlds import LightWorld, record_light, sinusoid
from tests.nights.samples import SAMPLE
from tests.nights.target_night import INDEX
from tests.pages.command_house import PROGRAM, Done, House, NearHouse, Recipes, a_house
from tests.pages.command_things import (
    BELT,
    TARGET,
    TARGET_NAME,
    WIDE,
    Things,
    low_elements,
    noon_deg,
    put_slots,
    site_toml,
)
from tests.session.test_ledger import track

RECIPES = Recipes()
pytestmark = [
    pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not installed"),
    pytest.mark.timeout(300),
]
FOLLOWED = 6
"""Number of frames, each with the satellite's streak."""
UNSURE = "[detector]\ntau = 0.999\n"
"""A configuration with which no streak is sure enough."""


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> Things:
    return Things(tmp_path_factory.mktemp("things"))


THINGS: list[Things] = []
"""What the recipes put into their houses, while a test runs."""


@pytest.fixture
def house(tmp_path: Path, things: Things) -> Iterator[House]:
    THINGS[:] = [things]
    with a_house(tmp_path) as own:
        yield own


@pytest.mark.nightly("starts the program for each command")
@pytest.mark.parametrize("command", RECIPES)
def test_it_runs_as_printed(command: str, house: House) -> None:
    RECIPES[command](house, command)
    assert command in house.ran


# ---- frames ------------------------------------------------------------------------------------


@RECIPES.of("rsoconsole process night/*.fits --json", "rsoconsole process FRAME...")
def process(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night")
    done = house.run(command, {"FRAME...": "night/*.fits"} if "FRAME" in command else None)
    if "--json" not in command:
        expect_states([line.split()[1] for line in done.stdout.splitlines()])
        return
    found = done.objects
    expect_states([each["state"] for each in found])
    assert [each["measurement"] is not None for each in found] == [True] * FOLLOWED


def expect_states(states: list[str]) -> None:
    """The satellite is found in the first frame and followed while it fades."""
    assert states == ["ACQUIRE", *["TRACK"] * (FOLLOWED - 1)]


@RECIPES.of("find night -name '*.fits' | sort | rsoconsole process --files-from -")
def process_listed(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night")
    done = house.run(command)
    expect_states([line.split()[1] for line in done.stdout.splitlines()])


@RECIPES.of("find night -name '*.fits' -print0 | rsoconsole process --files-from -")
def process_zero_ended(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night" / "a folder\nwith a line's end")
    done = house.run(command)
    # In the order of the folder, which is not that of time.
    assert all(frame.name in done.stdout for frame in THINGS[0].frames)
    assert "confidence" in done.stdout


@RECIPES.of("rsoconsole process nights/* --session processed")
def process_nights(house: House, command: str) -> None:
    for night in ("monday", "tuesday"):
        THINGS[0].put_night(house.here / "nights" / night, range(4))
    house.run(command)
    made = sorted((house.here / "processed").iterdir())
    sessions = [each for each in made if (each / "session.db").exists()]
    assert [each.name for each in sessions] == ["monday", "tuesday"]
    for each in sessions:
        assert SessionReader(each).counts().frames == 4
        assert [row for row in SessionReader(each).view_rows("track") if row["step"] == "updated"]


@RECIPES.of("rsoconsole detect frame.fits --tau 0.2 --json")
def detect(house: House, command: str) -> None:
    shutil.copy(THINGS[0].frames[1], house.here / "frame.fits")
    house.configure(UNSURE)
    (streak,) = house.run(command).object["detections"]
    assert 0.2 < streak["confidence"] < 0.999
    assert streak["length"] == pytest.approx(30.0, abs=5.0)


@RECIPES.of("RSOCONSOLE_DETECTOR__TAU=0.2 rsoconsole detect frame.fits")
def detect_by_variable(house: House, command: str) -> None:
    shutil.copy(THINGS[0].frames[1], house.here / "frame.fits")
    house.configure(UNSURE)
    assert house.run(command).stdout.startswith("frame.fits: 1 streak")
    without = house.run("rsoconsole detect frame.fits").stdout
    assert without.startswith("frame.fits: 0 streaks")


@RECIPES.of(
    "rsoconsole detect FRAME...", "find night -name '*.fits' | rsoconsole detect --files-from -"
)
def detect_several(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night")
    done = house.run(command, {"FRAME...": "night/*.fits"} if "FRAME" in command else None)
    heads = sorted(line for line in done.stdout.splitlines() if line.startswith("night/"))
    assert [head.endswith(": 1 streak") for head in heads] == [True] * FOLLOWED


@RECIPES.of("rsoconsole detect mosaic.fits --extension all")
def detect_all_chips(house: House, command: str) -> None:
    THINGS[0].put_mosaic(house.here / "mosaic.fits")
    said = house.run(command).stdout
    for chip in ("SCI,1", "SCI,2"):
        assert f"mosaic.fits[{chip}]: 1 streak" in said


@RECIPES.of("rsoconsole detect night/*.fits --json | jq .detections")
def detect_for_jq(house: House, command: str) -> None:
    if shutil.which("jq") is None:
        house.program("jq", f"exec {PROGRAM.with_name('python')} -c '{JQ}' \"$1\"")
    THINGS[0].put_night(house.here / "night")
    decoder, text, lists = json.JSONDecoder(), house.run(command).stdout.strip(), []
    while text:
        one, end = decoder.raw_decode(text)
        lists.append(one)
        text = text[end:].lstrip()
    assert [len(each) for each in lists] == [1] * FOLLOWED
    assert all("confidence" in streak for each in lists for streak in each)


JQ = "import json, sys; [print(json.dumps(json.loads(row)[sys.argv[1][1:]])) for row in sys.stdin]"
"""As much of jq as the page uses, for a machine that has none."""


@RECIPES.of("rsoconsole solve frame.fits --ra 303.2 --dec 46.0 --scale 10 10.6")
def solve(house: House, command: str) -> None:
    shutil.copy(THINGS[0].wide_frame, house.here / "frame.fits")
    if not INDEX.exists():  # an answer too, which says what is missing
        said = house.run(command).stdout
        assert "not solved" in said
        assert "'rsoconsole index install" in said
        return
    house.data.mkdir(parents=True)
    (house.data / "index").symlink_to(INDEX)
    said = house.run(command).stdout
    assert said.startswith("frame.fits: 20:12:4")  # 303.2 deg
    scale = float(said.partition(" arcsec/px")[0].split()[-1])
    assert scale == pytest.approx(WIDE.scale_arcsec_px, rel=1e-3)


@RECIPES.of("rsoconsole solve FRAME...")
def solve_several(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night", range(2))
    lines = house.run(command, {"FRAME...": "night/*.fits"}).stdout.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert " 5.057" in line or " 5.056" in line, line  # 4 pixels of 1.264 arcsec joined


# ---- orbits and names --------------------------------------------------------------------------


@RECIPES.of("rsoconsole orbit sessions/intelsat-14 --out intelsat-14.tle")
def orbit(house: House, command: str) -> None:
    THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    done = house.run(command)
    assert "constrained by prior" in done.stdout
    (found,) = parse_elements((house.here / "intelsat-14.tle").read_text(encoding="ascii"))
    assert float(found.line_2[52:63]) == pytest.approx(1.0027, abs=2e-4)


@RECIPES.of("rsoconsole orbit SESSION-or-FILE...")
def orbit_of_several(house: House, command: str) -> None:
    session = THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    house.run("rsoconsole export SESSION --format F", {"SESSION": str(session), "F": "udl"})
    (messages,) = (session / "branches" / "exports").iterdir()
    done = house.run(command, {"SESSION-or-FILE...": f"sessions/intelsat-14 {messages}"})
    assert "intelsat-14, intelsat-14" in done.stdout
    assert "constrained by prior" in done.stdout


@RECIPES.of(
    "rsoconsole identify sessions/intelsat-14 --tle catalogue.tle",
    "rsoconsole identify SESSION-or-FILE --tle FILE",
)
def identify(house: House, command: str) -> None:
    THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    shutil.copy(BELT, house.here / "catalogue.tle")
    named = {"SESSION-or-FILE": "sessions/intelsat-14", "FILE": "catalogue.tle"}
    said = house.run(command, named if "FILE" in command else None).stdout
    assert "intelsat-14: identified" in said
    assert f"{TARGET_NAME} ({TARGET}) is" in said


@RECIPES.of(
    "rsoconsole identify --field night/*.fits --tle catalogue.tle",
    "rsoconsole identify --field FRAME... --tle FILE",
)
def identify_field(house: House, command: str) -> None:
    THINGS[0].put_night(house.here / "night", range(1, 3))
    shutil.copy(BELT, house.here / "catalogue.tle")
    house.configure(site_toml())
    named = {"FRAME...": "night/*.fits", "FILE": "catalogue.tle"}
    said = house.run(command, named if "FRAME" in command else None).stdout
    assert said.count(TARGET_NAME) >= 2, said


@RECIPES.of("rsoconsole passes --tle active.tle --top 45", "rsoconsole passes --tle FILE")
def passes(house: House, command: str) -> None:
    (house.here / "active.tle").write_text(low_elements(), encoding="ascii")
    house.configure(site_toml(noon_deg()))
    said = house.run(command, {"FILE": "active.tle"} if "FILE" in command else None).stdout
    shown = [line for line in said.splitlines() if " LOW 70" in line]
    assert shown, said
    least_deg = 45.0 if "--top" in command else 30.0
    assert min(float(line.split()[4]) for line in shown) >= least_deg - 0.5


@RECIPES.of(
    "rsoconsole crossings --at 313.7 -4.8 --field 1.5 --tle active.tle",
    "rsoconsole crossings --at RA DEC --field DEG --tle FILE",
)
def crossings(house: House, command: str) -> None:
    (house.here / "active.tle").write_text(low_elements(), encoding="ascii")
    house.configure(site_toml(noon_deg()))
    named = {"RA": "313.7", "DEC": "-4.8", "DEG": "40", "FILE": "active.tle"}
    said = house.run(command, named if "FILE" in command else None).stdout
    assert "about RA 313.700 Dec -4.800" in said, said
    if "FILE" in command:
        assert " LOW 70" in said, said


@RECIPES.of(
    "rsoconsole calibrate-time night --rinex BRDC00IGS.rnx --write",
    "rsoconsole calibrate-time NIGHT... --rinex FILE",
)
def calibrate_time(house: House, command: str) -> None:
    THINGS[0].put_navigation(house.here, "night")
    named = {"NIGHT...": "night", "FILE": "BRDC00IGS.rnx"}
    said = house.run(command, named if "NIGHT" in command else None).stdout
    bias = next(line for line in said.splitlines() if line.startswith("  bias "))
    assert 120.0 < float(bias.split()[1]) < 154.0, said  # 137 ms in truth
    if "--write" not in command:
        assert not house.config.exists()
        return
    (known,) = load_config(house.config, environ={}).exposure.calibrated
    assert known.bias_s == pytest.approx(0.137, abs=0.017)


@RECIPES.of(
    "rsoconsole calibrate-elements night-1 night-2 --tle all.tle",
    "rsoconsole calibrate-elements [NIGHT...]",
)
def calibrate_elements(house: House, command: str) -> None:
    put_slots(house.here, "night-1", "night-2")
    if "[" in command:
        house.configure(f'[catalogue]\ntle_files = ["{house.here / "all.tle"}"]\n')
    said = house.run(command, {"[NIGHT...]": "night-1 night-2"} if "[" in command else None).stdout
    assert "geosynchronous orbits: 6 tracks of 3 objects" in said
    rows = read_element_ledger(house.state / "elements.jsonl").rows
    assert len(rows) == 6
    # They stand 0.01 deg of the belt ahead.
    assert all(abs(each.along_km) == pytest.approx(7.36, abs=0.3) for each in rows)


@RECIPES.of("rsoconsole lightcurve NIGHT --json", "rsoconsole lightcurve SESSION")
def lightcurve(house: House, command: str) -> None:
    record_light(house.here / "bright", LightWorld(light=sinusoid(90.0), frames=25))
    done = house.run(command, {"NIGHT" if "--json" in command else "SESSION": "bright"})
    if "--json" in command:
        assert done.object["period"]["period_s"] == pytest.approx(90.0, rel=0.01)
    else:
        assert "\nperiod " in done.stdout


# ---- the ledger --------------------------------------------------------------------------------


def with_ledger(house: House) -> Path:
    """Two objects are kept, UCT 7 and UCT 9."""
    path = house.state / "ledger.jsonl"
    both = [keep_change(7, track("monday")), keep_change(9, track("tuesday"))]
    change_ledger(lambda _: both, path)
    return path


@RECIPES.of("rsoconsole ledger")
def ledger(house: House, command: str) -> None:
    with_ledger(house)
    said = house.run(command).stdout
    assert "UCT 7" in said
    assert "UCT 9" in said


@RECIPES.of("rsoconsole ledger list --json")
def ledger_list(house: House, command: str) -> None:
    with_ledger(house)
    assert [each["number"] for each in house.run(command).objects] == [7, 9]


@RECIPES.of("rsoconsole ledger show 7")
def ledger_show(house: House, command: str) -> None:
    with_ledger(house)
    said = house.run(command).stdout
    assert "UCT 7" in said
    assert "monday" in said


@RECIPES.of('rsoconsole ledger rename 7 "drifter near 60W"')
def ledger_rename(house: House, command: str) -> None:
    path = with_ledger(house)
    house.run(command)
    assert read_ledger(path).object_by_number(7).called == "drifter near 60W"


@RECIPES.of("rsoconsole ledger join 9 7")
def ledger_join(house: House, command: str) -> None:
    path = with_ledger(house)
    house.run(command)
    (only,) = read_ledger(path).objects
    assert [each.session for each in only.tracks] == ["monday", "tuesday"]


@RECIPES.of("rsoconsole ledger forget 7")
def ledger_forget(house: House, command: str) -> None:
    path = with_ledger(house)
    house.run(command)
    assert [each.number for each in read_ledger(path).objects] == [9]


# ---- the morning after -------------------------------------------------------------------------


@RECIPES.of("rsoconsole what-if sessions/intelsat-14 --q 4 --r 0.5 --save calmer")
def what_if_saved(house: House, command: str) -> None:
    session = THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    house.run(command)
    (branch,) = branches_of(session)
    assert branch.name == "calmer"
    assert branch.changes == {"filter.q_multiplier": 4.0, "filter.r_multiplier": 0.5}


@RECIPES.of("rsoconsole what-if sessions/intelsat-14 --propose", "rsoconsole what-if SESSION...")
def what_if(house: House, command: str) -> None:
    THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    done = house.run(command, {"SESSION...": "sessions/intelsat-14"} if "..." in command else None)
    assert "NIS" in done.stdout, done.stdout


@RECIPES.of("rsoconsole export sessions/intelsat-14 --format tdm --norad 36097 --out -")
def export_message(house: House, command: str) -> None:
    THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    done = house.run(command)
    expect_message(done)
    assert str(TARGET) in done.stdout


@RECIPES.of("rsoconsole export SESSION --format tdm --out - | less")
def export_to_pager(house: House, command: str) -> None:
    if shutil.which("less") is None:
        pytest.skip("needs less")
    THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    expect_message(house.run(command, {"SESSION": "sessions/intelsat-14"}))


def expect_message(done: Done) -> None:
    """A CCSDS TDM of the night's angles."""
    assert done.stdout.startswith("CCSDS_TDM_VERS")
    assert done.stdout.count("ANGLE_1 = ") > 20


@RECIPES.of("rsoconsole export SESSION --format F")
def export_table(house: House, command: str) -> None:
    session = THINGS[0].put_session(house.here / "sessions" / "intelsat-14")
    done = house.run(command, {"SESSION": "sessions/intelsat-14", "F": "csv"})
    (table,) = (session / "branches" / "exports").glob("*.csv")
    assert table.name in done.stdout
    measured = {row["frame_id"] for row in SessionReader(SAMPLE).view_rows("measurements")}
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert 20 < len(rows) <= len(measured)
    assert {int(row["frame_id"]) for row in rows} <= measured


@RECIPES.of(
    "rsoconsole figures ~/.local/share/rsoconsole/sessions/NIGHT --format pdf",
    "rsoconsole figures SESSION",
)
def figures(house: House, command: str) -> None:
    session = THINGS[0].put_session(house.data / "sessions" / "monday")
    house.environment["MPLCONFIGDIR"] = str(THINGS[0].fonts)  # looking for fonts takes long
    is_pdf = "pdf" in command
    done = house.run(command, {"NIGHT": "monday"} if is_pdf else {"SESSION": str(session)})
    drawn = [Path(line) for line in done.stdout.splitlines()]
    assert len(drawn) >= 4
    for each in drawn:
        assert each.parent == session / "branches" / "figures"
        assert each.read_bytes().startswith(b"%PDF" if is_pdf else b"\x89PNG")


@pytest.mark.parametrize(
    "command",
    # Several nights are shared out to processes.
    [each for each in RECIPES.one_of_each() if "nights/*" not in each],
)
def test_one_of_each_kind_runs_in_this_process(
    command: str, tmp_path: Path, things: Things
) -> None:
    THINGS[:] = [things]
    house = NearHouse(tmp_path)
    RECIPES[command](house, command)
    assert command in house.ran
