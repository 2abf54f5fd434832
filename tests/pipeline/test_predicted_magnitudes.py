"""How bright passes and crossings will be, where distance, phase and shadow are skyfield's."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.time import Time
from typer.testing import CliRunner

import rsoconsole as rso
from rsoconsole import simulator
from rsoconsole.cli.app import app
from rsoconsole.config import LimitsConfig
from rsoconsole.orbits import StandardMagnitude, parse_element_sets
from rsoconsole.pipeline import (
    FieldCrossing,
    NightPass,
    RoundField,
    VisibleSatellite,
    field_crossings,
    night_passes,
    predicted_magnitude,
    visible_satellites,
)
from rsoconsole.records import Site
from rsoconsole.session import element_ledger_path, replace_session_rows
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S
from tests.console.test_up_now import LOW, with_checksums
from tests.orbits.test_element_fit import row
from tests.pages.json_page import expect_documented
from tests.truth.lit_sphere import lambert_mag, sphere_by_skyfield

BELT = Path(simulator.__file__).parent / "data" / "belt_20230622.tle"
FROM = iso_to_utc_ns("2023-06-22T01:00:00Z")
SPAN = (FROM, FROM + 24 * 3600 * NS_PER_S)
SITES = (
    Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0),
    Site(latitude_deg=-33.9, longitude_deg=18.5, elevation_m=200.0),
)
STANDARD = StandardMagnitude(mag=2.4, sigma_mag=0.3)
ISS = with_checksums(LOW)


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    (tmp_path / "none.toml").write_text("")


def agree(
    one: NightPass | FieldCrossing | VisibleSatellite, t_utc_ns: int, site: Site, record: Any
) -> bool | None:
    """Compare with skyfield; return whether it is lit, None within seconds of the shadow's edge."""
    about = t_utc_ns + np.array([-15, 0, 15]) * NS_PER_S
    seen = sphere_by_skyfield(record, site, about)
    assert one.range_km == pytest.approx(seen.range_km[1], rel=1e-3)
    assert one.phase_deg == pytest.approx(seen.phase_deg[1], abs=0.1)
    if len(set(seen.is_lit)) > 1:
        return None
    found = predicted_magnitude(one, {one.norad_id: STANDARD})
    assert (found is not None) == seen.is_lit[1]
    if found is not None:
        truth = lambert_mag(STANDARD.mag, seen.range_km[1], seen.phase_deg[1])
        assert found[0] == pytest.approx(truth, abs=0.02)
        assert found[1] == STANDARD.sigma_mag
    return bool(seen.is_lit[1])


def test_passes_have_skyfields_brightness_at_their_top_and_none_in_shadow() -> None:
    (entry,) = parse_element_sets(ISS).entries
    lit = []
    for site in SITES:
        for _, some, _ in night_passes([entry], site, SPAN, LimitsConfig(min_altitude_deg=10.0)):
            lit += [agree(each, each.top.t_utc_ns, site, entry.record) for each in some]
    assert lit.count(True) > 3
    assert lit.count(False) > 1


@pytest.mark.parametrize("elements", [ISS, BELT.read_text(encoding="ascii")], ids=["low", "belt"])
def test_crossings_have_it_where_they_are_nearest(elements: str) -> None:
    entries = parse_element_sets(elements).entries
    records = {each.norad_id: each.record for each in entries}
    lit = []
    for ra_deg in range(10, 360, 60):
        field = RoundField(
            site=SITES[0], ra_icrs_deg=float(ra_deg), dec_icrs_deg=-4.8, diameter_deg=60.0
        )
        for some in field_crossings(entries, field, SPAN):
            for each in some.crossings:
                at = each.nearest.t_utc_ns
                lit.append(agree(each, at, SITES[0], records[each.norad_id]))
    assert lit.count(True) > 2
    assert lit.count(False) > 0


def test_what_is_up_now_has_it_at_that_instant() -> None:
    entries = parse_element_sets(BELT.read_bytes()).entries
    records = {each.norad_id: each.record for each in entries}
    found = visible_satellites(entries, SITES[0], FROM, LimitsConfig(min_altitude_deg=15.0))
    lit = [agree(each, FROM, SITES[0], records[each.norad_id]) for each in found]
    assert lit.count(True) > 5


