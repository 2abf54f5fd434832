"""Brightness in exports: tables, TDM, UDL, and read back from each."""

import json
import math
from pathlib import Path

import pytest

from rsoconsole.library import ExportOptions, Target, export, render
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.observed import parse_observations
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.orbits import reduced_magnitude
from tests.library.test_export_tdm import Judge, orekit
from tests.nights.lit_night import (
    COLOUR_SIGMA,
    INSTRUMENTAL,
    LIMITING_MAG,
    MAG,
    MAG_SIGMA,
    SATURATED,
    WITHOUT_LIGHT,
    ZERO_POINT_MAG,
    ZERO_POINT_SIGMA_MAG,
    lit_night,
)
from tests.pages.tables import read_csv, read_ecsv, read_jsonl

__all__ = ["orekit"]
BOTH_SIGMA = math.hypot(MAG_SIGMA, COLOUR_SIGMA)
WITHOUT_V = {SATURATED, INSTRUMENTAL, WITHOUT_LIGHT}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lit_night(tmp_path_factory.mktemp("lit") / "night")


def rows_of(session: Path) -> dict[int, MeasuredRow]:
    return {row.frame_id: row for row in read_exported_night(session).track_measurements(1)}


def test_a_row_has_the_light_of_its_own_streak_and_the_distance_by_the_orbit(session: Path):
    rows = rows_of(session)
    first = rows[1]
    assert (first.mag, first.mag_sigma, first.mag_sigma_colour) == (
        MAG + 0.01,
        MAG_SIGMA,
        COLOUR_SIGMA,
    )
    assert (first.band, first.is_saturated) == ("V", False)
    assert first.sigma_mag == pytest.approx(BOTH_SIGMA)
    assert first.value("limiting_mag") == LIMITING_MAG
    # A geostationary satellite is between 35,786 km and 42,000 km away, or below the horizon.
    assert all(35_700.0 < (row.range_km or 0.0) < 49_000.0 for row in rows.values())
    assert first.range_km is not None
    assert first.phase_deg is not None
    expected = reduced_magnitude(MAG + 0.01, first.range_km, first.phase_deg)
    assert first.reduced_mag == pytest.approx(expected)


def test_without_a_sure_magnitude_in_v_nothing_is_reduced(session: Path):
    rows = rows_of(session)
    assert {n for n, row in rows.items() if row.reduced_mag is None} == WITHOUT_V
    assert rows[SATURATED].mag == pytest.approx(MAG + 0.03)
    assert rows[SATURATED].mag_v is None
    assert rows[INSTRUMENTAL].band == "instrumental"
    assert rows[WITHOUT_LIGHT].mag is None


@pytest.mark.parametrize("label", ["weak geometry", "not observable"])
def test_without_a_sure_orbit_there_is_no_distance(label: str, tmp_path: Path):
    rows = rows_of(lit_night(tmp_path / "vague", label=label))
    assert {(row.range_km, row.phase_deg, row.reduced_mag) for row in rows.values()} == {
        (None, None, None)
    }
    assert rows[1].mag is not None


@pytest.mark.parametrize(("kind", "read"), [("csv", read_csv), ("jsonl", read_jsonl)])
def test_tables_come_back_as_they_were(kind, read, session: Path, tmp_path: Path):
    path = tmp_path / f"night.{kind}"
    export(session, kind, path)
    assert read(path) == read_exported_night(session).rows


def test_ecsv_comes_back_with_the_units_of_its_columns(session: Path, tmp_path: Path):
    from astropy import units
    from astropy.table import Table

    path = tmp_path / "night.ecsv"
    export(session, "ecsv", path)
    assert read_ecsv(path) == read_exported_night(session).rows
    table = Table.read(path, format="ascii.ecsv")
    for name in ("mag", "mag_sigma", "mag_sigma_colour", "reduced_mag", "limiting_mag"):
        assert table[name].unit == units.mag
    assert table["range_km"].unit == units.km
    assert table["phase_deg"].unit == units.deg
    assert table["band"].unit is None


