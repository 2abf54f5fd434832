"""orbit and identify read what others write, and what this program writes for others."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

from rsoconsole.base import ExportError, OrbitError
from rsoconsole.cli.app import app
from rsoconsole.library import ExportOptions, ReadOptions, Target, read_observations, render
from rsoconsole.library.formats._iod_reader import parse_uk_line
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.pipeline import read_observed_tracks
from rsoconsole.records import Site
from rsoconsole.sky import equinox_to_icrs, iso_to_utc_ns
from tests.nights.samples import SAMPLE

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
IOD, OBSERVED = DATA / "formats" / "iod", DATA / "observations"
needs_samples = pytest.mark.skipif(not IOD.exists(), reason=f"{IOD} is not here")
HERE = Site(latitude_deg=52.1358, longitude_deg=-2.3264, elevation_m=70.0)
ASK = ReadOptions(site=HERE)
GAINED_BY_ROUNDING_ARCSEC = 1.0


def said(*words: object) -> str:
    """The one line that a verb ends with."""
    done = CliRunner().invoke(app, [str(each) for each in words])
    assert done.exit_code != 0, done.output
    return str(done.exception) if not isinstance(done.exception, SystemExit) else done.output


def printed(*words: object) -> dict[str, Any]:
    done = CliRunner().invoke(app, [str(each) for each in words])
    assert done.exit_code == 0, (done.output, done.exception)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[0])
    return found


# What this program writes


@pytest.mark.parametrize("kind", ["tdm", "tdm-xml", "iod", "udl", "ecsv", "csv", "jsonl"])
def test_each_export_is_read_back_as_the_sessions_own_directions(kind: Any, tmp_path: Path) -> None:
    (own,) = read_observed_tracks(SAMPLE)
    path = tmp_path / f"night.{kind}"
    text, _ = render(SAMPLE, kind, ExportOptions(site_line=True))
    path.write_text(text)
    ask = ReadOptions(site=own.site) if kind in {"csv", "jsonl"} else ReadOptions()
    ((read,),) = read_observations(path, ask)
    assert read.site.latitude_deg == pytest.approx(own.site.latitude_deg, abs=1e-5)
    assert read.site.longitude_deg == pytest.approx(own.site.longitude_deg, abs=1e-5)
    assert len(read.seen) == len(own.seen)
    largest = GAINED_BY_ROUNDING_ARCSEC if kind == "iod" else 1e-4
    cos_dec = np.cos(np.radians(own.seen.dec_icrs_deg))
    off_ra = 3600.0 * abs(read.seen.ra_icrs_deg - own.seen.ra_icrs_deg) * cos_dec
    off_dec = 3600.0 * abs(read.seen.dec_icrs_deg - own.seen.dec_icrs_deg)
    assert max(off_ra.max(), off_dec.max()) < largest
    assert abs(read.seen.t_utc_ns - own.seen.t_utc_ns).max() < 1_000_000
    if kind not in {"iod", "udl"}:
        np.testing.assert_allclose(read.seen.whitening, own.seen.whitening, rtol=2e-4, atol=1e-3)


def test_orbit_of_an_export_is_the_orbit_of_the_session(tmp_path: Path) -> None:
    path = tmp_path / "night.xml"
    text, _ = render(SAMPLE, "tdm-xml", ExportOptions())
    path.write_text(text)
    own, read = printed("orbit", SAMPLE, "--json"), printed("orbit", path, "--json")
    assert read["label"] == own["label"]
    assert read["a_km"] == pytest.approx(own["a_km"], abs=0.1 * own["sigma_a_km"])
    assert (read["frame"], read["tle_frame"]) == ("GCRS", "TEME")


def test_both_forms_of_a_message_say_the_same() -> None:
    forms = [render(SAMPLE, kind, ExportOptions())[0] for kind in ("tdm", "tdm-xml")]
    line, xml = (parse_tdm(each) for each in forms)
    assert line.segments == xml.segments
    assert line.header.keys() == xml.header.keys()
    assert line.comments == xml.comments


def test_ccsds_ndm_reads_both_forms(tmp_path: Path) -> None:
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io", reason="pip install ccsds-ndm")
    rows = read_exported_night(SAMPLE).track_measurements(1)
    for kind in ("tdm", "tdm-xml"):
        text, _ = render(SAMPLE, kind, ExportOptions(target=Target(norad_id=100_001)))
        path = tmp_path / kind
        path.write_text(text)
        (segment,) = ndm_io.NdmIo().from_path(path).body.segment
        assert segment.metadata.participant_2 == "100001"
        values = [each.angle_1.value for each in segment.data.observation if each.angle_1]
        assert [float(value) for value in values] == pytest.approx(
            [row.ra_icrs_deg for row in rows], abs=1e-9
        )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<ANGLE_1", "<WRONG", "no XML"),
        ("RADEC", "<!-- -->", "ANGLE_TYPE"),
        ("<tdm ", "<!DOCTYPE x [<!ENTITY a 'b'>]><tdm ", "document type"),
        ('version="2.0"', 'version="9"', "version '9'"),
        ("UTC</TIME_SYSTEM>", "TAI</TIME_SYSTEM>", "only UTC"),
    ],
)
def test_a_damaged_xml_is_one_sentence(old: str, new: str, words: str) -> None:
    text, _ = render(SAMPLE, "tdm-xml", ExportOptions())
    with pytest.raises(ExportError, match=words) as refused:
        parse_tdm(text.replace(old, new))
    assert "\n" not in str(refused.value)


def test_udl_records_have_the_interfaces_names_units_and_words(tmp_path: Path) -> None:
    """Names as in the UDL's published schema of EOObservation; read by pandas."""
    path = tmp_path / "udl.json"
    text, _ = render(SAMPLE, "udl", ExportOptions(target=Target(norad_id=100_001)))
    path.write_text(text)
    table = pandas.read_json(path)
    rows = read_exported_night(SAMPLE).track_measurements(1)
    site = read_exported_night(SAMPLE).config.site
    assert set(table["dataMode"]) == {"SIMULATED"}
    assert set(table["classificationMarking"]) == {"U"}
    assert set(table["satNo"]) == {100_001}
    assert list(table["obPosition"])[:2] == ["FIRST", "IN"]
    assert list(table["ra"]) == pytest.approx([row.ra_icrs_deg for row in rows], abs=1e-9)
    assert list(table["declinationUnc"]) == pytest.approx(
        [row.sigma_dec_arcsec / 3600.0 for row in rows]
    )
    assert table["senalt"][0] == pytest.approx(site.elevation_m / 1000.0)
    details = table["eoobservationDetails"][0]
    assert math.sqrt(details["raCov"]) == pytest.approx(table["raUnc"][0])
    times = pandas.to_datetime(table["obTime"], utc=True)
    assert times.diff().min() > pandas.Timedelta(0)
    unknown, _ = render(SAMPLE, "udl", ExportOptions())
    assert all(each["uct"] and "satNo" not in each for each in json.loads(unknown))