def test_one_of_unknown_brightness_has_none() -> None:
    (entry,) = parse_element_sets(ISS).entries
    parts = night_passes([entry], SITES[0], SPAN, LimitsConfig(min_altitude_deg=10.0))
    found = [each for _, some, _ in parts for each in some]
    assert found
    assert {predicted_magnitude(each, {7: STANDARD}) for each in found} == {None}


def keep(norad_id: int) -> None:
    """A row of the object in the user's ledger."""
    light = {"standard_mag": STANDARD.mag, "standard_mag_sigma": STANDARD.sigma_mag}
    replace_session_rows([], [replace(row(norad_id, 1.0), **light)], element_ledger_path())


def said(*words: str) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_verb_passes_predicts_by_the_ledger(tmp_path: Path) -> None:
    tle = tmp_path / "iss.tle"
    tle.write_text(ISS, encoding="ascii")
    words = ["passes", "--tle", str(tle), "--at", "2023-06-22T01:00:00Z", "--hours", "24"]
    words += ["--top", "10", "--all"]
    before = [json.loads(each) for each in said(*words, "--json").splitlines()]
    assert {each["mag"] for each in before} == {None}
    assert "mag" not in said(*words)
    keep(25544)
    rows = [json.loads(each) for each in said(*words, "--json").splitlines()]
    for each in rows:
        expect_documented("passes", each)
        if each["mag"] is not None:
            truth = lambert_mag(STANDARD.mag, each["range_km"], each["phase_deg"])
            assert each["mag"] == pytest.approx(truth)
            assert each["mag_sigma"] == 0.3
    _, header, *lines = said(*words).splitlines()
    assert header.split()[-2:] == ["mag", "name"]
    assert all(len(each) <= 80 for each in lines)
    column = header.index("mag")
    cells = [line[column - 2 : column + 3].strip() for line in lines]
    assert cells == ["" if each["mag"] is None else f"{each['mag']:.1f}" for each in rows]
    assert any(cells)
    assert all("25544" in line for line in lines)


def test_the_verb_and_the_function_crossings_predict_by_the_ledger() -> None:
    keep(36097)
    asked = ["crossings", "--at", "313.7", "-4.8", "--field", "12", "--tle", str(BELT)]
    asked += ["--from", "2023-06-22T03:00:00Z", "--hours", "6"]
    rows = [json.loads(each) for each in said(*asked, "--json").splitlines()]
    mags = {each["norad_id"]: each["mag"] for each in rows}
    assert mags.pop(36097) == pytest.approx(
        next(
            lambert_mag(STANDARD.mag, each["range_km"], each["phase_deg"])
            for each in rows
            if each["norad_id"] == 36097
        )
    )
    assert set(mags.values()) == {None}
    shown = said(*asked).splitlines()
    assert shown[1].split()[-2:] == ["mag", "name"]
    table = rso.crossings(
        SkyCoord(313.7, -4.8, unit="deg"),
        12.0,
        start=Time("2023-06-22T03:00:00"),
        duration=6,
        tle=BELT,
    )
    assert len(table) == len(rows)
    for mine, each in zip(table, rows, strict=True):
        assert mine["phase"].to_value("deg") == pytest.approx(each["phase_deg"])
        expected = np.nan if each["mag"] is None else each["mag"]
        assert mine["mag"].to_value("mag") == pytest.approx(expected, nan_ok=True)


def test_a_ledger_that_cannot_be_read_costs_only_the_magnitudes(tmp_path: Path) -> None:
    keep(25544)
    path = element_ledger_path()
    path.write_text(path.read_text().replace('"format": 1', '"format": 99'))
    tle = tmp_path / "iss.tle"
    tle.write_text(ISS, encoding="ascii")
    words = ["passes", "--tle", str(tle), "--at", "2023-06-22T01:00:00Z", "--hours", "24"]
    done = CliRunner().invoke(app, [*words, "--all", "--top", "10"])
    assert done.exit_code == 0
    assert "without magnitudes: " in done.stderr
    assert "25544" in done.stdout
