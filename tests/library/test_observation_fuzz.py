"""Damaged observations of others: a sentence or directions, at once, and no line is lost.

Mutations are seeded: a thousand of each reader with every run, ten thousand a night.
"""

import contextlib
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rsoconsole.base import ExportError, OrbitError
from rsoconsole.library import ReadOptions, read_observations
from rsoconsole.library.formats._observed_csv import ReadRows
from rsoconsole.library.formats._stations import read_stations
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.library.formats.observed import parse_observations
from rsoconsole.records import Site
from tests.library.test_observation_lines import IOD, TABLE, UK

TWO_SECONDS = 2.0
HEAD = (
    "CCSDS_TDM_VERS = 2.0\nCREATION_DATE = 2023-06-24T00:00:00\nORIGINATOR = ME\nMETA_START\n"
    "TIME_SYSTEM = UTC\nPARTICIPANT_1 = HILL\nPARTICIPANT_2 = THING\nPATH = 2,1\n"
    "ANGLE_TYPE = RADEC\nREFERENCE_FRAME = EME2000\nMETA_STOP\nDATA_START\n"
)
KVN = HEAD + "".join(
    f"ANGLE_1 = 2023-06-23T05:3{n}:05.3 {313 + n}.5\nANGLE_2 = 2023-06-23T05:3{n}:05.3 -4.{n}\n"
    for n in range(4)
)
XML = (
    '<?xml version="1.0"?>\n<tdm version="2.0" id="CCSDS_TDM_VERS"><header><CREATION_DATE>'
    "2023-06-24T00:00:00</CREATION_DATE><ORIGINATOR>ME</ORIGINATOR></header><body><segment>"
    "<metadata><TIME_SYSTEM>UTC</TIME_SYSTEM><PARTICIPANT_1>HILL</PARTICIPANT_1><PARTICIPANT_2>"
    "THING</PARTICIPANT_2><PATH>2,1</PATH><ANGLE_TYPE>RADEC</ANGLE_TYPE></metadata><data>\n"
    + "\n".join(
        f"<observation><EPOCH>2023-06-23T05:3{n}:05.3</EPOCH><ANGLE_1>{313 + n}.5</ANGLE_1>"
        f"</observation>\n<observation><EPOCH>2023-06-23T05:3{n}:05.3</EPOCH><ANGLE_2>-4.{n}</ANGLE_2>"
        "</observation>"
        for n in range(4)
    )
    + "\n</data></segment></body></tdm>\n"
)
SIGMAS = [
    "time,ra_deg,dec_deg,sigma_arcsec,time_sigma_s,norad,station,lat_deg,lon_deg,alt_m",
    *(f"2023-06-22T03:0{n}:00.5,{10 + n}.25,5.5,2.5,0.1,5,HILL,52.5,6.5,10" for n in range(5)),
]
STATIONS = [
    "# list",
    "No ID Latitude Longitude Elev Observer",
    *(f"417{n} AA 52.{n} -6.4 10 Observer {n}" for n in range(6)),
]
TEXTS = {
    "tdm": KVN + "DATA_STOP\n",
    "tdm-xml": XML,
    "iod": "\n".join(IOD),
    "uk": "\n".join(UK),
    "csv": "\n".join(TABLE),
    "csv with sigmas": "\n".join(SIGMAS),
}
ALPHABET = "0123456789+-.,;:eE \t\n\r\"'<>&#=/\\NaninfTZ\u00e9\u2028\x00\x1a\x0c\u0661ABCxyz"


def damaged(text: str, draw: random.Random) -> str:
    """The text after one to four mutations: characters, cuts, whole lines."""
    for _ in range(draw.randint(1, 4)):
        at, width = draw.randrange(len(text) + 1), draw.choice([1, 1, 1, 2, 5, 40])
        some = "".join(draw.choices(ALPHABET, k=width))
        kind = draw.randrange(7)
        if kind == 0:
            text = text[:at] + some + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + width :]
        elif kind == 2:
            text = text[:at] + some + text[at + width :]
        elif kind == 3:
            lines = text.split("\n")
            draw.shuffle(lines)
            text = "\n".join(lines) if draw.random() < 0.2 else text
        elif kind == 4:
            lines = text.split("\n")
            lines.insert(draw.randrange(len(lines) + 1), draw.choice(lines))
            text = "\n".join(lines)
        elif kind == 5:
            digits = [n for n, each in enumerate(text) if each.isdigit()]
            n = draw.choice(digits) if digits else 0
            text = text[:n] + draw.choice("0123456789") * draw.choice([1, 1, 30]) + text[n + 1 :]
        elif draw.random() < 0.1:
            text = text[:at]
    return text