def test_catalogue_numbers_beyond_five_digits_go_where_there_is_room() -> None:
    known = ExportOptions(target=Target(norad_id=100_001))
    text, _ = render(SAMPLE, "tdm", known)
    assert "PARTICIPANT_2 = 100001" in text
    with pytest.raises(ExportError, match="five columns"):
        render(SAMPLE, "iod", known)


def test_times_have_the_digits_that_the_record_has() -> None:
    text, _ = render(SAMPLE, "tdm", ExportOptions())
    (segment,) = parse_tdm(text).segments
    assert [each.t_utc_ns for each in segment.angles] == [
        row.t_mid_utc_ns for row in read_exported_night(SAMPLE).track_measurements(1)
    ]
    epochs = [line.split()[2] for line in text.splitlines() if line.startswith("ANGLE_1")]
    assert all(len(each.partition(".")[2]) == 3 or each[-1] != "0" for each in epochs)
    assert "one sigma of the shutter" in text


def test_an_iod_file_begins_with_the_station_and_its_place(tmp_path: Path) -> None:
    path = tmp_path / "night.iod"
    words = ("export", SAMPLE, "--format", "iod", "--station", "4171", "--out", path)
    printed(*words, "--json")
    first, second, *_ = path.read_text().splitlines()
    assert first.startswith("# 4171 ")
    assert second[16:20] == "4171"
    ((read,),) = read_observations(path, ReadOptions())
    assert read.site.latitude_deg == pytest.approx(
        read_exported_night(SAMPLE).config.site.latitude_deg, abs=1e-5
    )


# What others write


