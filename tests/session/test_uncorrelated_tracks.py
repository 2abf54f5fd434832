"""Tracks that no catalogue explains: kept, and recognised on later nights; others are not."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.engine.tasks.session_log import keep_uncorrelated, read_earlier_tracks
from rsoconsole.orbits import ElementSet, correlate_tracks, mid_track_direction_and_rates
from rsoconsole.pipeline import keep_unknown_tracks
from rsoconsole.pipeline.orbits._naming import TrackIdentifier
from rsoconsole.records import Identified
from rsoconsole.session import SessionWriter, ledger_path, read_ledger
from rsoconsole.words import NS_PER_DAY
from tests.bench.bench_ledger import kept_of
from tests.cli.test_cli_orbit import write_track
from tests.pages.json_page import expect_documented
from tests.truth.seen_satellites import DAYTONA, SHARED, geostationary, instants, seen

DAY_S = 86_400.0
STRANGER = geostationary(90001, -60.0, e=3e-4, i_deg=0.06)
OTHER = geostationary(90002, -58.0, i_deg=0.4, perigee_deg=120.0)
FAR = geostationary(90003, -70.0, name="CATALOGUED")


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    (tmp_path / "none.toml").write_text("")


@pytest.fixture
def tle(tmp_path: Path) -> Path:
    """A catalogue that knows neither of them."""
    path = tmp_path / "catalogue.tle"
    path.write_text(f"{FAR.name}\n{FAR.line_1}\n{FAR.line_2}\n")
    return path


def night(
    folder: Path,
    days: float,
    *satellites: ElementSet,
    verdict: str | None = None,
    is_simulated: bool = False,
) -> Path:
    """A session of a quarter of an hour of each, one after another."""
    site = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
    about = {"title": folder.name, "is_simulated": is_simulated}
    writer = SessionWriter.create(folder, Config.model_validate({"site": site}), about)
    for n, each in enumerate(satellites):
        first = 1 + 100 * n
        t = instants(days * DAY_S + 1800.0 * n, 30)
        write_track(writer, first, each, t)
        if verdict is not None:
            name = Identified(
                frame_id=first + 29,
                track_id=first,
                verdict=verdict,  # type: ignore[arg-type]
                reason="",
                hint="",
                observations=30,
                catalogued=1,
                matches=(),
            )
            writer.append(name, int(t[-1]))
    writer.close()
    return folder


def run(*arguments: str | Path) -> tuple[list[dict[str, Any]], str]:
    """The objects that a verb prints, and what it says beside them."""
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return [json.loads(line) for line in done.stdout.splitlines()], done.stderr


def identify(folder: Path, tle: Path) -> dict[str, Any]:
    (report,), _ = run("identify", folder, "--tle", tle, "--keep")
    expect_documented("identify", report)
    return report


def test_a_satellite_of_no_catalogue_is_recognised_the_next_night_and_the_one_after(
    tmp_path: Path, tle: Path
) -> None:
    first = identify(night(tmp_path / "monday", 0.0, STRANGER), tle)
    assert first["verdict"] == "unknown"
    assert first["kept"] == [{"track": 1, "number": 1, "is_new": True}]
    second = identify(night(tmp_path / "tuesday", 1.0, STRANGER, OTHER), tle)
    assert [each["ledger"] and each["ledger"]["number"] for each in second["tracks"]] == [1, None]
    assert second["tracks"][0]["ledger"]["name"] == "UCT 1"
    assert second["kept"] == [
        {"track": 1, "number": 1, "is_new": False},
        {"track": 2, "number": 2, "is_new": True},
    ]
    third = identify(night(tmp_path / "wednesday", 2.0, OTHER, STRANGER), tle)
    assert [each["number"] for each in third["kept"]] == [2, 1]
    one, two = run("ledger", "list")[0]
    expect_documented("ledger list", one)
    assert [track["session"] for track in one["tracks"]] == ["monday", "tuesday", "wednesday"]
    assert [track["session"] for track in two["tracks"]] == ["tuesday", "wednesday"]
    # Three nights in one orbit know its size far better than the belief of the first.
    known = read_ledger().object_by_number(1).last.orbit
    assert known is not None
    assert known.nights == 3
    assert known.sigma_a_km < 0.5


def test_a_session_that_is_kept_twice_is_kept_once(tmp_path: Path, tle: Path) -> None:
    folder = night(tmp_path / "monday", 0.0, STRANGER, OTHER)
    before = identify(folder, tle)["kept"]
    again = identify(folder, tle)
    assert [each["number"] for each in again["kept"]] == [each["number"] for each in before]
    assert [len(each.tracks) for each in read_ledger().objects] == [1, 1]
    assert all(each["ledger"] is None for each in again["tracks"])  # it is no earlier night


def test_a_track_that_the_catalogue_names_later_is_taken_back(tmp_path: Path, tle: Path) -> None:
    folder = night(tmp_path / "monday", 0.0, STRANGER)
    identify(folder, tle)
    tle.write_text(f"{tle.read_text()}LAUNCHED\n{STRANGER.line_1}\n{STRANGER.line_2}\n")
    assert identify(folder, tle)["verdict"] == "identified"
    assert read_ledger().objects == ()


def test_one_that_is_lost_and_found_in_one_night_is_one_object(tmp_path: Path, tle: Path) -> None:
    kept = identify(night(tmp_path / "monday", 0.0, STRANGER, OTHER, STRANGER), tle)["kept"]
    assert [each["number"] for each in kept] == [1, 2, 1]


def test_a_simulated_night_fills_no_operators_ledger(tmp_path: Path, tle: Path) -> None:
    identify(night(tmp_path / "demo", 0.0, STRANGER, is_simulated=True), tle)
    assert run("ledger")[0] == []
    (only,), _ = run("ledger", "list", "--simulated")
    assert only["last"]["is_simulated"] is True
    assert read_earlier_tracks(is_simulated=True) == (None, None)


def test_an_object_is_shown_renamed_and_forgotten(tmp_path: Path, tle: Path) -> None:
    identify(night(tmp_path / "monday", 0.0, STRANGER), tle)
    (shown,), _ = run("ledger", "show", "1")
    expect_documented("ledger show", shown)
    assert shown["last"]["orbit"]["label"] == "constrained by prior"
    (named,), _ = run("ledger", "rename", "1", "west of 60")
    assert named["called"] == "west of 60"
    page = CliRunner().invoke(app, ["ledger"]).stdout
    assert "west of 60" in page
    assert max(map(len, page.splitlines())) <= 80
    second = identify(night(tmp_path / "tuesday", 1.0, STRANGER), tle)
    assert second["tracks"][0]["ledger"]["name"] == "west of 60"
    (gone,), _ = run("ledger", "forget", "1")
    expect_documented("ledger forget", gone)
    done = CliRunner().invoke(app, ["ledger", "show", "1"])
    assert done.exit_code == 1
    assert "no UCT 1" in str(done.exception)
    assert identify(night(tmp_path / "friday", 3.0, STRANGER), tle)["kept"][0]["number"] == 2


def test_two_numbers_of_one_object_are_joined(tmp_path: Path, tle: Path) -> None:
    identify(night(tmp_path / "monday", 0.0, STRANGER, OTHER), tle)
    (joined,), _ = run("ledger", "join", "2", "1")
    expect_documented("ledger join", joined)
    assert [track["track_id"] for track in joined["tracks"]] == [1, 101]
    assert [each["number"] for each in run("ledger")[0]] == [1]
    assert identify(night(tmp_path / "tuesday", 1.0, FAR, OTHER), tle)["kept"][0]["number"] == 1


def test_pages_fit_and_say_what_was_kept(tmp_path: Path, tle: Path) -> None:
    folder = night(tmp_path / "monday", 0.0, STRANGER)
    done = CliRunner().invoke(app, ["identify", str(folder), "--tle", str(tle), "--keep"])
    assert "track 1 is kept in the ledger as UCT 1, new" in done.stdout
    later = night(tmp_path / "tuesday", 1.0, STRANGER)
    done = CliRunner().invoke(app, ["identify", str(later), "--tle", str(tle)])
    assert "in the ledger: UCT 1, seen 2023-06-22" in done.stdout
    page = CliRunner().invoke(app, ["ledger", "show", "1"]).stdout
    assert "monday, track 1" in page
    assert max(map(len, (page + done.stdout).splitlines())) <= 80


def test_the_night_of_an_engine_is_kept_by_what_is_on_record(tmp_path: Path) -> None:
    keep_uncorrelated(night(tmp_path / "monday", 0.0, STRANGER, OTHER, verdict="unknown"))
    assert [each.number for each in read_ledger().objects] == [1, 2]
    keep_unknown_tracks(night(tmp_path / "tuesday", 1.0, STRANGER, verdict="ambiguous"))
    keep_unknown_tracks(night(tmp_path / "friday", 1.0, STRANGER))  # compared with no catalogue
    assert [len(each.tracks) for each in read_ledger().objects] == [1, 1]


def test_a_damaged_ledger_stops_no_night_and_is_said(tmp_path: Path, tle: Path) -> None:
    keep_uncorrelated(night(tmp_path / "monday", 0.0, STRANGER, verdict="unknown"))
    path = ledger_path()
    path.write_bytes(path.read_bytes() + b"\xffbroken\n")
    past, fault = read_earlier_tracks(is_simulated=False)
    assert past is not None
    assert fault is not None
    assert "line 3 cannot be read" in fault
    _, said = run("identify", night(tmp_path / "tuesday", 1.0, STRANGER), "--tle", tle)
    assert "line 3 cannot be read" in said
    _, said = run("identify", tmp_path / "tuesday", "--tle", tle, "--keep")
    assert "damaged-1" in said
    assert len(read_ledger().objects[0].tracks) == 2


def test_a_track_is_named_by_the_ledger_while_it_is_followed(tmp_path: Path, tle: Path) -> None:
    keep_uncorrelated(night(tmp_path / "monday", 0.0, STRANGER, verdict="unknown"))
    past, _ = read_earlier_tracks(is_simulated=False)
    site = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
    config = Config.model_validate({"site": site, "catalogue": {"tle_files": [str(tle)]}})
    random = np.random.default_rng(2)
    ours, theirs = (
        seen(each, instants(DAY_S, 20), random=random, site=DAYTONA) for each in (STRANGER, OTHER)
    )
    found = TrackIdentifier(config, past).identify_due_tracks(9, {1: ours, 2: theirs}, {1, 2})
    names = {each.track_id: each.ledger for each in found}
    assert names[2] is None
    assert names[1] is not None
    assert (names[1].number, names[1].name, names[1].is_sure) == (1, "UCT 1", True)
    assert found[0].reason.startswith("UCT 1, seen 2023-06-22: no catalogued object")
    assert all(
        each.ledger is None
        for each in TrackIdentifier(config).identify_due_tracks(9, {1: ours}, {1})
    )


def test_an_attributable_is_where_it_is_and_moves_as_it_does() -> None:
    exact, noisy = (
        mid_track_direction_and_rates(seen(OTHER, instants(0.0, 20), random=each))
        for each in (None, np.random.default_rng(4))
    )
    assert exact[0] == noisy[0]
    truth = np.array([exact[1], exact[2], *exact[3]])
    off = np.array([noisy[1], noisy[2], *noisy[3]]) - truth
    off[:2] *= 3600.0
    sigma = np.sqrt(np.diag(noisy[4]))[[0, 2, 1, 3]]
    assert np.all(np.abs(off) < 4.0 * sigma)
    assert sigma[0] < 0.5
    assert exact[3][0] == pytest.approx(15.0, abs=0.1)


def test_neighbours_in_the_belt_are_not_taken_for_one_another() -> None:
    """A third of a degree on either side, a week later, with a quarter of an hour of each."""
    before = [kept_of(1, seen(STRANGER, instants(0.0, 30), random=np.random.default_rng(1)))]
    for n, longitude in enumerate((-60.35, -59.65)):
        other = geostationary(90009, longitude, e=3e-4, i_deg=0.06)
        track = seen(other, instants(7.0 * DAY_S, 30), random=np.random.default_rng(5 + n))
        (found,) = correlate_tracks([track], DAYTONA, before)
        assert found.number is None


def test_of_two_tracks_at_once_one_object_is_one() -> None:
    before = [kept_of(1, seen(STRANGER, instants(0.0, 30), random=np.random.default_rng(1)))]
    tracks = [seen(STRANGER, instants(DAY_S, 30), random=np.random.default_rng(n)) for n in (2, 3)]
    found = correlate_tracks(tracks, DAYTONA, before)
    assert sum(each.number == 1 for each in found) <= 1
    assert sum(dict(each.candidates).get(1, 0.0) for each in found) <= 1.0 + 1e-6


@pytest.mark.nightly("a real catalogue over weeks")
@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_real_satellites_are_recognised_with_their_manoeuvres_and_no_other_is() -> None:
    from rsoconsole.orbits import parse_element_sets
    from tests.bench.bench_ledger import SITE, TLES, seen_by_sgp4, visible

    text = (TLES / "geo_3sats_history_2019_2025.tle").read_text(encoding="ascii")
    entries = parse_element_sets(text).entries
    random, right = np.random.default_rng(6), 0
    numbers = sorted({each.norad_id for each in entries})
    at = sorted(each.epoch_utc_ns for each in entries if each.norad_id == numbers[0])

    def nearest(number: int, t: int) -> Any:
        own = (each for each in entries if each.norad_id == number)
        return min(own, key=lambda each: abs(each.epoch_utc_ns - t))

    for start in at[10:90:16]:
        later = start + NS_PER_DAY + 1_000_000_000_000
        before = [kept_of(n, seen_by_sgp4(nearest(n, start), start, 20, random)) for n in numbers]
        for number in numbers:
            track = seen_by_sgp4(nearest(number, later), later, 20, random)
            (found,) = correlate_tracks([track], SITE, before)
            assert found.number in (None, number)
            right += found.number == number
    assert right >= 14
    everything = parse_element_sets(
        (TLES / "geo_all_20230622.tle").read_text(encoding="ascii")
    ).entries
    start = int(np.median([each.epoch_utc_ns for each in everything]))
    up = visible(everything, start)
    before = [kept_of(up[0].norad_id, seen_by_sgp4(up[0], start, 20, random))]
    others = random.choice(np.array(up[1:], object), 60, replace=False)
    for each in others:
        track = seen_by_sgp4(each, start + NS_PER_DAY, 20, random)
        assert correlate_tracks([track], SITE, before)[0].number is None
