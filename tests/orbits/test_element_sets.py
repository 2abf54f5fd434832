"""Element sets as publishers write them, and damaged ones: read, or refused with the reason."""

import gzip
import json
import re
import time
from collections.abc import Callable

import numpy as np
import pytest

from rsoconsole.base import OrbitError
from rsoconsole.orbits import CatalogueEntry, MeanElements, omm_message, parse_element_sets
from rsoconsole.orbits.elements.elements import checksum
from rsoconsole.words import utc_ns_to_iso

# STARLINK-4553, as in parzivail/SGP.NET issue 34, with a good drag term.
NAME = "STARLINK-4553"
LINE_1 = "1 53577U 22101BC  25345.55693763 -.00000288  00000+0  10270-3 0  999"
LINE_2 = "2 53577  53.2164  89.5151 0001372  89.9326 270.1823 15.0884530118396"


def summed(line: str) -> str:
    return f"{line}{checksum(line)}"


def lines(line_1: str = LINE_1, line_2: str = LINE_2, name: str = NAME) -> str:
    return f"{name}\n{summed(line_1)}\n{summed(line_2)}\n"


def placed(line: str, first: int, text: str) -> str:
    """The line with ``text`` from a column on."""
    return line[: first - 1] + text + line[first - 1 + len(text) :]


def message(number: int = 25544, **other: object) -> dict[str, object]:
    return {
        "OBJECT_NAME": "ISS (ZARYA)",
        "OBJECT_ID": "1998-067A",
        "EPOCH": "2024-01-01T12:00:00.000000",
        "MEAN_MOTION": 15.49560532,
        "ECCENTRICITY": 0.0006317,
        "INCLINATION": 51.64,
        "RA_OF_ASC_NODE": 208.9163,
        "ARG_OF_PERICENTER": 69.9862,
        "MEAN_ANOMALY": 25.2906,
        "NORAD_CAT_ID": number,
        "BSTAR": 0.0001027,
        **other,
    }


def one(text: str | bytes) -> CatalogueEntry:
    found = parse_element_sets(text, "f")
    assert not found.not_used
    (entry,) = found.entries
    return entry


def refusal(text: str | bytes) -> str:
    with pytest.raises(OrbitError) as caught:
        parse_element_sets(text, "f")
    return str(caught.value)


@pytest.mark.parametrize(
    ("row", "first", "text", "columns"),
    [
        (1, 54, "87000-10", "columns 54-61"),
        (1, 54, "10270-3 ", "columns 54-61"),
        (1, 45, "00000+0 ", "columns 45-52"),
        (1, 34, "-.000002880", "column 44"),
        (1, 34, ".00000288 ", "columns 34-43"),
        (1, 19, "25366.55693763", "columns 19-32"),
        (1, 19, "2534.556937630", "columns 19-32"),
        (1, 3, "5357 ", "columns 3-7"),
        (1, 10, "2x101BC ", "columns 10-17"),
        (1, 63, "x", "column 63"),
        (1, 63, "4", "column 63"),
        (1, 65, "9 9x", "columns 65-68"),
        (1, 54, " 99999+9", "columns 54-61"),
        (2, 9, "53.2164 ", "columns 9-16"),
        (2, 9, "180.0001", "columns 9-16"),
        (2, 18, "360.0001", "columns 18-25"),
        (2, 27, ".001372", "columns 27-33"),
        (2, 35, "-89.9326", "columns 35-42"),
        (2, 44, "     nan", "columns 44-51"),
        (2, 53, " 0.00000000", "columns 53-63"),
        (2, 53, "18.50000000", "columns 53-63"),
        (2, 53, "1.508845301", "columns 53-63"),
        (2, 26, "1", "column 26"),
    ],
)
def test_a_field_out_of_its_columns_or_its_range_is_named_by_line_and_columns(
    row: int, first: int, text: str, columns: str
) -> None:
    good = [LINE_1, LINE_2]
    good[row - 1] = placed(good[row - 1], first, text)
    words = refusal(lines(*good))
    assert f"f, line {row + 1}: {columns}" in words
    assert "[STARLINK-4553 (5357" in words