def uk_answers() -> list[tuple[str, bool]]:
    found = []
    for name in ("compliant", "noncompliant") if IOD.exists() else ():
        for text in (IOD / f"UK_data_{name}_answers.txt").read_text().split("\n"):
            answer, _, line = text.partition(",")
            found += [(line, answer == "True")] if line else []
    return found


@pytest.mark.shared_data
@needs_samples
def test_every_uk_sample_is_answered_as_trusat_answers_it() -> None:
    answers = uk_answers()
    assert sum(is_good for _, is_good in answers) > 40
    assert sum(not is_good for _, is_good in answers) > 60
    for line, is_good in answers:
        if is_good:
            parse_uk_line(line)
        else:
            with pytest.raises(ExportError):
                parse_uk_line(line)


def test_a_uk_line_says_what_its_columns_say() -> None:
    """Source: the line's own text, after the posted description of the columns."""
    read = parse_uk_line("9701201201803101520195542  01   12172038  +15585   1  5")
    assert (read.cospar, read.station) == ("1997-012A", "2018")
    assert read.t_utc_ns == iso_to_utc_ns("2003-10-15T20:19:55.42Z")
    assert read.first_deg == pytest.approx(15.0 * (17 + 20.38 / 60))
    assert read.second_deg == pytest.approx(15 + 58.5 / 60)
    assert (read.time_sigma_s, read.position_sigma_arcsec) == (0.1, 60.0)
    assert read.epoch_year == 2000


@pytest.mark.shared_data
@needs_samples
def test_files_of_others_lead_to_an_object_or_to_a_sentence_that_says_what_to_do() -> None:
    mixed = IOD / "IOD_data_compliant.txt"
    assert "holds 3 objects: 23794 (16), 12345 (16)" in said("orbit", mixed)
    assert "say which with --object" in said("identify", mixed, "--tle", mixed)
    assert "station 2701 stands: --site" in said("orbit", mixed, "--object", "90019")
    assert "no object '5'" in said("orbit", mixed, "--object", "5")
    found = printed(
        *("orbit", mixed, "--object", "90019", "--site", "43.6876,-79.3924,230", "--json")
    )
    assert found["observations"] == 4
    uk = IOD / "UK_data_compliant.txt"
    ((read,),) = read_observations(uk, ReadOptions(site=HERE, target="1991-076C"))
    assert len(read.seen) == 2
    for path in sorted((DATA / "formats" / "tdm").iterdir()):
        words = said("orbit", path)
        assert path.name in words
        assert "\n" not in words.strip()


@pytest.mark.shared_data
@needs_samples
@pytest.mark.parametrize("name", ["navstar77_43873.json", "kazsat2_37749.json"])
def test_real_observations_give_the_same_orbit_in_every_form(name: str, tmp_path: Path) -> None:
    told = json.loads((OBSERVED / name).read_text())
    site = told["site"]
    head = "time,ra_deg,dec_deg,lat_deg,lon_deg,alt_m"
    place = f"{site['lat_deg']},{site['lon_deg']},{site['alt_m']}"
    lines = [f"{t},{ra},{dec},{place}" for t, ra, dec, *_ in told["obs"]]
    table = tmp_path / "table.csv"
    table.write_text("\n".join([head, *lines]))
    radians = tmp_path / "radians.csv"
    in_radians = [
        f"{t};{math.radians(ra)!r};{math.radians(dec)!r}" for t, ra, dec, *_ in told["obs"]
    ]
    radians.write_text("\n".join(["UTC;RA;Dec", *in_radians]))
    own = printed("orbit", OBSERVED / name, "--json")
    assert printed("orbit", table, "--json")["a_km"] == pytest.approx(own["a_km"], rel=1e-9)
    assert "as radians are" in said("orbit", radians, "--site", place)
    other = printed("orbit", radians, "--radians", "--site", place, "--json")
    assert other["a_km"] == pytest.approx(own["a_km"], rel=1e-6)


# Tables


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "table.csv"
    path.write_text(text)
    return path


ROWS = [("2023-06-22T03:00:00", 10.0, 5.0), ("2023-06-22T03:01:00", 10.3, 5.1)]