def expect_each_ends(text: str, read: Callable[[str], object], seeds: range) -> None:
    """Every damaged text is read or refused with one sentence, within two seconds."""
    for seed in seeds:
        changed = damaged(text, random.Random(seed))
        begun = time.process_time()
        with contextlib.suppress(ExportError, OrbitError):
            read(changed)
        assert time.process_time() - begun < TWO_SECONDS, seed


def content_lines(text: str) -> list[str]:
    return [each for each in text.splitlines() if each.strip() and not each.startswith("#")]


def read_and_count(kind: str) -> Callable[[str], None]:
    """Read a text and hold what it gives against its lines."""

    def read(text: str) -> None:
        found = parse_observations(text, Path("file"))
        if found is None:
            return
        rows = sum_of(found)
        if kind in {"iod", "uk"} and not text.lstrip().startswith(
            ("{", "[", "<", "CCSDS_TDM_VERS")
        ):
            marks = [each for each in content_lines(text) if each.lstrip("> ")]
            heading = 1 if is_table(text) else 0
            assert rows == len(marks) - heading, text
        elif kind.startswith("csv") and is_table(text):
            assert rows == len(content_lines(text)) - 1, text

    return read


def is_table(text: str) -> bool:
    from rsoconsole.library.formats._observed_csv import looks_like_table

    return looks_like_table(text)


def sum_of(found: ReadRows) -> int:
    return len(found.rows) + len(found.not_used)


@pytest.mark.parametrize("kind", TEXTS)
def test_a_thousand_damaged_files_of_each_kind(kind: str) -> None:
    expect_each_ends(TEXTS[kind], read_and_count(kind), range(1_000))


@pytest.mark.nightly("ten thousand mutations of each reader")
@pytest.mark.timeout(600)
@pytest.mark.parametrize("kind", TEXTS)
def test_ten_thousand_damaged_files_of_each_kind(kind: str) -> None:
    expect_each_ends(TEXTS[kind], read_and_count(kind), range(1_000, 11_000))


def count_stations(text: str) -> None:
    found = read_stations(Path("list"), text)
    lines = [each for each in text.splitlines() if each.strip()]
    lines = [each for each in lines if not each.strip().startswith(("#", "!", "//"))]
    lines = [each for each in lines if any(c.isdigit() for c in each)]
    # A station that stands there twice, at one place, is one site.
    assert len(found.not_used) <= len(lines)
    assert len(found.sites) + len(found.not_used) <= len(lines)
    if len(set(lines)) == len(lines):
        # A heading is one with a digit in it too.
        first = {each.split()[0] for each in lines if "itude" not in each}
        named = {each for each in first if any(c.isdigit() for c in each)}
        assert len(found.sites) + len(found.not_used) >= len(named)


@pytest.mark.parametrize(
    "seeds",
    [
        range(1_000),
        pytest.param(range(1_000, 11_000), marks=pytest.mark.nightly("ten thousand mutations")),
    ],
    ids=["first", "more"],
)
def test_damaged_lists_of_stations_lose_no_line(seeds: range) -> None:
    expect_each_ends("\n".join(STATIONS), count_stations, seeds)


def test_data_lines_of_a_damaged_message_are_used_or_named() -> None:
    """Digits and characters changed inside the data alone: halves and whole pairs add up."""
    head, data = KVN[: len(HEAD)], KVN[len(HEAD) :]
    for seed in range(1_000):
        draw = random.Random(seed)
        lines = data.splitlines()
        n = draw.randrange(len(lines))
        at = draw.randrange(len(lines[n]))
        lines[n] = lines[n][:at] + draw.choice("0123456789xX.-: ") + lines[n][at + 1 :]
        message = parse_tdm(head + "\n".join(lines) + "\nDATA_STOP\n")
        (segment,) = message.segments
        halves = 2 * len(segment.angles) + segment.others + len(message.not_used)
        # A line that is named stands for the other half of its epoch too.
        assert len(lines) - len(message.not_used) <= halves <= len(lines), (seed, lines[n])


def test_through_a_file_nothing_else_escapes(tmp_path: Path) -> None:
    ask = ReadOptions(site=Site(latitude_deg=52.0, longitude_deg=6.0, elevation_m=0.0))
    path = tmp_path / "file.txt"

    def read(text: str) -> None:
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        read_observations(path, ask)

    for text in TEXTS.values():
        expect_each_ends(text, read, range(20_000, 20_150))