@pytest.mark.parametrize(
    ("row", "first", "text", "name", "value"),
    [
        (1, 54, "+10270-3", "bstar", 0.10270e-3),
        (1, 54, "-10270-3", "bstar", -0.10270e-3),
        (1, 54, "   270-3", "bstar", 0.00270e-3),
        (1, 54, " 00000 0", "bstar", 0.0),
        (1, 54, "        ", "bstar", 0.0),
        (1, 54, "-00000-0", "bstar", 0.0),
        (1, 45, "        ", "nddot", 0.0),
        (1, 45, "-00000-0", "nddot", 0.0),
        (1, 34, "+.00016717", "ndot", 0.00016717 * 2.0 * np.pi / 1440.0**2),
        (1, 34, "0.00016717", "ndot", 0.00016717 * 2.0 * np.pi / 1440.0**2),
        (1, 34, "          ", "ndot", 0.0),
        (1, 10, "        ", "intldesg", ""),
        (1, 8, " ", "ecco", 0.0001372),
        (1, 63, " ", "ecco", 0.0001372),
        (1, 65, "   9", "elnum", 9),
        (2, 9, " 53.2   ", "inclo", np.radians(53.2)),
        (2, 9, "   .2164", "inclo", np.radians(0.2164)),
        (2, 27, "   1372", "ecco", 0.0001372),
        (2, 44, "360.0000", "mo", 2.0 * np.pi),
        (2, 53, " 1.00271284", "no_kozai", 1.00271284 * 2.0 * np.pi / 1440.0),
        (2, 64, "    1", "ecco", 0.0001372),
    ],
)
def test_what_publishers_write_in_a_field_is_read(
    row: int, first: int, text: str, name: str, value: float | str
) -> None:
    good = [LINE_1, LINE_2]
    good[row - 1] = placed(good[row - 1], first, text)
    found = getattr(one(lines(*good)).record, name)
    assert found == (value if isinstance(value, str) else pytest.approx(value, rel=1e-12))
    bare = f"{good[0]}\n{good[1]}\n"  # 68 columns, no checksum
    assert getattr(one(bare).record, name) == found


GOOD_LINES = [
    lines(LINE_1.replace("53577", n), LINE_2.replace("53577", n), f"SAT {n}")
    for n in ("40001", "40002", "40003")
]


@pytest.mark.parametrize(
    ("text", "place", "reason"),
    [
        (GOOD_LINES[1][:-2] + "x\n", "line 6", "checksum"),
        (GOOD_LINES[1].replace("53.2164", "53.2165"), "line 6", "checksum"),
        ("".join(GOOD_LINES[1].splitlines(keepends=True)[:2]), "line 5", "no line 2 follows"),
        ("".join(GOOD_LINES[1].splitlines(keepends=True)[1:2]), "line 4", "no line 2 follows"),
        ("".join(GOOD_LINES[1].splitlines(keepends=True)[::2]), "line 5", "without its line 1"),
        ("".join(GOOD_LINES[1].splitlines(keepends=True)[2:]), "line 4", "without its line 1"),
        (GOOD_LINES[1].replace("1 4", "X 4"), "line 5", "neither a name nor"),
        (GOOD_LINES[1].replace("2 40002", "2 40009"), "line 6", "checksum"),
        (GOOD_LINES[1].replace("53.2164", "53,2164"), "line 6", "columns 9-16"),
        (GOOD_LINES[1][:-30] + "\n", "line 6", "69 columns needed"),
    ],
)
def test_one_bad_set_costs_itself_alone(text: str, place: str, reason: str) -> None:
    found = parse_element_sets(GOOD_LINES[0] + text + GOOD_LINES[2], "f")
    assert [(e.norad_id, e.name) for e in found.entries] == [
        (40001, "SAT 40001"),
        (40003, "SAT 40003"),
    ]
    (bad,) = found.not_used
    assert (bad.source, bad.place) == ("f", place)
    assert reason in bad.reason
    assert found.not_used_words.startswith(f"1 of 3 element sets is not used: f, {place}: ")


def test_of_many_bad_sets_the_first_few_are_said_and_all_counted() -> None:
    bad = LINE_1.replace("U", "!")
    found = parse_element_sets(lines() + f"{summed(bad)}\n{summed(LINE_2)}\n" * 20, "f")
    assert len(found.not_used) == 20
    assert found.not_used_words.startswith(
        "20 of 21 element sets are not used: f, line 4: column 8"
    )
    assert found.not_used_words.endswith("; and 17 more")