@pytest.mark.parametrize("kind", ["csv", "ecsv", "jsonl", "tdm", "tdm-xml", "udl"])
def test_a_magnitude_is_read_back_with_its_whole_error(kind, session: Path, tmp_path: Path):
    text, _ = render(session, kind, ExportOptions())
    read = parse_observations(text, tmp_path / kind)
    assert read is not None
    by_time = {round(row.t_utc_ns, -6): row for row in read.rows}
    rows = rows_of(session)
    assert len(by_time) == len(rows)
    for frame_id, row in rows.items():
        found = by_time[round(row.t_mid_utc_ns, -6)]
        is_table = kind in {"csv", "ecsv", "jsonl"}
        expected = row.mag if is_table else row.mag_v
        assert found.mag == (None if expected is None else pytest.approx(expected, abs=6e-5))
        if frame_id not in WITHOUT_V:
            assert found.mag_sigma == pytest.approx(BOTH_SIGMA, abs=6e-5)
        assert found.band == (row.band if is_table else None)


def test_a_strange_magnitude_costs_itself_alone(tmp_path: Path):
    text = "time,ra_deg,dec_deg,mag\n2023-06-22T03:00:00,10.0,5.0,bright\n"
    read = parse_observations(text, tmp_path / "x.csv")
    assert read is not None
    assert [row.mag for row in read.rows] == [None]


def test_a_message_has_mag_records_in_v_alone(session: Path):
    rows = rows_of(session)
    text, _ = render(session, "tdm", ExportOptions())
    (segment,) = parse_tdm(text).segments
    assert segment.metadata["DATA_TYPES"] == "ANGLE_1,ANGLE_2,MAG"
    assert not any(key.startswith("CORRECTION_MAG") for key in segment.metadata)
    assert segment.others == segment.beside == len(rows) - len(WITHOUT_V)
    for row, read in zip(rows.values(), segment.angles, strict=True):
        assert read.mag == (None if row.mag_v is None else pytest.approx(row.mag_v, abs=6e-5))
        if read.mag is not None:
            assert read.mag_sigma == pytest.approx(BOTH_SIGMA, abs=6e-5)
    xml = parse_tdm(render(session, "tdm-xml", ExportOptions())[0])
    assert xml.segments == (segment,)


def test_orekit_reads_the_magnitudes(session: Path, orekit: Judge, tmp_path: Path):
    path = tmp_path / "night.tdm"
    export(session, "tdm", path)
    verdict = orekit(path)
    assert verdict["ok"], verdict
    (segment,) = verdict["segments"]
    found = [value for name, _, _, value in segment["rows"] if name == "MAG"]
    expected = [row.mag_v for row in rows_of(session).values() if row.mag_v is not None]
    assert found == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize("kind", ["tdm", "tdm-xml"])
def test_ccsds_ndm_reads_the_magnitudes(kind, session: Path, tmp_path: Path):
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io", reason="pip install ccsds-ndm")
    path = tmp_path / kind
    path.write_text(render(session, kind, ExportOptions())[0])
    (segment,) = ndm_io.NdmIo().from_path(path).body.segment
    found = [each.mag for each in segment.data.observation if each.mag is not None]
    expected = [row.mag_v for row in rows_of(session).values() if row.mag_v is not None]
    values = [float(getattr(each, "value", each)) for each in found]
    assert values == pytest.approx(expected, abs=6e-5)


def test_udl_has_brightness_under_the_names_of_its_schema(session: Path):
    text, _ = render(session, "udl", ExportOptions(target=Target(norad_id=36097)))
    records = json.loads(text)
    rows = rows_of(session)
    assert len(records) == len(rows)
    for record, row in zip(records, rows.values(), strict=True):
        details = record["eoobservationDetails"]
        assert record["rangeMeasured"] is False
        assert (record["range"], record["solarPhaseAngle"]) == (row.range_km, row.phase_deg)
        assert record.get("mag") == row.mag_v
        if row.mag_v is not None:
            assert record["magUnc"] == pytest.approx(BOTH_SIGMA)
            # The schema's formula, of a range in metres.
            normed = record["mag"] - 5.0 * math.log10(1000.0 * record["range"] / 1_000_000.0)
            assert record["magNormRange"] == pytest.approx(normed)
            assert "Johnson V by Tycho-2 stars, not Gaia G" in record["descriptor"]
        if row.frame_id == INSTRUMENTAL:
            assert (details["magInstrumental"], details["magInstrumentalUnc"]) == (-7.4, MAG_SIGMA)
            assert "zeroptd" not in record
        else:
            assert record["zeroptd"] == ZERO_POINT_MAG
            assert record["zeroPtdUnc"] == ZERO_POINT_SIGMA_MAG
            assert details["pcalNumStars"] == 31
        assert None not in (*record.values(), *details.values())
