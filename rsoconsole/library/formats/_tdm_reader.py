"""Reader of Tracking Data Messages: knows every keyword of the standard, returns the angles.

Reads the keyword = value form and XML, versions 1.0 and 2.0, times in UTC. What the standard does
not allow in header and metadata raises ExportError with the number of the line; a line of data
costs itself alone while other lines give angles.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import date

from rsoconsole.base import ExportError
from rsoconsole.library.formats._observed_csv import instant_utc_ns
from rsoconsole.library.formats.tdm import tdm_lines_from_xml
from rsoconsole.words import NS_PER_S

VERSIONS = ("1.0", "2.0")
TIME_SYSTEMS = ("UTC", "TAI", "GPS", "TT", "UT1", "TDB", "TCB", "TCG", "TDR", "MET", "MRT", "SCLK")
_EPOCH = re.compile(
    r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))T(\d{2}:\d{2}:\d{2})(?:\.(\d*))?Z?", re.ASCII
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_PATH = re.compile(r"\d(?:,\d)+", re.ASCII)
_NUMBERED = "12345"
_HEADER = {"CREATION_DATE", "ORIGINATOR", "MESSAGE_ID"}
_ERRORS: Mapping[str, tuple[str, ...]] = {
    "SIGMA": ("sigma_1_arcsec", "sigma_2_arcsec", "correlation"),
    "SIGMA_MAG": ("mag_sigma",),
}
"""Fields of the errors in our comments, by the comment's first word."""


def _with_numbers(*stems: str) -> set[str]:
    return {f"{stem}_{number}" for stem in stems for number in _NUMBERED}