ENCODINGS: dict[str, Callable[[str], bytes]] = {
    "utf-8 with a mark": lambda text: text.encode("utf-8-sig"),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-16 of the other order": lambda text: b"\xfe\xff" + text.encode("utf-16-be"),
    "latin-1": lambda text: text.encode("latin-1"),
    "carriage returns": lambda text: text.replace("\n", "\r").encode(),
    "line ends of Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "form feeds": lambda text: ("\f" + text.replace("\n", "\n\f")).encode(),
    "indented": lambda text: ("\t" + text.replace("\n", "  \n \t")).encode(),
    "gzip": lambda text: gzip.compress(text.encode()),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("form", ["lines", "json"])
def test_encodings_line_ends_and_indents_read_alike(encoding: str, form: str) -> None:
    name = "ÉTOILE"
    text = lines(name=name)
    if form == "json":
        text = json.dumps([message(OBJECT_NAME=name)], indent=1, ensure_ascii=False)
    plain, read = one(text), one(ENCODINGS[encoding](text))
    assert (read.name, read.norad_id, read.epoch_utc_ns) == (
        name,
        plain.norad_id,
        plain.epoch_utc_ns,
    )
    assert read.record.bstar == plain.record.bstar


MEAN = MeanElements(
    norad_id=25544,
    name="OURS",
    epoch_utc_ns=1_704_110_400_000_000_000,
    revolutions_a_day=15.758248300107,
    e=0.008657842354,
    i_deg=51.6468162268,
    raan_deg=254.0062968198,
    argp_deg=257.5529676323,
    m_deg=186.3083504646,
    bstar=1.5e-5,
)


@pytest.mark.parametrize("form", ["kvn", "xml", "json"])
def test_what_the_program_writes_it_reads(form: str) -> None:
    text = omm_message(MEAN, created_utc_ns=MEAN.epoch_utc_ns, form=form)  # type: ignore[arg-type]
    found = one(text)
    assert (found.name, found.norad_id) == ("OURS", 25544)
    assert found.epoch_utc_ns == MEAN.epoch_utc_ns
    assert found.revolutions_a_day == pytest.approx(MEAN.revolutions_a_day, rel=1e-12)
    assert found.record.bstar == MEAN.bstar


def written(form: str) -> str:
    return omm_message(MEAN, created_utc_ns=0, form=form)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        written("kvn") * 2,
        written("kvn").replace(" = ", "=").replace("\n\n", "\nCOMMENT of it\n") * 2,
        "\n".join(
            f"{line} [deg]" if "ANOMALY" in line else line for line in written("kvn").split("\n")
        )
        + written("kvn").lower().replace("t12", "T12"),
        written("xml").replace("<omm ", '<omm xmlns="urn:ccsds:schema:ndmxml" ') * 2,
        "<ndm:ndm xmlns:ndm='urn:x'>"
        + re.sub(r"<(/?)(?=[a-zA-Z])", r"<\1ndm:", written("xml").split("\n", 1)[1]) * 2
        + "</ndm:ndm>",
        json.dumps({"data": [message(), message()]}),
        json.dumps(message()) + "\n" + json.dumps(message()),
    ],
    ids=["kvn", "kvn with comments", "units and small keys", "xmlns", "prefix", "within", "lines"],
)
def test_omm_in_any_dress_of_the_standard_is_read(text: str) -> None:
    found = parse_element_sets(text, "f")
    assert found.not_used == ()
    assert [each.norad_id for each in found.entries] == [25544, 25544]


