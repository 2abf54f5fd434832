"""The night's passes against skyfield's own search, from the same elements; and the verb."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import Config, LimitsConfig
from rsoconsole.orbits import CatalogueEntry, parse_element_sets
from rsoconsole.pipeline import NightPass, night_passes
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S
from tests.console.test_up_now import LOW, with_checksums
from tests.pages.json_page import expect_documented
from tests.truth.seen_satellites import SHARED

MIX = SHARED / "tles" / "mix_20230622.tle"
FROM, UNTIL = iso_to_utc_ns("2023-06-22T01:00:00Z"), iso_to_utc_ns("2023-06-22T09:00:00Z")
SITES = (
    Config().site.to_site(),
    Site(latitude_deg=64.1, longitude_deg=-21.9, elevation_m=30.0),
    Site(latitude_deg=-33.9, longitude_deg=18.5, elevation_m=200.0),
)
LIMIT_DEG = 25.0

needs_elements = pytest.mark.skipif(not MIX.exists(), reason="independent elements not there")


def found_by_us(
    entries: list[CatalogueEntry], site: Site, limits: LimitsConfig, *, is_low_only: bool = True
) -> list[NightPass]:
    every = night_passes(entries, site, (FROM, UNTIL), limits, is_low_only=is_low_only)
    return [each for _, some, _ in every for each in some]


def found_by_skyfield(entry: CatalogueEntry, site: Site) -> list[tuple[float, float, float, float]]:
    """Rise, top and set in seconds after the beginning, and the altitude of the top."""
    from skyfield.api import EarthSatellite, load, wgs84

    scale = load.timescale(builtin=True)
    satellite = EarthSatellite.from_satrec(entry.record, scale)
    place = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)
    first, last = scale.utc(2023, 6, 22, 1), scale.utc(2023, 6, 22, 9)
    times, kinds = satellite.find_events(place, first, last, altitude_degrees=LIMIT_DEG)
    seconds = [(each - first) * 86_400.0 for each in times]
    passes = []
    for n in np.flatnonzero(kinds == 0):
        if n + 2 < len(kinds) and kinds[n + 1] == 1 and kinds[n + 2] == 2:
            top = float((satellite - place).at(times[n + 1]).altaz()[0].degrees)
            passes.append((seconds[n], seconds[n + 1], seconds[n + 2], top))
    return passes


@needs_elements
@pytest.mark.parametrize("site", SITES, ids=("Florida", "Iceland", "Cape"))
def test_every_pass_is_found_where_skyfield_finds_it_and_no_other(site: Site) -> None:
    entries = [e for e in parse_element_sets(MIX.read_text()).entries if e.revolutions_a_day > 9.0]
    limits = LimitsConfig(min_altitude_deg=LIMIT_DEG)
    ours: dict[int, list[NightPass]] = {}
    for each in found_by_us(entries, site, limits):
        if each.rise.t_utc_ns > FROM and each.set.t_utc_ns < UNTIL - 2 * NS_PER_S:
            ours.setdefault(each.norad_id, []).append(each)
    count = 0
    for entry in entries:
        theirs = found_by_skyfield(entry, site)
        own = ours.get(entry.norad_id, [])
        # One that stays above for seconds lies between two of skyfield's own looks, or ours.
        theirs = [each for each in theirs if each[2] - each[0] > 20.0]
        own = [each for each in own if each.set.t_utc_ns - each.rise.t_utc_ns > 20 * NS_PER_S]
        assert len(own) == len(theirs), entry.name
        for one, (rise, top, set_, altitude) in zip(own, theirs, strict=True):
            count += 1
            for corner, seconds in ((one.rise, rise), (one.top, top), (one.set, set_)):
                assert (corner.t_utc_ns - FROM) / NS_PER_S == pytest.approx(seconds, abs=1.5)
            assert one.top.alt_deg == pytest.approx(altitude, abs=0.3)
            assert one.rise.alt_deg == pytest.approx(LIMIT_DEG, abs=0.3)
    assert count > 5


@pytest.fixture
def kernel() -> Iterator[Any]:
    """Where the Sun is."""
    import skyfield_data
    from skyfield.api import load_file

    found = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    yield found
    found.close()


@needs_elements
def test_how_fast_it_is_and_whether_it_is_lit_are_skyfields(kernel: Any) -> None:
    from skyfield.api import EarthSatellite, load, wgs84

    scale = load.timescale(builtin=True)
    site = SITES[0]
    place = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)
    entries = [e for e in parse_element_sets(MIX.read_text()).entries if e.revolutions_a_day > 9.0]
    by_number = {each.norad_id: each for each in entries}
    found = found_by_us(entries, site, LimitsConfig(min_altitude_deg=LIMIT_DEG))
    assert {each.lit_from_utc_ns is None for each in found} == {True, False}
    for one in found:
        satellite = EarthSatellite.from_satrec(by_number[one.norad_id].record, scale)
        t = one.top.t_utc_ns / NS_PER_S - iso_to_utc_ns("2023-06-22T00:00:00Z") / NS_PER_S
        at = scale.utc(2023, 6, 22, 0, 0, np.array([t - 0.5, t + 0.5]))
        ra, dec, distance = (satellite - place).at(at).radec()
        off = (ra.radians[1] - ra.radians[0]) * np.cos(dec.radians[0])
        rate = np.degrees(np.hypot(off, dec.radians[1] - dec.radians[0])) * 3600.0
        assert one.rate_arcsec_s == pytest.approx(rate, rel=0.02)
        assert one.range_km == pytest.approx(distance.km.mean(), rel=0.01)
        looks = np.arange(one.rise.t_utc_ns, one.set.t_utc_ns, 10 * NS_PER_S)
        s = (looks - iso_to_utc_ns("2023-06-22T00:00:00Z")) / NS_PER_S
        is_lit = satellite.at(scale.utc(2023, 6, 22, 0, 0, s)).is_sunlit(kernel)
        if one.lit_from_utc_ns is None:
            assert is_lit.sum() <= 6  # a minute
        elif is_lit.any():
            first = looks[np.flatnonzero(is_lit)[0]]
            assert abs(one.lit_from_utc_ns - first) <= 71 * NS_PER_S


def test_a_horizon_mask_cuts_a_pass_and_one_under_way_begins_with_the_span() -> None:
    entries = list(parse_element_sets(with_checksums(LOW)).entries)
    site = SITES[0]
    plain = found_by_us(entries, site, LimitsConfig(min_altitude_deg=10.0))
    assert plain
    wall = ((0.0, 10.0), (plain[0].rise.az_deg - 20.0, 10.0), (plain[0].rise.az_deg, 30.0))
    wall = (*wall, (plain[0].rise.az_deg + 20.0, 10.0))
    masked = LimitsConfig(min_altitude_deg=10.0, horizon=tuple(sorted(each for each in wall)))
    cut = found_by_us(entries, site, masked)
    assert cut[0].rise.t_utc_ns > plain[0].rise.t_utc_ns
    assert cut[0].set.t_utc_ns == plain[0].set.t_utc_ns
    middle = plain[0].top.t_utc_ns
    span = (middle, middle + 3600 * NS_PER_S)
    limits = LimitsConfig(min_altitude_deg=10.0)
    ((_, (rest, *_), _),) = night_passes(entries, site, span, limits)
    assert rest.rise.t_utc_ns - middle < 2 * NS_PER_S
    assert rest.set.t_utc_ns == pytest.approx(plain[0].set.t_utc_ns, abs=2 * NS_PER_S)


def test_what_cannot_rise_there_is_not_looked_at_and_none_is_an_answer() -> None:
    equatorial = with_checksums(LOW).replace("  51.6400", "   5.0000")
    entries = list(parse_element_sets(with_checksums(equatorial)).entries)
    assert list(night_passes(entries, SITES[1], (FROM, UNTIL), LimitsConfig())) == [(1, (), ())]


def passes(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["passes", *words])
    assert done.exit_code == code, done.output
    return done.output + ("" if done.exception is None else str(done.exception))


@pytest.fixture
def elements(tmp_path: Path) -> Path:
    path = tmp_path / "iss.tle"
    path.write_text(with_checksums(LOW), encoding="ascii")
    return path


def test_the_verb_lists_them_in_order_and_scripts_have_them_as_json(elements: Path) -> None:
    words = ("--tle", str(elements), "--at", "2023-06-22T01:00:00Z", "--hours", "24", "--top", "10")
    lines = passes(*words, "--all").splitlines()
    rows = [json.loads(each) for each in passes(*words, "--all", "--json").splitlines()]
    assert lines[0].startswith(f"{len(rows)} passes from 2023-06-22 01:00 to 2023-06-23 01:00Z")
    assert all("25544 ISS (ZARYA)" in each for each in lines[2:])
    assert all(len(each) <= 80 for each in lines)
    for row in rows:
        expect_documented("passes", row)
        assert row["rise_utc"] < row["top_utc"] < row["set_utc"]
    assert [row["rise_utc"] for row in rows] == sorted(row["rise_utc"] for row in rows)
    lit = [json.loads(each) for each in passes(*words, "--json").splitlines()]
    assert [each for each in rows if each["lit_from_utc"]] == lit


def test_the_verb_says_what_is_wrong(elements: Path, tmp_path: Path) -> None:
    assert "no catalogue" in passes(code=1)
    assert "no elements of 7" in passes("--tle", str(elements), "--norad", "7", code=1)
    assert "is not a time" in passes("--tle", str(elements), "--at", "soon", code=2)
    config = tmp_path / "c.toml"
    config.write_text("[site]\nlatitude_deg = 68.0\nlongitude_deg = 20.0\n", encoding="ascii")
    bright = ("--tle", str(elements), "--config", str(config), "--at", "2023-06-22T01:00:00Z")
    assert "say how long with --hours" in passes(*bright, code=1)
    none = passes("--tle", str(elements), "--at", "2023-06-22T01:00:00Z", "--top", "89.9")
    assert none.startswith("no pass from 2023-06-22 01:00")


BAD = """BADSAT
1 25545U 98067A   24001.50000000  .00016717  00000-0  10270-3 0  9009
2 25545  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532430803
"""
# So low and dragged that it comes down within a day of its epoch.
DOWN = with_checksums(
    LOW.replace("ISS (ZARYA)", "COMES DOWN")
    .replace("25544", "25546")
    .replace(" 18000-3", " 99999-1")
    .replace("15.50000000", "16.40000000")
)


def both(*words: str, code: int = 0) -> tuple[str, str]:
    """What the verb prints, and what it says on stderr or as its error."""
    done = CliRunner().invoke(app, ["passes", *words])
    assert done.exit_code == code, done.output
    error = "" if done.exception is None else str(done.exception)
    return done.stdout, " ".join(f"{done.stderr} {error}".split())


def test_a_bad_set_is_named_and_the_others_are_listed(elements: Path, tmp_path: Path) -> None:
    when = ("--at", "2023-06-22T01:00:00Z", "--hours", "24", "--top", "10", "--all")
    alone, _ = both("--tle", str(elements), *when)
    path = tmp_path / "onebad.tle"
    path.write_text(f"{BAD}{elements.read_text()}", encoding="ascii")
    listed, said = both("--tle", str(path), *when)
    assert listed == alone
    assert f"1 of 2 element sets is not used: {path}, line 2: checksum '9' should be 0" in said
    *rows, last = map(json.loads, both("--tle", str(path), *when, "--json")[0].splitlines())
    assert rows
    expect_documented("passes, not used", last)
    (bad,) = last["not_used"]
    assert (bad["norad_id"], bad["name"], bad["place"]) == (25545, "BADSAT", "line 2")
    _, why = both("--tle", str(path), "--norad", "25545", code=1)
    assert "no elements of 25545" in why
    assert "checksum '9' should be 0" in why


def test_an_object_without_a_place_is_named_and_not_said_to_stay_below(
    elements: Path, tmp_path: Path
) -> None:
    when = ("--at", "2023-07-22T01:00:00Z", "--hours", "24", "--all", "--top", "0")
    path = tmp_path / "down.tle"
    path.write_text(DOWN, encoding="ascii")
    listed, said = both("--tle", str(path), *when, code=1)
    assert listed == ""
    assert "no object can be propagated there: COMES DOWN (25546): SGP4 has no place" in said
    listed, said = both("--tle", str(path), "--tle", str(elements), *when)
    assert "ISS (ZARYA)" in listed
    assert "1 object with a place at no time: COMES DOWN (25546)" in said
    words = both("--tle", str(path), "--tle", str(elements), *when, "--json")[0].splitlines()
    (lost,) = json.loads(words[-1])["not_used"]
    assert lost["norad_id"] == 25546
