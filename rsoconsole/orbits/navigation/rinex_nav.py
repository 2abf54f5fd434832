"""Broadcast ephemerides of navigation satellites: RINEX 2, 3 and 4. Pure.

GPS, Galileo, QZSS and BeiDou but for its geostationary ones. Good to 1 to 2 m.
Source: IGS RINEX 4.01; IS-GPS-200 table 20-IV; Galileo OS SIS ICD 5.1.1; BDS-SIS-ICD 5.2.4.12.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from rsoconsole.base import OrbitError
from rsoconsole.orbits.navigation.sp3 import (
    EARTH_RAD_S,
    GPS_MINUS_BDT_S,
    NavigationFile,
    make_navigation_file,
)
from rsoconsole.records import FloatArray
from rsoconsole.sky import IntArray
from rsoconsole.words import NS_PER_S

LONGEST_AGE_S = 7200.0
"""Longest time from the time of ephemeris: half the interval that a GPS message is fitted to."""
_MU_KM3_S2 = {"G": 398600.5, "J": 398600.5, "E": 398600.4418, "C": 398600.4418}
_TURN_RAD_S = {"G": 7.2921151467e-5, "J": 7.2921151467e-5, "E": 7.2921151467e-5, "C": 7.292115e-5}
_KEPLER_LINES = 8
_WEEK_S = 604_800
_GPS_EPOCH = datetime(1980, 1, 6)  # noqa: DTZ001 -- a calendar without leap seconds
_UNIX_S_OF_GPS_EPOCH = 315_964_800
_HALF_S = 0.5
_MIN_ROOT_A, _MAX_ROOT_A, _MAX_E = 4_500.0, 7_000.0, 0.5
_GEOSTATIONARY_RAD = 0.2
_MESSAGES = {"LNAV", "INAV", "FNAV", "D1", "D2"}
"""Message types of RINEX 4; the newer ones (CNAV) have other parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ephemeris:
    """One broadcast ephemeris; radians, seconds, angles at ``toe``, the time of ephemeris."""

    system: str
    toe_gps_ns: int
    toe_s: float
    """Time of ephemeris, as second of the system's week."""
    root_a: float
    """Root of the semi-major axis, root of metres."""
    e: float
    m0: float
    delta_n: float
    omega0: float
    omega_dot: float
    i0: float
    i_dot: float
    argp: float
    cuc: float
    cus: float
    crc: float
    crs: float
    cic: float
    cis: float

    def position_km(self, t_gps_ns: IntArray, after_s: float = 0.0) -> FloatArray:
        """Positions (N, 3), Earth-fixed, at the instants plus ``after_s``."""
        t_s = (t_gps_ns - self.toe_gps_ns) / NS_PER_S + after_s
        a_km = self.root_a**2 / 1000.0
        mean = self.m0 + (np.sqrt(_MU_KM3_S2[self.system] / a_km**3) + self.delta_n) * t_s
        eccentric = mean
        for _ in range(12):
            eccentric = eccentric - (eccentric - self.e * np.sin(eccentric) - mean) / (
                1.0 - self.e * np.cos(eccentric)
            )
        true = np.arctan2(np.sqrt(1.0 - self.e**2) * np.sin(eccentric), np.cos(eccentric) - self.e)
        latitude = true + self.argp
        sin_2, cos_2 = np.sin(2.0 * latitude), np.cos(2.0 * latitude)
        u = latitude + self.cus * sin_2 + self.cuc * cos_2
        r_km = a_km * (1.0 - self.e * np.cos(eccentric))
        r_km = r_km + (self.crs * sin_2 + self.crc * cos_2) / 1000.0
        i = self.i0 + self.i_dot * t_s + self.cis * sin_2 + self.cic * cos_2
        turn = _TURN_RAD_S[self.system]
        node = self.omega0 + (self.omega_dot - turn) * t_s - turn * self.toe_s
        x, y = r_km * np.cos(u), r_km * np.sin(u)
        return np.stack(
            [
                x * np.cos(node) - y * np.cos(i) * np.sin(node),
                x * np.sin(node) + y * np.cos(i) * np.cos(node),
                y * np.sin(i),
            ],
            axis=-1,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BroadcastOrbit:
    """Orbit of one satellite by its broadcast messages."""

    messages: tuple[Ephemeris, ...]

    def states_earth_fixed(self, t_gps_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities as ``EarthFixedOrbit``, by the nearest message.

        NaN where every message is more than `LONGEST_AGE_S` away in time.
        """
        t = np.atleast_1d(np.asarray(t_gps_ns, np.int64))
        toe = np.array([each.toe_gps_ns for each in self.messages], np.int64)
        nearest = np.argmin(np.abs(t[:, None] - toe), axis=1)
        r, v = np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
        for number in np.unique(nearest):
            chosen = nearest == number
            message = self.messages[int(number)]
            r[chosen] = message.position_km(t[chosen])
            before, after = (message.position_km(t[chosen], at) for at in (-_HALF_S, _HALF_S))
            v[chosen] = (after - before) / (2.0 * _HALF_S)
        v = v + EARTH_RAD_S * np.stack([-r[:, 1], r[:, 0], np.zeros(len(t))], axis=-1)
        is_old = np.min(np.abs(t[:, None] - toe), axis=1) > LONGEST_AGE_S * NS_PER_S
        return np.where(is_old[:, None], np.nan, r), np.where(is_old[:, None], np.nan, v)


def parse_rinex_nav(texts: dict[str, str]) -> NavigationFile:
    """Read RINEX texts, keyed by file name, as one set of orbits.

    An incomplete last message (the file was still being written) is left out. Raises OrbitError,
    naming file and line, for another kind of file or a damaged one.
    """
    found: dict[str, dict[int, Ephemeris]] = defaultdict(dict)
    skipped: Counter[str] = Counter()
    for source, text in texts.items():
        for name, message in _messages(text, source, skipped):
            found[name][message.toe_gps_ns] = message
    if not found:
        left_out = f" ({', '.join(skipped)})" if skipped else ""
        raise OrbitError(
            f"{', '.join(texts)}: no message of GPS, Galileo, QZSS or BeiDou{left_out}: give the"
            " mixed or GPS navigation file of the night"
        )
    orbits = {
        name: BroadcastOrbit(messages=tuple(of[toe] for toe in sorted(of)))
        for name, of in sorted(found.items())
    }
    first = min(each.messages[0].toe_gps_ns for each in orbits.values())
    last = max(each.messages[-1].toe_gps_ns for each in orbits.values())
    reach = round(LONGEST_AGE_S) * NS_PER_S
    return make_navigation_file("broadcast", orbits, (first - reach, last + reach), skipped)


def _messages(text: str, source: str, skipped: Counter[str]) -> Iterator[tuple[str, Ephemeris]]:
    lines = text.splitlines()
    version, system, start = _header(lines, source)
    for number, name, block in _blocks(lines, start, version, system, skipped):
        if name[0] not in _MU_KM3_S2:
            skipped[f"messages of {name[0]}"] += 1
            continue
        is_last = number - 1 + len(block) >= len(lines)
        if len(block) < _KEPLER_LINES and is_last:
            skipped["a message that breaks off"] += 1
            return
        try:
            message, is_healthy = _ephemeris(name[0], block, version)
        except (ValueError, IndexError) as error:
            if is_last:
                skipped["a message that breaks off"] += 1
                return
            raise OrbitError(
                f"{source}, line {number}: the message of {name} is damaged ({error}): fetch the"
                " file again"
            ) from error
        if not is_healthy:
            skipped["messages of satellites that call themselves unhealthy"] += 1
        elif name[0] == "C" and message.i0 < _GEOSTATIONARY_RAD:
            skipped["messages of geostationary BeiDou satellites"] += 1
        else:
            yield name, message


def _header(lines: list[str], source: str) -> tuple[float, str, int]:
    """Version, the system of a file that has only one, and the number of header lines."""
    refusal = OrbitError(
        f"{source} is no RINEX navigation file: its first line ends with RINEX VERSION / TYPE and"
        " says N or NAVIGATION"
    )
    if not lines or lines[0][60:80].strip() != "RINEX VERSION / TYPE":
        raise refusal
    try:
        version = float(lines[0][:9])
    except ValueError as error:
        raise refusal from error
    kind = lines[0][20:21].upper()
    if kind not in ("N", "G", "E", "H") or (kind != "N" and version >= 3.0):
        raise refusal
    if not 2.0 <= version < 5.0:
        raise OrbitError(f"{source} is RINEX {version:g}: 2, 3 and 4 are read")
    end = next((n for n, line in enumerate(lines) if line[60:73] == "END OF HEADER"), None)
    if end is None:
        raise OrbitError(f"{source} has no END OF HEADER: fetch the file again")
    return version, {"N": "G", "G": "R", "H": "S"}.get(kind, kind), end + 1


def _blocks(
    lines: list[str], start: int, version: float, system: str, skipped: Counter[str]
) -> Iterator[tuple[int, str, list[str]]]:
    """Yield (number of its first line, satellite, lines) of each message."""
    block: list[str] = []
    begin, name, is_wanted = 0, "", True
    for number, line in enumerate(lines[start:], start=start + 1):
        if line.startswith(">"):
            if block and is_wanted:
                yield begin, name, block
            parts = line[1:].split()
            is_wanted = parts[:1] == ["EPH"] and parts[-1] in _MESSAGES
            if parts[:1] == ["EPH"] and not is_wanted:
                skipped[f"messages {parts[-1]}"] += 1
            block = []
        elif line[: 2 if version < 3.0 else 1].strip():
            if block and is_wanted:
                yield begin, name, block
            begin, block = number, [line]
            is_old = version < 3.0
            name = f"{system}{line[:2].strip():0>2}" if is_old else line[:3].replace(" ", "0")
        elif line.strip() and block:
            block.append(line)
    if block and is_wanted:
        yield begin, name, block


def _ephemeris(system: str, block: list[str], version: float) -> tuple[Ephemeris, bool]:
    """Read a message, and whether its satellite calls itself healthy."""
    indent = 3 if version < 3.0 else 4
    rows = [_numbers(line, indent) for line in block[1:_KEPLER_LINES]]
    toc_s = _clock_s(block[0], version)
    toe_s = rows[2][0]
    weeks = round((toc_s - toe_s) / _WEEK_S)
    later_s = GPS_MINUS_BDT_S if system == "C" else 0
    toe_gps_ns = (_UNIX_S_OF_GPS_EPOCH + weeks * _WEEK_S + later_s) * NS_PER_S + round(
        toe_s * NS_PER_S
    )
    message = Ephemeris(
        system=system,
        toe_gps_ns=toe_gps_ns,
        toe_s=toe_s,
        crs=rows[0][1],
        delta_n=rows[0][2],
        m0=rows[0][3],
        cuc=rows[1][0],
        e=rows[1][1],
        cus=rows[1][2],
        root_a=rows[1][3],
        cic=rows[2][1],
        omega0=rows[2][2],
        cis=rows[2][3],
        i0=rows[3][0],
        crc=rows[3][1],
        argp=rows[3][2],
        omega_dot=rows[3][3],
        i_dot=rows[4][0],
    )
    if not (_MIN_ROOT_A <= message.root_a <= _MAX_ROOT_A and 0.0 <= message.e <= _MAX_E):
        raise ValueError(f"root of a {message.root_a:g}, e {message.e:g}")
    if not 0.0 <= toe_s <= _WEEK_S:
        raise ValueError(f"second of week {toe_s:g}")
    return message, rows[5][1] == 0.0


def _clock_s(line: str, version: float) -> float:
    """Time of clock of the message, seconds of its system since 1980-01-06."""
    text = line[3:22] if version < 3.0 else line[4:23]
    year, month, day, hour, minute, second = (float(part) for part in text.split()[:6])
    if version < 3.0:
        year += 1900 if year >= 80 else 2000
    whole = datetime(int(year), int(month), int(day), int(hour), int(minute))  # noqa: DTZ001
    return (whole - _GPS_EPOCH).total_seconds() + second


def _numbers(line: str, indent: int) -> list[float]:
    """Read up to four numbers of 19 columns; a blank one is 0."""
    fields = [line[indent + 19 * n : indent + 19 * (n + 1)].strip() for n in range(4)]
    values = [float(text.replace("D", "E").replace("d", "e")) if text else 0.0 for text in fields]
    if not all(np.isfinite(values)):
        raise ValueError("a number is none")
    return values