@pytest.mark.parametrize(
    ("other", "epoch", "number"),
    [
        ({"EPOCH": "2024-001T12:00:00.000000"}, "2024-01-01T12:00:00.000Z", 25544),
        ({"EPOCH": "2024-366T00:00:00Z"}, "2024-12-31T00:00:00.000Z", 25544),
        (
            {"EPOCH": "2015-08-13 10:11:12", "EPOCH_MICROSECONDS": "345000"},
            "2015-08-13T10:11:12.345Z",
            25544,
        ),
        ({"NORAD_CAT_ID": 25544.0, "REV_AT_EPOCH": "123.0"}, "2024-01-01T12:00:00.000Z", 25544),
        ({"NORAD_CAT_ID": "A0001", "MEAN_MOTION": "15.5"}, "2024-01-01T12:00:00.000Z", 100_001),
        ({"NORAD_CAT_ID": "799500123"}, "2024-01-01T12:00:00.000Z", 799_500_123),
        (
            {"OBJECT_ID": None, "ELEMENT_SET_NO": None, "MEAN_MOTION_DOT": None},
            "2024-01-01T12:00:00.000Z",
            25544,
        ),
    ],
)
def test_fields_of_omm_as_publishers_write_them(
    other: dict[str, object], epoch: str, number: int
) -> None:
    found = one(json.dumps([message(**other)]))
    assert (utc_ns_to_iso(found.epoch_utc_ns), found.norad_id) == (epoch, number)
    small = {key.lower(): value for key, value in message(**other).items()}
    assert one(json.dumps(small)).epoch_utc_ns == found.epoch_utc_ns


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"EPOCH": None}, "EPOCH is missing"),
        ({"EPOCH": "2023-366T00:00:00"}, "2023 has no day 366"),
        ({"EPOCH": "9999-01-01T00:00:00"}, "1957 to 2099"),
        ({"MEAN_MOTION": "NaN"}, "MEAN_MOTION is 'NaN', not a number"),
        ({"INCLINATION": float("nan")}, "INCLINATION is 'nan', not a number"),
        ({"BSTAR": float("inf")}, "BSTAR is 'inf', not a number"),
        ({"ECCENTRICITY": 1.0}, "ECCENTRICITY"),
        ({"ECCENTRICITY": -0.1}, "ECCENTRICITY is -0.1: 0 to 1"),
        ({"INCLINATION": 180.1}, "INCLINATION is 180.1: 0 to 180"),
        ({"MEAN_MOTION": 0}, "MEAN_MOTION"),
        ({"MEAN_MOTION": 18.1}, "MEAN_MOTION is 18.1"),
        ({"MEAN_ANOMALY": True}, "MEAN_ANOMALY is 'True', not a number"),
        ({"MEAN_ANOMALY": {"value": 3}}, "MEAN_ANOMALY"),
        ({"NORAD_CAT_ID": 25544.5}, "not a catalogue number"),
        ({"REF_FRAME": "EME2000"}, "REF_FRAME is EME2000; only TEME can be used"),
        ({"CENTER_NAME": "MARS"}, "CENTER_NAME is MARS; only EARTH"),
        ({"MEAN_ELEMENT_THEORY": "DSST"}, "only SGP4 can be used"),
        ({"EPHEMERIS_TYPE": 4}, "EPHEMERIS_TYPE is 4, not of SGP4"),
        ({"MEAN_MOTION": 17.5, "ECCENTRICITY": 0.9}, "SGP4 has no place for it"),
    ],
)
def test_a_value_that_no_orbit_has_costs_its_message_alone(
    other: dict[str, object], reason: str
) -> None:
    found = parse_element_sets(json.dumps([message(), message(**other), message(43)]), "f")
    assert [each.norad_id for each in found.entries] == [25544, 43]
    (bad,) = found.not_used
    assert reason in bad.reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("GP data has not updated since\nyour last download.\n", "not updated since your last"),
        ("\r\n No GP data found \r\n", "f holds no element set, but: No GP data found"),
        ('[{"error":"You\'ve violated your query rate limit."}]', "but: You've violated your"),
        ('{"error": {"code": 429, "message": "slow down"}}', "but: slow down"),
        ('"rate limit"', "but: rate limit"),
        ("<!DOCTYPE html><html><title>403\n Forbidden</title></html>", "but: 403 Forbidden"),
        ("<html><body><h1>Too &lt;many</h1> requests</body></html>", "but: Too <many"),
        ("<?xml version='1.0'?><error>none</error>", "but: none"),
        ("<Error><Code>SlowDown</Code><Message>Wait.</Message></Error>", "but: SlowDown Wait."),
        ("2 requests within a minute were counted from you: wait", "but: 2 requests within"),
        ("CCSDS_OPM_VERS = 2.0\nEPOCH = 2024-01-01T00:00:00\n", "it is an OPM, not an OMM"),
        ("x" * 5000, "x" * 199 + "…"),
        ("", "it is empty"),
        ("[]", "two lines (TLE) or OMM are needed"),
        (b"\x7fELF\x00\x00\x01", "it is no text"),
    ],
)
def test_what_a_server_says_in_place_of_elements_is_quoted(text: str | bytes, words: str) -> None:
    said = refusal(text)
    assert words in said
    assert "fetch it again" not in said
    assert "\n" not in said


