"""Damaged element sets of every form: one error at most, no set lost in silence, none bent."""

import json
import random
import re
import time
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from rsoconsole.base import OrbitError
from rsoconsole.orbits import CatalogueEntry, parse_element_sets
from rsoconsole.orbits.elements.elements import checksum

QUICK_S = 2.0
COUNT = 7
FIRST_NUMBER = 40_001
PLAIN, ALL = 1000, 10_000

IN_METADATA = ("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "TIME_SYSTEM", "MEAN_ELEMENT_THEORY")


def message(number: int) -> dict[str, object]:
    """One made-up object, with other figures for each number."""
    draw = random.Random(number)
    return {
        "OBJECT_NAME": f"OBJECT {number}",
        "OBJECT_ID": "2009-064A",
        "CENTER_NAME": "EARTH",
        "TIME_SYSTEM": "UTC",
        "MEAN_ELEMENT_THEORY": "SGP4",
        "EPOCH": f"2023-06-{draw.randint(10, 28)}T{draw.randint(10, 23)}:00:00.123456",
        "MEAN_MOTION": round(draw.uniform(11.0, 15.5), 8),
        "ECCENTRICITY": round(draw.uniform(0.0001, 0.01), 7),
        "INCLINATION": round(draw.uniform(20.0, 99.0), 4),
        "RA_OF_ASC_NODE": round(draw.uniform(0.0, 360.0), 4),
        "ARG_OF_PERICENTER": round(draw.uniform(0.0, 360.0), 4),
        "MEAN_ANOMALY": round(draw.uniform(0.0, 360.0), 4),
        "EPHEMERIS_TYPE": 0,
        "CLASSIFICATION_TYPE": "U",
        "NORAD_CAT_ID": number,
        "ELEMENT_SET_NO": 999,
        "REV_AT_EPOCH": 4984,
        "BSTAR": round(draw.uniform(-0.001, 0.001), 8),
        "MEAN_MOTION_DOT": 0.00001,
        "MEAN_MOTION_DDOT": 0,
    }


def two_lines(number: int, *, is_named: bool) -> str:
    it = message(number)
    day = 161.0 + number % 17 + 0.12345678
    bstar = random.Random(number).randint(10_000, 99_999)
    line_1 = f"1 {number:05d}U 09064A   23{day:012.8f}  .00001000  00000-0  {bstar}-3 0  999"
    line_2 = (
        f"2 {number:05d} {it['INCLINATION']:8.4f} {it['RA_OF_ASC_NODE']:8.4f}"
        f" {round(float(str(it['ECCENTRICITY'])) * 1e7):07d} {it['ARG_OF_PERICENTER']:8.4f}"
        f" {it['MEAN_ANOMALY']:8.4f} {it['MEAN_MOTION']:11.8f} 4984"
    )
    lines = [f"{each}{checksum(each)}" for each in (line_1, line_2)]
    return "\n".join([f"OBJECT {number}"] * is_named + lines) + "\n"


def xml_segment(number: int) -> str:
    it = message(number)
    metadata = "".join(f"<{key}>{it[key]}</{key}>" for key in IN_METADATA)
    data = "".join(f"<{key}>{it[key]}</{key}>" for key in it if key not in IN_METADATA)
    return (
        '<omm id="CCSDS_OMM_VERS" version="2.0"><header/><body><segment>'
        f"<metadata>{metadata}</metadata><data>{data}</data></segment></body></omm>\n"
    )


def kvn_message(number: int) -> str:
    lines = "".join(f"{key} = {value}\n" for key, value in message(number).items())
    return f"CCSDS_OMM_VERS = 3.0\nCREATION_DATE = 2023-06-{number % 9 + 10}\n{lines}\n"


@dataclass(frozen=True)
class Form:
    """A form of element sets: its head, its sets and its end."""

    head: str
    one: Callable[[int], str]
    end: str = ""

    def parts(self) -> list[str]:
        ones = [self.one(FIRST_NUMBER + n) for n in range(COUNT)]
        return [self.head, *ones, self.end]


FORMS = {
    "three lines": Form("", lambda number: two_lines(number, is_named=True)),
    "two lines": Form("", lambda number: two_lines(number, is_named=False)),
    "json": Form("[\n", lambda number: json.dumps(message(number)) + ",\n", "]\n"),
    "xml": Form("<ndm>\n", xml_segment, "</ndm>\n"),
    "csv": Form(
        ",".join(message(1)) + "\n",
        lambda number: ",".join(map(str, message(number).values())) + "\n",
    ),
    "kvn": Form("", kvn_message),
}


def figures(entry: CatalogueEntry) -> tuple[object, ...]:
    it = entry.record
    mean = (it.no_kozai, it.ecco, it.inclo, it.nodeo, it.argpo, it.mo, it.bstar)
    return (entry.norad_id, entry.epoch_utc_ns, *mean)


def read(text: str | bytes) -> tuple[set[tuple[object, ...]], int, str]:
    """The sets used, the number of those named, and what the error says."""
    began_s = time.monotonic()
    try:
        found = parse_element_sets(text, "f")
    except OrbitError as error:
        words = str(error)
        count = max(len(re.findall(r"f, (?:line|object) \d+", words)), 1)
        more = re.search(r"and (\d+) more$", words)
        return set(), count + int(more[1]) if more else count, words
    finally:
        assert time.monotonic() - began_s < QUICK_S
    assert all(each.reason and each.words for each in found.not_used)
    return {figures(each) for each in found.entries}, len(found.not_used), ""


def flipped(draw: random.Random, text: str) -> str:
    at = draw.randrange(len(text) - 1)
    alphabet = "0123456789 .+-eE\"'<>{}[],=:&#\t\f\x00éN\u2028\U0001f6f0abUZ"
    return text[:at] + draw.choice(alphabet) + text[at + 1 :]


def shifted(draw: random.Random, text: str) -> str:
    at = draw.randrange(len(text) - 1)
    return text[:at] + (" " + text[at:] if draw.random() < 0.5 else text[at + 1 :])


def swapped(draw: random.Random, text: str) -> str:
    words = re.split(r"(\s+|,)", text)
    a, b = (draw.randrange(len(words)) for _ in range(2))
    words[a], words[b] = words[b], words[a]
    return "".join(words).rstrip("\n") + "\n"


def bent(draw: random.Random, text: str) -> str:
    """Some number is no number, or one beyond its range."""
    numbers = list(re.finditer(r"-?\d+\.\d+", text))
    one = draw.choice(numbers)
    value = draw.choice(["nan", "NaN", "inf", "-Infinity", "1e999", "-5", "400", "", "null", "1_0"])
    return text[: one.start()] + value + text[one.end() :]


def without_line(draw: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if len(lines) > 1:
        del lines[draw.randrange(len(lines))]
    return "".join(lines)


def with_line_twice(draw: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    at = draw.randrange(len(lines))
    return "".join([*lines[: at + 1], *lines[at:]])


DAMAGES = (flipped, shifted, swapped, bent, without_line, with_line_twice)
seeds = pytest.mark.parametrize(
    "numbers",
    [
        range(PLAIN),
        pytest.param(range(PLAIN, ALL), marks=pytest.mark.nightly("more cases of the same")),
    ],
    ids=["some", "many"],
)


@seeds
@pytest.mark.parametrize("name", FORMS)
def test_a_damaged_set_costs_itself_alone_and_is_used_or_named(name: str, numbers: range) -> None:
    parts = FORMS[name].parts()
    whole, _, _ = read("".join(parts))
    assert len(whole) == COUNT
    for seed in numbers:
        draw = random.Random(seed)
        hurt = draw.randrange(COUNT)
        damaged = list(parts)
        damaged[hurt + 1] = draw.choice(DAMAGES)(draw, parts[hurt + 1])
        used, named, error = read("".join(damaged))
        others = {each for each in whole if each[0] != FIRST_NUMBER + hurt}
        assert others <= used, (seed, damaged[hurt + 1], error)
        assert len(used) + named >= COUNT, (seed, damaged[hurt + 1])


@seeds
@pytest.mark.parametrize("name", FORMS)
def test_of_a_file_that_ends_too_early_what_is_whole_is_used(name: str, numbers: range) -> None:
    parts = FORMS[name].parts()
    text = "".join(parts)
    whole, _, _ = read(text)
    ends = [len("".join(parts[: n + 2]).rstrip(" \n,")) for n in range(COUNT)]
    for seed in numbers:
        at = random.Random(seed).randrange(len(text))
        used, named, _ = read(text[:at].encode())
        count = sum(end <= at for end in ends)
        assert len(used & whole) >= count, (seed, text[:at][-200:])
        cut = text[:at].removeprefix("".join(parts[: count + 1]).rstrip(" \n,"))
        # Where enough of the next is there to tell that it was to be a set.
        if len(cut.strip()) > 70:
            assert len(used) + named > count, (seed, cut)


@seeds
@pytest.mark.parametrize("name", FORMS)
def test_no_damage_of_any_kind_is_more_than_an_error_of_elements(name: str, numbers: range) -> None:
    text = "".join(FORMS[name].parts())
    for seed in numbers:
        draw = random.Random(seed)
        damaged = text
        for _ in range(draw.randint(1, 6)):
            damaged = draw.choice(DAMAGES)(draw, damaged) if len(damaged) > 200 else damaged
        content = bytearray(damaged.encode(draw.choice(["utf-8", "utf-16", "utf-8-sig"])))
        for _ in range(draw.randint(0, 4)):
            content[draw.randrange(len(content))] = draw.randrange(256)
        read(bytes(content))


@seeds
def test_a_field_out_of_its_columns_is_refused_or_means_the_same(numbers: range) -> None:
    """A blank moved from one side of a field to the other leaves checksums right."""
    for seed in numbers:
        draw = random.Random(seed)
        text = two_lines(FIRST_NUMBER + seed % 90, is_named=False)
        (true,), _, _ = read(text)
        lines = text.splitlines()
        row = draw.randrange(2)
        fields = list(re.finditer(r"\S+", lines[row][:63]))[1:]
        one = draw.choice(fields)
        before, after = lines[row][: one.start()], lines[row][one.end() :]
        if draw.random() < 0.5:
            lines[row] = before[:-1] + one[0] + " " + after
        else:
            lines[row] = before + " " + one[0] + after.replace(" ", "", 1)
        used, named, _ = read("\n".join(lines))
        assert used == {true} or (not used and named), (seed, lines)
