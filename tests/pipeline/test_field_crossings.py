"""Crossings of fields against a brute search by skyfield, from the same elements; and the verb."""

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skyfield_data
from astropy.coordinates import SkyCoord
from astropy.time import Time
from skyfield.nutationlib import iau2000b_radians
from typer.testing import CliRunner

import rsoconsole as rso
from rsoconsole import simulator
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.orbits import CatalogueEntry, object_places, parse_element_sets
from rsoconsole.pipeline import FieldCrossing, FieldPoint, RoundField, field_crossings
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S, utc_ns_to_iso
from tests.console.test_up_now import LOW, with_checksums
from tests.orbits.test_places import skyfield_timescale
from tests.pages.json_page import expect_documented
from tests.truth.seen_satellites import SHARED

TLES = SHARED / "tles"
BELT = Path(simulator.__file__).parent / "data" / "belt_20230622.tle"
FROM = iso_to_utc_ns("2023-06-22T03:00:00Z")
HOURS = 6.0
SPAN = (FROM, FROM + round(HOURS * 3600e9))
SITES = (
    Config().site.to_site(),
    Site(latitude_deg=64.1, longitude_deg=-21.9, elevation_m=30.0),
    Site(latitude_deg=-33.9, longitude_deg=18.5, elevation_m=200.0),
)
LOOK_S, FINE_S = 20.0, 0.1

needs_elements = pytest.mark.skipif(not TLES.exists(), reason="independent elements not there")


def crossings(
    entries: tuple[CatalogueEntry, ...], field: RoundField, span: tuple[int, int] = SPAN
) -> list[FieldCrossing]:
    return [each for some in field_crossings(entries, field, span) for each in some.crossings]