_NUMBERS = {
    *("INTEGRATION_INTERVAL", "FREQ_OFFSET", "RANGE_MODULUS", "INTERPOLATION_DEGREE"),
    *("TURNAROUND_NUMERATOR", "TURNAROUND_DENOMINATOR", "DOPPLER_COUNT_BIAS"),
    *("DOPPLER_COUNT_SCALE", "CORRECTION_ANGLE_1", "CORRECTION_ANGLE_2", "CORRECTION_DOPPLER"),
    *("CORRECTION_MAG", "CORRECTION_RANGE", "CORRECTION_RCS", "CORRECTION_RECEIVE"),
    *("CORRECTION_TRANSMIT", "CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL"),
    *_with_numbers("TRANSMIT_DELAY", "RECEIVE_DELAY"),
}
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "TIME_SYSTEM": TIME_SYSTEMS,
    "MODE": ("SEQUENTIAL", "SINGLE_DIFF"),
    "TIMETAG_REF": ("TRANSMIT", "RECEIVE"),
    "INTEGRATION_REF": ("START", "MIDDLE", "END"),
    "RANGE_MODE": ("COHERENT", "CONSTANT", "ONE_WAY"),
    "ANGLE_TYPE": ("AZEL", "RADEC", "XEYN", "XSYE"),
    "DATA_QUALITY": ("RAW", "VALIDATED", "DEGRADED"),
    "CORRECTIONS_APPLIED": ("YES", "NO"),
    "DOPPLER_COUNT_ROLLOVER": ("YES", "NO"),
}
_TEXTS = {
    *("TRACK_ID", "DATA_TYPES", "TRANSMIT_BAND", "RECEIVE_BAND", "RANGE_UNITS", "INTERPOLATION"),
    *("REFERENCE_FRAME",),
    *_with_numbers("PARTICIPANT", "EPHEMERIS_NAME"),
}
_METADATA = {*_NUMBERS, *_CHOICES, *_TEXTS, "START_TIME", "STOP_TIME", "PATH", "PATH_1", "PATH_2"}
_DATA = {
    *("ANGLE_1", "ANGLE_2", "CARRIER_POWER", "CLOCK_BIAS", "CLOCK_DRIFT", "DOPPLER_COUNT"),
    *("DOPPLER_INSTANTANEOUS", "DOPPLER_INTEGRATED", "DOR", "MAG", "PC_N0", "PRESSURE", "PR_N0"),
    *("RANGE", "RCS", "RECEIVE_FREQ", "RHUMIDITY", "STEC", "TEMPERATURE", "TROPO_DRY"),
    *("TROPO_WET", "VLBI_DELAY"),
    *_with_numbers("RECEIVE_FREQ", "TRANSMIT_FREQ", "TRANSMIT_FREQ_RATE"),
    *_with_numbers("RECEIVE_PHASE_CT", "TRANSMIT_PHASE_CT"),
}
_BESIDE = {
    *("MAG", "RCS", "CARRIER_POWER", "PC_N0", "PR_N0", "PRESSURE", "RHUMIDITY", "TEMPERATURE"),
    *("STEC", "TROPO_DRY", "TROPO_WET", "CLOCK_BIAS", "CLOCK_DRIFT"),
}
"""Data that say nothing on where an object is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TdmAngles:
    """Both angles of one epoch; the errors are None unless the message's comments state them."""

    t_utc_ns: int
    angle_1_deg: float
    """First angle: right ascension where the segment's ANGLE_TYPE is RADEC."""
    angle_2_deg: float
    sigma_1_arcsec: float | None = None
    """One sigma of the first angle on the sky (times the cosine of the second angle)."""
    sigma_2_arcsec: float | None = None
    correlation: float | None = None
    mag: float | None = None
    """Apparent magnitude at the same epoch; None where the message has none."""
    mag_sigma: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TdmSegment:
    """One segment of a message, which holds one track: its metadata and its angles."""

    metadata: Mapping[str, str]
    """Values by keyword, as the message states them."""
    comments: tuple[str, ...]
    angles: tuple[TdmAngles, ...]
    """Epochs that have both angles, in the order of the file."""
    others: int
    """Number of data lines that are no angles of ``angles``."""
    beside: int = 0
    """Number of those that say nothing on where the object is: magnitudes, weather."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tdm:
    """A Tracking Data Message: its version, its header and its segments."""

    version: str
    header: Mapping[str, str]
    comments: tuple[str, ...]
    segments: tuple[TdmSegment, ...]
    not_used: tuple[str, ...] = ()
    """Lines of data that could not be read, each with its number and what is wrong."""


def parse_tdm(text: str, name: str = "the message") -> Tdm:
    """Parse a message in keyword = value form or XML; ``name`` is what errors call it.

    Raises ExportError, with the number of the line, for a text that is no such message, and for
    one whose only angles are on lines that cannot be read.
    """
    text = text.removeprefix("\ufeff")
    is_xml = text.lstrip().startswith("<")
    parser = _Parser(name=name, unit="element" if is_xml else "line")
    lines = list(tdm_lines_from_xml(text.lstrip(), name)) if is_xml else text.split("\n")
    if not is_xml and lines[-1].strip() not in _SECTION_MARKS:
        del lines[-1]  # cut off, or empty
    for number, line in enumerate(lines, start=1):
        stripped = line.strip()
        if stripped:
            parser.number = number
            parser.read_line(stripped)
    return parser.finished()


@dataclass(slots=True)
class _OpenSegment:
    metadata: dict[str, str] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)
    halves: dict[int, dict[str, float]] = field(default_factory=dict)
    errors: dict[int, dict[str, float]] = field(default_factory=dict)
    magnitudes: dict[int, float] = field(default_factory=dict)
    others: int = 0
    beside: int = 0
    faulty: set[int] = field(default_factory=set)
    """Epochs of angles that cannot be read, which are named line by line."""

    def closed(self) -> TdmSegment:
        pairs = {t: half for t, half in self.halves.items() if len(half) == 2}
        return TdmSegment(
            metadata=self.metadata,
            comments=tuple(self.comments),
            angles=tuple(
                TdmAngles(
                    t_utc_ns=t,
                    angle_1_deg=half["ANGLE_1"],
                    angle_2_deg=half["ANGLE_2"],
                    mag=self.magnitudes.get(t),
                    **self.errors.get(t, {}),
                )
                for t, half in pairs.items()
            ),
            others=self.others + len(self.halves.keys() - pairs.keys() - self.faulty),
            beside=self.beside,
        )


@dataclass(slots=True, kw_only=True)
class _Parser:
    """State of the parser."""

    name: str
    unit: str = "line"
    """Unit that ``number`` counts."""
    number: int = 0
    section: str = "start"
    version: str = ""
    header: dict[str, str] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)
    segments: list[TdmSegment] = field(default_factory=list)
    open: _OpenSegment = field(default_factory=_OpenSegment)
    faults: list[ExportError] = field(default_factory=list)
    """Faults of single lines of data."""

    def wrong(self, what: str) -> ExportError:
        return ExportError(f"{self.name}, {self.unit} {self.number}: {what}")

    def read_line(self, line: str) -> None:
        if self.section != "data" or line in _SECTION_MARKS:
            self._read(line)
            return
        try:
            self._read(line)
        except ExportError as error:
            self.faults.append(error)

    def _read(self, line: str) -> None:
        if line == "COMMENT" or line.startswith("COMMENT "):
            self._comment(line.removeprefix("COMMENT").strip())
            return
        if line in _SECTION_MARKS:
            before, after = _SECTION_MARKS[line]
            if self.section not in before:
                raise self.wrong(f"{line} cannot stand {_PLACES[self.section]}")
            self._enter_section(line, after)
            return
        keyword, equals, value = (part.strip() for part in line.partition("="))
        if not equals or not keyword or not value:
            raise self.wrong(f"{line[:60]!r} is not of the form KEYWORD = value")
        readers: Mapping[str, Callable[[str, str], None]] = {
            "start": self._first,
            "header": self._header,
            "metadata": self._metadata,
            "data": self._datum,
        }
        if self.section not in readers:
            raise self.wrong(f"{keyword} cannot stand {_PLACES[self.section]}")
        readers[self.section](keyword, value)

    def finished(self) -> Tdm:
        self.number += 1
        if self.section == "data":
            self.faults.append(self.wrong("the message ends before DATA_STOP"))
            self._enter_section("DATA_STOP", "between")
        if self.section != "between" or not self.segments:
            missing = {
                "start": "CCSDS_TDM_VERS",
                "metadata": "META_STOP",
                "meta read": "DATA_START",
            }
            raise self.wrong(f"the message ends before {missing.get(self.section, 'META_START')}")
        if self.faults and not any(each.angles for each in self.segments):
            raise self.faults[0]
        return Tdm(
            version=self.version,
            header=self.header,
            comments=tuple(self.comments),
            segments=tuple(self.segments),
            not_used=tuple(map(str, self.faults)),
        )

    def _enter_section(self, line: str, after: str) -> None:
        if line == "META_START":
            missing = {"CREATION_DATE", "ORIGINATOR"} - self.header.keys()
            if missing:
                raise self.wrong(f"the header has no {', '.join(sorted(missing))}")
            self.open = _OpenSegment()
        elif line == "META_STOP":
            missing = {"TIME_SYSTEM", "PARTICIPANT_1"} - self.open.metadata.keys()
            if missing:
                raise self.wrong(f"the metadata have no {', '.join(sorted(missing))}")
        elif line == "DATA_STOP":
            self.segments.append(self.open.closed())
        self.section = after

    def _first(self, keyword: str, value: str) -> None:
        if keyword != "CCSDS_TDM_VERS":
            raise self.wrong("a Tracking Data Message begins with CCSDS_TDM_VERS")
        if value not in VERSIONS:
            raise self.wrong(f"version {value!r}; this reads {' and '.join(VERSIONS)}")
        self.version, self.section = value, "header"

    def _header(self, keyword: str, value: str) -> None:
        if keyword not in _HEADER:
            raise self.wrong(f"{keyword} is no keyword of a header")
        if keyword == "CREATION_DATE":
            self._instant(value)
        self.header[keyword] = value

    def _metadata(self, keyword: str, value: str) -> None:
        if keyword not in _METADATA:
            raise self.wrong(f"{keyword} is no keyword of metadata")
        if keyword in self.open.metadata:
            raise self.wrong(f"{keyword} is there twice")
        if keyword in _NUMBERS:
            self._value(keyword, value)
        elif keyword in _CHOICES and value.upper() not in _CHOICES[keyword]:
            raise self.wrong(f"{keyword} {value!r}; one of {', '.join(_CHOICES[keyword])}")
        elif keyword == "TIME_SYSTEM" and value.upper() != "UTC":
            raise self.wrong(f"times in {value}: only UTC is read here")
        elif keyword in {"START_TIME", "STOP_TIME"}:
            self._instant(value)
        elif keyword.startswith("PATH") and _PATH.fullmatch(value) is None:
            raise self.wrong(f"{keyword} {value!r}; numbers of participants, as in 2,1")
        self.open.metadata[keyword] = value

    def _datum(self, keyword: str, value: str) -> None:
        if keyword not in _DATA:
            raise self.wrong(f"{keyword} is no keyword of data")
        parts = value.split()
        if len(parts) != 2:
            raise self.wrong(f"{keyword}: an epoch and one number belong there")
        t_utc_ns = self._instant(parts[0])
        try:
            number = self._value(keyword, parts[1])
        except ExportError:
            self.open.faulty.add(t_utc_ns)
            raise
        if keyword not in {"ANGLE_1", "ANGLE_2"}:
            self.open.others += 1
            self.open.beside += keyword in _BESIDE
            if keyword == "MAG":
                self.open.magnitudes.setdefault(t_utc_ns, number)
            return
        half = self.open.halves.setdefault(t_utc_ns, {})
        if keyword in half:
            raise self.wrong(f"{keyword} is there twice for one epoch")
        half[keyword] = number

    def _comment(self, text: str) -> None:
        if self.section in {"start", "header"}:
            self.comments.append(text)
            return
        parts = text.split()
        names = _ERRORS.get(parts[0], ()) if parts and self.section == "data" else ()
        if names and len(parts) == 2 + len(names):
            values = (self._value(parts[0], part) for part in parts[2:])
            errors = self.open.errors.setdefault(self._instant(parts[1]), {})
            errors.update(zip(names, values, strict=True))
            return
        self.open.comments.append(text)

    def _value(self, keyword: str, text: str) -> float:
        if _NUMBER.fullmatch(text) is None:
            raise self.wrong(f"{keyword} {text!r} is no number")
        return float(text)

    def _instant(self, text: str) -> int:
        match = _EPOCH.fullmatch(text)
        if match is None:
            raise self.wrong(f"{text!r} is no epoch: 2023-06-23T05:31:05.3 or 2023-174T05:31:05.3")
        year, month, day, day_of_year, clock, fraction = match.groups()
        try:
            if day_of_year is not None:
                first = date(int(year), 1, 1)
                that = date.fromordinal(first.toordinal() + int(day_of_year) - 1)
                if that.year != first.year:
                    raise ValueError(f"{year} has no day {day_of_year}")
                year, month, day = that.isoformat().split("-")
            whole_ns = instant_utc_ns(f"{year}-{month}-{day}T{clock}Z")
        except ValueError as error:
            raise self.wrong(str(error)) from error
        return whole_ns + round(int((fraction or "0")[:18].ljust(18, "0")) / NS_PER_S)


_PLACES = {
    "start": "before CCSDS_TDM_VERS",
    "header": "in the header",
    "metadata": "among metadata",
    "meta read": "between META_STOP and DATA_START",
    "data": "among data",
    "between": "between two segments",
}
_SECTION_MARKS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "META_START": (("header", "between"), "metadata"),
    "META_STOP": (("metadata",), "meta read"),
    "DATA_START": (("meta read",), "data"),
    "DATA_STOP": (("data",), "between"),
}
"""Section marks: where each may stand, and what it leads to."""