TABLE = ",".join(message()) + "\n" + ",".join(map(str, message().values())) + "\n"
XML_SET = written("xml")[written("xml").index("<omm") :]
DAMAGED = {
    "json": json.dumps(message(43)).replace("15.", "bad 15."),
    "kvn": written("kvn").replace("INCLINATION =", "INCLINATION :").replace("25544", "43"),
    "xml": XML_SET.replace("<ECCENTRICITY>", "<ECCENTRICITY").replace("25544", "43"),
    "csv": TABLE.split("\n")[1].replace("25544", "43").rpartition(",")[0],
}
GOOD = {"json": json.dumps(message()), "kvn": written("kvn"), "xml": XML_SET, "csv": TABLE}


@pytest.mark.parametrize("form", GOOD)
def test_a_set_that_cannot_be_parsed_is_named_by_its_number(form: str) -> None:
    found = parse_element_sets(f"{GOOD[form]}\n{DAMAGED[form]}\n", "f")
    assert [each.norad_id for each in found.entries] == [25544]
    assert [each.norad_id for each in found.not_used] == [43]


@pytest.mark.parametrize(
    "text",
    [
        json.dumps([{"name": NAME, "line1": LINE_1, "line2": LINE_2}]),
        json.dumps([{"tle0": f"0 {NAME}", "tle1": LINE_1, "tle2": LINE_2, "norad_cat_id": 53577}]),
        f"name,line1,line2\n{NAME},{LINE_1},{LINE_2}\n",
        "".join(f"> {each}\n" for each in lines().splitlines()),
    ],
    ids=["json", "satnogs", "csv", "quoted"],
)
def test_two_lines_are_read_wherever_they_stand(text: str) -> None:
    found = one(text)
    assert (found.name, found.norad_id) == (NAME, 53577)


@pytest.mark.parametrize("before", ["sep=,\n", "# from there\n\n", '"sep=,"\n'])
def test_lines_before_a_table_are_passed_over(before: str) -> None:
    assert one(before + TABLE).norad_id == 25544


def test_a_long_name_is_a_name() -> None:
    assert one(lines(name="LONG " * 20)).name == ("LONG " * 12)


def test_a_commented_set_does_not_count() -> None:
    text = XML_SET + f"<!-- {XML_SET} -->" + XML_SET
    assert len(parse_element_sets(text, "f").entries) == 2


def test_a_key_that_stands_twice_is_refused() -> None:
    twice = json.dumps(message(43)).replace('"BSTAR"', '"BSTAR": 0.5, "BSTAR"', 1)
    (bad,) = parse_element_sets(json.dumps(message()) + twice, "f").not_used
    assert (bad.norad_id, bad.reason) == (43, "BSTAR stands twice")


def test_a_message_that_is_cut_off_counts_once() -> None:
    whole = written("kvn")
    found = parse_element_sets(whole + whole[: whole.index("ARG_OF_PERI") + 8], "f")
    assert (len(found.entries), len(found.not_used)) == (1, 1)


def test_many_faults_of_json_take_no_longer_each() -> None:
    bare = json.dumps(message(ECCENTRICITY=0.025)).replace("0.025", ".025")
    began = time.perf_counter()
    assert len(parse_element_sets(f"[{','.join([bare] * 3000)}]", "f").entries) == 3000
    assert "and 2,997 more" in refusal("[" + ",".join(['{"EPOCH": bad}'] * 3000) + "]")
    assert "and 1 more" not in refusal('[{"EPOCH": 1},' + "{" * 200_000)
    assert time.perf_counter() - began < 5.0