class Judge:
    """Places of satellites by skyfield: light time, and the Earth's motion in it."""

    def __init__(self, entries: tuple[CatalogueEntry, ...], site: Site) -> None:
        from skyfield.api import EarthSatellite, load_file, wgs84

        # Skyfield leaves out the motion of the pole, up to 15 m, unless it is given.
        self.scale = skyfield_timescale(FROM)
        self.planets = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
        earth = self.planets["earth"]
        self.local = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)
        self.place = earth + self.local
        self.satellites = {
            each.norad_id: EarthSatellite.from_satrec(each.record, self.scale) for each in entries
        }
        self.targets = {number: earth + each for number, each in self.satellites.items()}
        self.looks_s = np.arange(0.0, HOURS * 3600.0 + 1.0, LOOK_S)
        self.seen = self.lines_of(tuple(self.targets), self.looks_s)

    def lines_of(self, numbers: tuple[int, ...], seconds: np.ndarray) -> dict[int, np.ndarray]:
        """Unit vectors (N, 3) of each at seconds after the beginning."""
        place = self.place.at(self.at(seconds))
        seen = {each: place.observe(self.targets[each]).position.km for each in numbers}
        return {each: (km / np.linalg.norm(km, axis=0)).T for each, km in seen.items()}

    def lines(self, number: int, seconds: np.ndarray) -> np.ndarray:
        return self.lines_of((number,), seconds)[number]

    def at(self, seconds: np.ndarray) -> Any:
        return self.scale.utc(2023, 6, 22, 3, 0, seconds)

    def altitude_deg(self, number: int, seconds: np.ndarray) -> np.ndarray:
        geometric = (self.satellites[number] - self.local).at(self.at(seconds))
        return np.asarray(geometric.altaz()[0].degrees)

    def crossings(self, number: int, field: RoundField) -> list[tuple[float, float]]:
        """Seconds of entering and leaving, of each crossing that lasts more than a blink."""
        centre, radius_deg = direction(field), field.diameter_deg / 2.0
        seen = self.seen[number]
        a, b = seen[:-1], seen[1:]
        along = np.clip(
            np.sum((centre - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1), 0.0, 1.0
        )
        nearest_deg = beside_deg(a + along[:, None] * (b - a), centre)
        bent_deg = 0.3 + 0.1 * beside_deg(a, b)
        parts = [
            np.arange(self.looks_s[n], self.looks_s[n] + LOOK_S + FINE_S / 2.0, FINE_S)
            for n in np.flatnonzero(nearest_deg <= radius_deg + bent_deg)
        ]
        if not parts:
            return []
        seconds = np.unique(np.round(np.concatenate(parts), 3))
        offset_deg = beside_deg(self.lines(number, seconds), centre)
        is_in = (offset_deg <= radius_deg) & (self.altitude_deg(number, seconds) > 0.0)
        is_next = np.diff(seconds) < 2.0 * FINE_S
        found, start = [], None
        for n, inside in enumerate(is_in):
            if inside and (start is None):
                start = float(seconds[n])
            if start is not None and (not inside or n + 1 == len(is_in) or not is_next[n]):
                last = float(seconds[n if inside else n - 1])
                found.append((start, last))
                start = None
        return [each for each in found if each[1] - each[0] > 3.0 * FINE_S]


def direction(field: RoundField) -> np.ndarray:
    ra, dec = np.radians([field.ra_icrs_deg, field.dec_icrs_deg])
    return np.array([np.cos(ra) * np.cos(dec), np.sin(ra) * np.cos(dec), np.sin(dec)])


def beside_deg(lines: np.ndarray, centre: np.ndarray) -> np.ndarray:
    unit = lines / np.linalg.norm(lines, axis=-1, keepdims=True)
    return np.degrees(2.0 * np.arcsin(np.clip(np.linalg.norm(unit - centre, axis=-1) / 2.0, 0, 1)))


def compare(entries: tuple[CatalogueEntry, ...], site: Site, seed: int, count: int) -> int:
    """Compare ``count`` random fields; return how many crossings there were."""
    draw = np.random.default_rng(seed)
    judge = Judge(entries, site)
    with closing(judge.planets):
        return sum(compare_one(judge, entries, site, draw) for _ in range(count))


def compare_one(
    judge: Judge, entries: tuple[CatalogueEntry, ...], site: Site, draw: np.random.Generator
) -> int:
    compared = 0
    # Half of them where satellites are: about places of the judge's own.
    some = judge.seen[int(draw.choice(list(judge.seen)))]
    x, y, z = some[draw.integers(len(some))] if draw.random() < 0.8 else draw.normal(size=3)
    field = RoundField(
        site=site,
        ra_icrs_deg=float(np.degrees(np.arctan2(y, x)) % 360.0),
        dec_icrs_deg=float(np.degrees(np.arctan2(z, np.hypot(x, y)))),
        diameter_deg=float(np.exp(draw.uniform(np.log(0.2), np.log(8.0)))),
    )
    ours = crossings(entries, field)
    for number in judge.targets:
        mine = [each for each in ours if each.norad_id == number]
        theirs = judge.crossings(number, field)
        compared += len(theirs)
        agree(judge, field, mine, theirs)
    return compared


def agree(
    judge: Judge, field: RoundField, ours: list[FieldCrossing], theirs: list[tuple[float, float]]
) -> None:
    def seconds(each: FieldPoint) -> float:
        return (each.t_utc_ns - FROM) / NS_PER_S

    for first, last in theirs:
        middle = 0.5 * (first + last)
        assert any(seconds(e.enter) <= middle <= seconds(e.leave) for e in ours), (field, first)
    for each in ours:
        points = each.enter, each.nearest, each.leave
        at = np.array([seconds(point) for point in points])
        lines = judge.lines(each.norad_id, at)
        mine = np.stack([direction_of(point) for point in points])
        assert np.all(3600.0 * beside_deg(lines, mine) < 1.0)
        edge_deg = beside_deg(lines, direction(field)) - field.diameter_deg / 2.0
        altitude_deg = judge.altitude_deg(each.norad_id, at)
        assert np.all(altitude_deg > -0.01)
        assert np.allclose(altitude_deg, [point.alt_deg for point in points], atol=0.01)
        for end in (0, 2):
            is_end = min(at[end], HOURS * 3600.0 - at[end]) < 1e-3
            is_cut = is_end or abs(altitude_deg[end]) < 0.01
            assert abs(edge_deg[end]) < 0.002 or (is_cut and edge_deg[end] < 0.01)
        assert edge_deg[1] < 0.0
        assert abs(each.offset_deg - edge_deg[1] - field.diameter_deg / 2.0) < 1.0 / 3600.0
        beside = [(first, last) for first, last in theirs if first <= at[2] and at[0] <= last]
        assert len(beside) == 1 or at[2] - at[0] < 5.0 * FINE_S
        for first, last in beside:
            assert abs(first - at[0]) < 0.5
            assert abs(last - at[2]) < 0.5


def direction_of(point: FieldPoint) -> np.ndarray:
    ra, dec = np.radians([point.ra_icrs_deg, point.dec_icrs_deg])
    return np.array([np.cos(ra) * np.cos(dec), np.sin(ra) * np.cos(dec), np.sin(dec)])


@pytest.fixture(autouse=True)
def quick_nutation(monkeypatch: pytest.MonkeyPatch) -> None:
    """A milliarcsecond from skyfield's full series, and thirty times as fast."""
    monkeypatch.setattr("skyfield.timelib.iau2000a_radians", iau2000b_radians)


@needs_elements
def test_crossings_are_those_of_a_brute_search_by_skyfield() -> None:
    entries = parse_element_sets((TLES / "mix_20230622.tle").read_bytes()).entries[::3]
    assert compare(entries, SITES[0], 5, 12) > 5


@pytest.mark.nightly
@needs_elements
@pytest.mark.parametrize("site", SITES)
def test_crossings_of_200_fields_are_those_of_a_brute_search(site: Site) -> None:
    entries = parse_element_sets((TLES / "mix_20230622.tle").read_bytes()).entries
    assert compare(entries, site, 11, 67) > 100


def test_the_verb_and_the_function_list_what_crosses() -> None:
    belt = BELT
    entry = next(
        each for each in parse_element_sets(belt.read_bytes()).entries if each.norad_id == 36097
    )
    middle_ns = (SPAN[0] + SPAN[1]) // 2
    place = object_places(entry, Config().site.to_site(), np.array([middle_ns]))
    ra, dec = float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0])
    asked = ["crossings", "--at", f"{ra:.5f}", f"{dec:.5f}", "--field", "1", "--hours", "6"]
    where = ["--from", "2023-06-22T03:00:00Z", "--tle", str(belt)]
    printed = CliRunner().invoke(app, [*asked, *where, "--json"]).stdout.splitlines()
    reports = {each["norad_id"]: each for each in map(json.loads, printed)}
    found = reports[36097]
    expect_documented("crossings", found)
    # Among the stars it moves by 15 arcsec/s through the whole of the field.
    assert abs(iso_to_utc_ns(found["nearest_utc"]) - middle_ns) < NS_PER_S
    assert found["offset_deg"] < 1e-4
    assert found["duration_s"] == pytest.approx(3600.0 / found["rate_arcsec_s"], rel=1e-3)
    assert found["motion_deg"] == pytest.approx(90.0, abs=3.0)
    shown = CliRunner().invoke(app, [*asked, *where]).stdout
    assert shown.startswith(f"{len(reports)} crossing")
    assert "36097 INTELSAT" in shown
    table = rso.crossings(
        SkyCoord(ra, dec, unit="deg"), 1.0, start=Time("2023-06-22T03:00:00"), duration=6, tle=belt
    )
    assert set(table["norad_id"]) == set(reports)
    (row,) = table[table["norad_id"] == 36097]
    assert row["sigma"].to_value("s") == pytest.approx(found["sigma_s"])
    assert row["nearest"].separation(SkyCoord(ra, dec, unit="deg")).deg < 1e-4


def test_objects_without_a_place_are_named() -> None:
    """A low object whose drag brings it down within the hours asked for, and one that stays."""
    falls = with_checksums(LOW.replace(" 18000-3 ", " 99999+1 ").replace("25544", "25545"))
    entries = parse_element_sets(falls + "\n" + with_checksums(LOW)).entries
    field = RoundField(site=SITES[0], ra_icrs_deg=10.0, dec_icrs_deg=0.0, diameter_deg=1.0)
    (lost,) = (each for some in field_crossings(entries, field, SPAN) for each in some.lost)
    assert lost.norad_id == 25545
    # It falls within the hours: that is not an element set that cannot be used.
    assert not lost.is_always
    assert SPAN[0] <= lost.from_utc_ns < lost.until_utc_ns <= SPAN[1]
    assert f"% of the time, from {utc_ns_to_iso(lost.from_utc_ns)[:10]}" in lost.words
    after = (lost.until_utc_ns - 600 * NS_PER_S, SPAN[1])
    (always,) = (each for some in field_crossings(entries, field, after) for each in some.lost)
    assert always.is_always
