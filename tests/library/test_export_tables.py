"""Tables of measurements: what they hold, and that what is read is what was written."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsoconsole.config import Config
from rsoconsole.library import ExportOptions, export
from rsoconsole.library.formats.api import to_csv, to_ecsv, to_jsonl
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.rows import COLUMNS
from rsoconsole.session import SessionWriter
from tests.nights.export_nights import (
    MISSED,
    STRAY_ARCSEC,
    WOBBLE_ARCSEC,
    closed_night,
    made_up_rows,
    measurement,
    night_of,
)
from tests.nights.samples import SAMPLE
from tests.pages.tables import read_csv, read_ecsv, read_jsonl
from tests.pipeline.test_rulings import CONFIG, night, say

READERS = {"csv": read_csv, "jsonl": read_jsonl, "ecsv": read_ecsv}
quick = settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow], deadline=None)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return closed_night(tmp_path_factory.mktemp("night") / "across-0h")


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch")


def test_every_measurement_is_a_row_and_the_track_took_one_a_frame(session: Path):
    rows = read_exported_night(session).rows
    assert len(rows) == 2 * (14 - len(MISSED))
    taken = [row for row in rows if row.is_taken]
    assert [row.frame_id for row in taken] == [n for n in range(1, 15) if n not in MISSED]
    assert {row.track for row in taken} == {1}
    for row in taken:
        true = measurement(row.frame_id)
        assert (row.ra_icrs_deg, row.dec_icrs_deg) == (true.ra_icrs_deg, true.dec_icrs_deg)
        assert row.not_taken_because is None
    others = [row for row in rows if not row.is_taken]
    assert all(row.track is None and row.not_taken_because for row in others if row.frame_id > 2)


def test_errors_are_on_the_sky_and_residuals_are_measured_minus_predicted(session: Path):
    rows = [row for row in read_exported_night(session).rows if row.is_taken]
    for row in rows:
        assert row.sigma_ra_arcsec == pytest.approx(0.3)
        assert row.sigma_dec_arcsec == pytest.approx(0.2)
        assert row.correlation == pytest.approx(0.1)
    for row in rows[2:]:
        assert row.predicted_dec_icrs_deg is not None
        assert row.residual_dec_arcsec == pytest.approx(
            (row.dec_icrs_deg - row.predicted_dec_icrs_deg) * 3600.0, abs=1e-6
        )
        assert abs(row.residual_ra_arcsec or 0.0) < 5.0
        assert row.nis is not None
        assert row.nis >= 0.0
    assert rows[0].predicted_ra_icrs_deg is None
    # Sidereal drift at the equator, on the sky.
    assert rows[-1].rate_ra_arcsec_s == pytest.approx(15.04, abs=0.1)


def test_the_first_measurement_of_a_track_is_its_own_though_no_state_speaks_of_it(session: Path):
    first = next(row for row in read_exported_night(session).rows if row.is_taken)
    assert first.frame_id == 1
    assert first.track == 1
    assert first.dec_icrs_deg == pytest.approx(-0.25 + WOBBLE_ARCSEC / 3600.0)
    stray = [
        row for row in read_exported_night(session).rows if row.frame_id == 1 and not row.is_taken
    ]
    assert stray[0].dec_icrs_deg - first.dec_icrs_deg == pytest.approx(STRAY_ARCSEC / 3600.0)


@pytest.mark.parametrize("kind", READERS)
def test_a_session_comes_back_as_it_was(kind, session: Path, scratch: Path):
    for source in (session, SAMPLE):
        path = scratch / f"{source.name}.{kind}"
        made = export(source, kind, path)
        rows = read_exported_night(source).rows
        assert READERS[kind](path) == rows
        assert made.measurements == len(rows)
        assert made.path == path


@quick
@given(rows=st.lists(made_up_rows(), max_size=4))
def test_csv_and_json_lines_carry_every_value_exactly(scratch: Path, rows):
    path = scratch / "any"
    path.write_text(to_csv(rows), encoding="utf-8", newline="")
    assert read_csv(path) == tuple(rows)
    path.write_text(to_jsonl(rows), encoding="utf-8", newline="")
    assert read_jsonl(path) == tuple(rows)
    for line in path.read_text(encoding="utf-8").split("\n")[:-1]:
        # A text may be "NaN"; a number that is none is no JSON.
        row = json.loads(line, parse_constant=_refused)
        assert tuple(row) == tuple(column.name for column in COLUMNS)


def _refused(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(rows=st.lists(made_up_rows(), max_size=3))
def test_ecsv_carries_every_value_exactly(scratch: Path, rows):
    path = scratch / "any.ecsv"
    path.write_text(to_ecsv(night_of(rows)), encoding="utf-8", newline="")
    assert read_ecsv(path) == tuple(rows)


def test_negative_zero_keeps_its_sign(session: Path, scratch: Path):
    row = replace(read_exported_night(session).rows[0], dec_icrs_deg=-0.0)
    path = scratch / "zero.csv"
    path.write_text(to_csv([row]), encoding="utf-8")
    assert math.copysign(1.0, read_csv(path)[0].dec_icrs_deg) == -1.0


def test_ecsv_says_units_and_where_it_comes_from(session: Path, scratch: Path):
    from astropy import units
    from astropy.table import Table

    path = scratch / "units.ecsv"
    export(session, "ecsv", path)
    table = Table.read(path, format="ascii.ecsv")
    assert table["ra_icrs_deg"].unit == units.deg
    assert table["residual_ra_arcsec"].unit == units.arcsec
    assert table["rate_ra_arcsec_s"].unit == units.arcsec / units.s
    assert table["exposure_s"].unit == units.s
    assert all(table[column.name].info.description == column.meaning for column in COLUMNS)
    meta = table.meta
    assert meta["site"]["latitude_deg"] == 47.5
    assert meta["title"] == "across 0h"
    assert meta["optics"]["focal_length_mm"] == Config().optics.focal_length_mm


def test_ecsv_has_times_and_directions_as_astropy_knows_them(session: Path, scratch: Path):
    from astropy.coordinates import SkyCoord
    from astropy.table import QTable
    from astropy.time import Time

    path = scratch / "mixed.ecsv"
    export(session, "ecsv", path)
    table = QTable.read(path)
    rows = read_exported_night(session).rows
    assert isinstance(table["t_mid_utc"], Time)
    assert isinstance(table["direction"], SkyCoord)
    assert table["t_mid_utc"].scale == "utc"
    assert table["direction"].frame.name == "icrs"
    assert table["direction"].ra.deg.tolist() == [row.ra_icrs_deg for row in rows]
    assert table["direction"].dec.deg.tolist() == [row.dec_icrs_deg for row in rows]
    for t, row in zip(table["t_mid_utc"], rows, strict=True):
        assert f"{t.isot}Z" == row.t_mid_utc
    table.write(scratch / "again.ecsv")
    again = QTable.read(scratch / "again.ecsv")
    assert (again["t_mid_utc"] == table["t_mid_utc"]).all()


def test_every_column_is_documented_once():
    assert len({column.name for column in COLUMNS}) == len(COLUMNS)
    assert all(column.meaning for column in COLUMNS)
    for column in COLUMNS:
        ends = {"_deg": "deg", "_arcsec": "arcsec", "_px": "pix", "_ns": "ns"}
        for end, unit in ends.items():
            if column.name.endswith(end):
                assert column.unit == unit


@pytest.fixture(scope="module")
def ruled_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The operator refuses what was taken of frame 8; frames go on."""
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    assert say(r, "reject").ok
    r.engine.run(frames=11)
    writer = SessionWriter.create(tmp_path_factory.mktemp("ruled") / "night", CONFIG, {})
    for number, record in enumerate(r.memory.records):
        writer.append(record, number)
    writer.close()
    return writer.folder


def test_what_the_operator_refused_is_not_the_nights_result(ruled_session: Path):
    rows = read_exported_night(ruled_session).rows
    assert 8 not in {row.frame_id for row in rows}
    assert not any(row.is_superseded for row in rows)
    whole = read_exported_night(ruled_session, everything=True).rows
    assert {*rows} < {*whole}
    (refused,) = [row for row in whole if row.is_superseded]
    assert refused.frame_id == 8
    assert refused.track is None
    assert refused.not_taken_because == "refused by operator"


def test_all_says_which_rows_count_no_more(ruled_session: Path, tmp_path: Path):
    path = tmp_path / "all.csv"
    made = export(ruled_session, "csv", path, ExportOptions(everything=True))
    rows = read_csv(path)
    assert made.measurements == len(rows) == len(read_exported_night(ruled_session).rows) + 1
    assert sum(row.is_superseded for row in rows) == 1