def test_columns_are_known_by_name_in_any_order_and_separator(tmp_path: Path) -> None:
    for head, row in (
        ("Dec_deg,UTC,RA_deg", "{2},{0},{1}"),
        ("dec (deg);time;ra (deg)", "{2};{0};{1}"),
        ("time\tra_hours\tdec", "{0}\t{3}\t{2}"),
        ("# a word\ntime,ra_rad,dec_rad", "{0},{4!r},{5!r}"),
        ("t_mid_utc,ra_icrs_deg,dec_icrs_deg,is_taken", "{0},{1},{2},true"),
    ):
        lines = [
            row.format(t, ra, dec, ra / 15.0, math.radians(ra), math.radians(dec))
            for t, ra, dec in ROWS
        ]
        ((read,),) = read_observations(table(tmp_path, "\n".join([head, *lines])), ASK)
        np.testing.assert_allclose(read.seen.ra_icrs_deg, [10.0, 10.3])
        np.testing.assert_allclose(read.seen.dec_icrs_deg, [5.0, 5.1])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,ra_deg,dec_deg\n2023-06-22T03:00:00,10\n", "2 fields where 3 belong"),
        ("time,ra_deg,dec_deg\nnoon,10,5\n", "line 2: 'noon' is not a time"),
        ("time,ra_deg,dec_deg\n2023-06-22T03:00:00,10:20:30,5\n", "write it in degrees"),
        ("time,ra_deg,dec_deg\n2023-06-22T03:00:00,10,95\n", "no direction in degrees"),
        ("time,ra_deg,dec_deg\n2023-06-22T03:00:00,nan,5\n", "nan is no direction"),
        ("time,ra_deg,dec_deg\n", "holds no observations"),
        ("ra_deg,dec_deg\n10,5\n", "a column of times"),
        ("time,ra_deg,dec_deg,sigma_arcsec\n2023-06-22T03:00:00,10,5,-1\n", "must be above 0"),
        ("time,ra_deg,dec_deg,lat_deg,lon_deg\n2023-06-22T03:00:00,10,5,99,0\n", "no place"),
        ("a word of greeting\n", "is none of what is read: TDM, IOD or UK lines"),
        ("\n", "TDM, IOD or UK lines"),
    ],
)
def test_what_is_no_table_says_which_line_and_what(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises((OrbitError, ExportError), match=words) as refused:
        read_observations(table(tmp_path, text), ASK)
    assert "table.csv" in str(refused.value)


def test_several_objects_of_a_table_are_told_apart(tmp_path: Path) -> None:
    lines = [f"{t},{ra},{dec},{name}" for name in ("7", "8") for t, ra, dec in ROWS]
    path = table(tmp_path, "\n".join(["time,ra_deg,dec_deg,norad", *lines]))
    with pytest.raises(OrbitError, match=r"2 objects: 7 \(2\), 8 \(2\)"):
        read_observations(path, ASK)
    ((read,),) = read_observations(path, ReadOptions(site=HERE, target="8"))
    assert len(read.seen) == 2


def test_each_station_of_a_file_has_its_own_place(tmp_path: Path) -> None:
    stations = tmp_path / "sites.txt"
    stations.write_text(
        "# No ID  Latitude Longitude Elev\n2701 ME 43.6876 -79.3924 230. Molczan\n"
        "4171 CB   52.8344    6.3785     10    Bassa\n"
    )
    lines = [f"{t},{ra},{dec},{name}" for name in ("2701", "4171") for t, ra, dec in ROWS]
    path = table(tmp_path, "\n".join(["time,ra_deg,dec_deg,station", *lines]))
    groups = read_observations(path, ReadOptions(stations=stations))
    assert [each[0].site.elevation_m for each in groups] == [230.0, 10.0]
    stations.write_text("2701 somewhere\n")
    with pytest.raises(ExportError, match="line 1: a station is"):
        read_observations(path, ReadOptions(stations=stations))


def test_a_time_that_is_known_badly_is_known_badly_along_the_motion(tmp_path: Path) -> None:
    lines = [f"{t},{ra},{dec},0.5" for t, ra, dec in ROWS]
    path = table(tmp_path, "\n".join(["time,ra_deg,dec_deg,time_sigma_s", *lines]))
    ((read,),) = read_observations(path, ReadOptions(site=HERE, sigma_arcsec=1.0))
    covariance = np.linalg.inv(np.einsum("nji,njk->nik", read.seen.whitening, read.seen.whitening))
    # 0.3 deg in 60 s times cos Dec is 17.9 arcsec/s, 0.1 deg is 6.
    assert math.sqrt(covariance[0][0, 0]) == pytest.approx(math.hypot(1.0, 0.5 * 17.93), rel=1e-3)
    assert math.sqrt(covariance[0][1, 1]) == pytest.approx(math.hypot(1.0, 0.5 * 6.0), rel=1e-3)


def test_old_star_charts_are_turned_to_icrs() -> None:
    """Truth: Polaris in B1950 and in J2000, SAO catalogue and Hipparcos, to a few arcsec."""
    polaris = np.full(2, 15.0 * (1 + 48 / 60 + 48.79 / 3600)), np.full(2, 89 + 1 / 60 + 43.7 / 3600)
    instants = np.zeros(2, np.int64)
    ra, dec = equinox_to_icrs(*polaris, 1950, instants)
    assert dec == pytest.approx(89 + 15 / 60 + 51 / 3600, abs=5 / 3600)
    assert ra == pytest.approx(15.0 * (2 + 31 / 60 + 49 / 3600), abs=0.1)
    assert equinox_to_icrs(*polaris, 2000, instants) == polaris


def test_cospar_and_long_numbers_go_into_elements(tmp_path: Path) -> None:
    out = tmp_path / "o.tle"
    words = ("orbit", SAMPLE, "--cospar", "2009-064A", "--norad", "100001")
    printed(*words, "--out", out, "--json")
    line = out.read_text().splitlines()[1]
    assert (line[2:7], line[9:17].strip()) == ("A0001", "09064A")
    out = tmp_path / "o.json"
    printed(*words, "--out", out, "--json")
    (told,) = json.loads(out.read_text())
    assert (told["OBJECT_ID"], told["NORAD_CAT_ID"]) == ("2009-064A", 100_001)
    for option, wrong in (("--cospar", "09-64A"), ("--site", "47"), ("--site", "91,0,0")):
        assert CliRunner().invoke(app, ["orbit", str(SAMPLE), option, wrong]).exit_code == 2


def test_degrees_that_look_like_radians_are_taken_where_somebody_says_so(tmp_path: Path) -> None:
    lines = [f"{t},{ra / 10},{dec / 10}" for t, ra, dec in ROWS]
    path = table(tmp_path, "\n".join(["time,ra,dec", *lines]))
    with pytest.raises(OrbitError, match="--radians or --degrees"):
        read_observations(path, ASK)
    ((read,),) = read_observations(path, ReadOptions(site=HERE, is_radians=False))
    np.testing.assert_allclose(read.seen.ra_icrs_deg, [1.0, 1.03])


def test_lines_of_hours_and_minutes_are_never_taken_for_radians(tmp_path: Path) -> None:
    path = tmp_path / "near_zero.iod"
    lines = [
        f"36097 09 064A   9999   202306230531{n}0300 26 25 0012{n}00+0012{n}0 37" for n in range(4)
    ]
    path.write_text("\n".join(lines))
    ((read,),) = read_observations(path, ASK)
    assert read.seen.ra_icrs_deg.max() < 2.0 * math.pi
    with pytest.raises(OrbitError, match="leave --radians out"):
        read_observations(path, ReadOptions(site=HERE, is_radians=True))


def test_json_without_a_site_takes_the_one_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "bare.json"
    path.write_text(json.dumps({"obs": [[t, ra, dec] for t, ra, dec in ROWS]}))
    with pytest.raises(OrbitError, match=r"no site .* --site"):
        read_observations(path, ReadOptions())
    ((read,),) = read_observations(path, ASK)
    assert read.site == HERE


def test_elements_are_read_by_ccsds_ndm_and_skyfield(tmp_path: Path) -> None:
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io", reason="pip install ccsds-ndm")
    from skyfield.api import EarthSatellite, load

    for ending in ("kvn", "xml", "json"):
        out = tmp_path / f"o.{ending}"
        words = ("orbit", SAMPLE, "--cospar", "2009-064A", "--norad", "100001")
        printed(*words, "--out", out, "--json")
        if ending == "json":
            row = {key: str(value) for key, value in json.loads(out.read_text())[0].items()}
            read = EarthSatellite.from_omm(load.timescale(builtin=True), row)
            assert (read.model.satnum, read.model.intldesg) == (100_001, "09064A")
        else:
            segment = ndm_io.NdmIo().from_path(out).body.segment
            assert segment.metadata.object_id == "2009-064A"
            assert int(segment.data.tle_parameters.norad_cat_id) == 100_001
