"""When a frame was exposed and for how long, from any of the cards that say so.

Start, in order of trust: the camera's GPS receiver, DATE-OBS, DATE-BEG, MJD-OBS, MJD-BEG, DATE-AVG,
MJD-AVG, DATE-END, MJD-END, JD. Of those that agree with the first, the one written most finely is
used; those that disagree are notes. Source: FITS standard 4.0, chapter 9.
"""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal

from rsoconsole.instruments.frames.gps_receiver import gps_time
from rsoconsole.instruments.frames.header_cards import SECONDS, Cards, shown_value
from rsoconsole.instruments.frames.header_dates import (
    FIRST_YEAR,
    LAST_YEAR,
    TimeOfDay,
    WrittenDate,
    numeric_times,
    parse_date,
    parse_time_of_day,
    time_scale,
)
from rsoconsole.sky import JD_UNIX, MJD_UNIX, TIME_SCALES, utc_ns_of_scale
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

EXPOSURE_KEYS: Mapping[str, float] = {
    **dict.fromkeys(("EXPTIME", "EXPOSURE", "XPOSURE", "EXP_TIME", "EXP-TIME", "EXPTIM"), 1.0),
    **dict.fromkeys(("ITIME", "INTTIME", "INT_TIME", "INT-TIME", "ONTIME", "LIVETIME"), 1.0),
    **dict.fromkeys(("TELAPSE", "ELAPTIME"), 1.0),
    **dict.fromkeys(("EXPTIMMS", "EXPTIMEM", "EXP_MS", "EXP-MS", "EXPOSMS"), 1e-3),
    **dict.fromkeys(("EXPOINUS", "EXP_US", "EXP-US", "EXPTIMUS"), 1e-6),
}
"""Keys of the exposure time, the most trusted first, and the unit of a plain number, s."""
MAX_EXPOSURE_S = 1e6
_ELAPSED = ("TELAPSE", "ELAPTIME")
"""Keys of the time from start to end, pauses included."""

_TIME_KEYS = (
    *("TIME-OBS", "TIME_OBS", "TIMEOBS", "UT", "UTC", "UTC-OBS", "UTC_OBS", "UT-OBS", "UTSTART"),
    *("UT-START", "UTCSTART", "UTC-STAR", "UTSHUT", "TIME-BEG", "UT-BEG", "UTC-BEG"),
)
_DATES = (
    ("DATE-OBS", _TIME_KEYS),
    ("DATE_OBS", _TIME_KEYS),
    ("DATEOBS", _TIME_KEYS),
    ("UTDATE", _TIME_KEYS),
    ("DATE-BEG", ("TIME-BEG",)),
)
_TAI_TIME = "TAIHMS"
"""Time of day beside DATE-OBS in headers of the SDSS, always TAI."""
Moment = Literal["start", "middle", "end"]
_DAYS: tuple[tuple[str, Moment, float], ...] = (
    ("MJD-OBS", "start", MJD_UNIX),
    ("MJD_OBS", "start", MJD_UNIX),
    ("MJD-BEG", "start", MJD_UNIX),
    ("DATE-AVG", "middle", 0.0),
    ("MJD-AVG", "middle", MJD_UNIX),
    ("DATE-END", "end", 0.0),
    ("MJD-END", "end", MJD_UNIX),
    ("JD-OBS", "start", JD_UNIX),
    ("JD", "start", JD_UNIX),
    ("JD_UTC", "middle", JD_UNIX),
)
"""Further keys: which moment each names, and 1970 in its count of days; 0 for a date."""
_CONVENTIONS = {
    "JD": "the start of the exposure, as MaxIm DL writes it",
    "JD-OBS": "the start of the exposure",
    "JD_UTC": "mid-exposure, as SharpCap and AstroImageJ write it",
}
"""Keys of no standard, and which moment they are taken for."""
_TOPOCENTRES = ("TOPOCENT", "GEOCENT", "RELOCATA", "CUSTOM")
_TOLERANCE_NS = NS_PER_S // 10
"""Difference of two times of one exposure that is no contradiction, beside their rounding.

Programs stamp order and shutter some hundredths of a second apart; at 15 arcsec/s a tenth moves a
geostationary satellite by 1.5 arcsec.
"""
_MAX_SLACK_NS = NS_PER_DAY // 10_000
"""Rounding of a count of days that is believed: a number has lost the zeros at its end."""
_COARSE_NS = NS_PER_S
"""Step of the last digit beyond which the time is noted as coarse."""
_FINE_NS, _MUCH_FINER = NS_PER_S // 1000, 10
"""Step that is fine enough, and the ratio of steps from which a finer time is taken."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureTime:
    """Start and length of an exposure, by its header."""

    start_utc_ns: int | None
    exposure_s: float | None
    time_by: Literal["header", "gps"]
    fault: str
    """Reason why start or length is not known; empty where both are."""
    notes: tuple[str, ...]
    """Sentences on values that are not used, contradict each other or are coarse."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Instant:
    """One statement of a header about start, middle or end of its exposure."""

    words: str
    utc_ns: int
    step_ns: int
    """One unit of the last digit."""
    slack_ns: int
    """Difference from another time that the rounding explains."""
    moment: Moment


def exposure_time(header: Mapping[str, Any]) -> ExposureTime:
    """Return start and length of the exposure, and what of the header is not used, and why."""
    reader = _TimeReader(header)
    length_s = reader.length_s()
    instants = list(reader.instants())
    if length_s is None:
        length_s = reader.length_between(instants)
    stated_ns = reader.start_utc_ns(instants, length_s)
    gps_ns, why_not = gps_time(header, stated_ns, length_s)
    if why_not is not None:
        reader.cards.note(why_not)
    start_ns = stated_ns if gps_ns is None else gps_ns
    faults = [] if start_ns is not None else [reader.start_fault()]
    faults += [] if length_s is not None else [reader.length_fault()]
    return ExposureTime(
        start_utc_ns=start_ns,
        exposure_s=length_s,
        time_by="header" if gps_ns is None else "gps",
        fault=_joined(faults),
        notes=tuple(reader.cards.notes),
    )


def exposure_s(header: Mapping[str, Any]) -> float | None:
    """Return the exposure time, s; None where no card states it."""
    return exposure_time(header).exposure_s


def _joined(faults: list[str]) -> str:
    missing = [each.removesuffix(_MISSING) for each in faults if each.endswith(_MISSING)]
    if len(missing) == 2:
        return f"{missing[0]} and {missing[1]} are missing"
    return "; ".join(faults)


_MISSING = " is missing"


class _TimeReader:
    """Reads the cards about time of one header."""

    def __init__(self, header: Mapping[str, Any]) -> None:
        self.cards = Cards(header)
        self._start_faults: list[str] = []
        self._dateless: list[tuple[str, int]] = []
        """Faults of dates without a time of day, which are none where another card has the time.

        Each with its day since 1970.
        """
        self._scale, self._scale_fault = self._time_scale()

    def _time_scale(self) -> tuple[str | None, str]:
        """Time scale of the header; None with the reason where it is not converted to UTC."""
        place = self.cards.value("TREFPOS")
        if isinstance(place, str) and not place.strip().upper().startswith(_TOPOCENTRES):
            return None, f"TREFPOS {shown_value(place)} refers the time to another place"
        stated = self.cards.value("TIMESYS")
        if stated is None:
            return "UTC", ""
        scale = time_scale(str(stated))
        if scale is None:
            return None, (
                f"TIMESYS {shown_value(stated)} is no time scale that can be converted to UTC"
                f" ({', '.join(TIME_SCALES)} can)"
            )
        return scale, ""

    def length_s(self) -> float | None:
        """Exposure time by the first card that states it; others that differ become notes."""
        first: tuple[str, float] | None = None
        for key, unit_s in EXPOSURE_KEYS.items():
            seconds = self.cards.number(
                key,
                "an exposure time of more than 0 s",
                low=1e-9,
                high=MAX_EXPOSURE_S,
                units=SECONDS,
                plain=unit_s,
            )
            if seconds is None:
                continue
            if first is None:
                first = key, seconds
            elif key not in _ELAPSED and abs(seconds - first[1]) > max(0.01, 0.05 * first[1]):
                self.cards.note(
                    f"{key} says {seconds:g} s, {first[0]} {first[1]:g} s: {first[0]} is used"
                )
        return None if first is None else first[1]

    def length_between(self, instants: list[_Instant]) -> float | None:
        """Exposure time from the first start to the first end, where no card states it."""
        start = next((each for each in instants if each.moment == "start"), None)
        end = next((each for each in instants if each.moment == "end"), None)
        if start is None or end is None or not 0 < end.utc_ns - start.utc_ns < NS_PER_DAY:
            return None
        seconds = (end.utc_ns - start.utc_ns) / NS_PER_S
        self.cards.note(
            f"no card states the exposure time: from {start.words} to {end.words} it is"
            f" {seconds:g} s"
        )
        return seconds

    def length_fault(self) -> str:
        """Reason why the exposure time is not known."""
        unread = [
            note for key in EXPOSURE_KEYS for note in self.cards.notes if note.startswith(f"{key} ")
        ]
        return unread[0] if unread else f"EXPTIME{_MISSING}"

    def start_utc_ns(self, instants: list[_Instant], length_s: float | None) -> int | None:
        """Start by the most trusted card; those that contradict it become notes."""
        starts = [
            (each, each.utc_ns - round(before_s * NS_PER_S))
            for each in instants
            if (before_s := _seconds_before(each.moment, length_s)) is not None
        ]
        if not starts:
            self._start_faults += [words for words, _ in self._dateless]
            for each in instants:
                self._start_faults.append(f"{each.words} needs an exposure time to give the start")
            return None
        starts = self._utc_in_spite_of_scale(starts)
        first, first_ns = starts[0]
        chosen, chosen_ns = first, first_ns
        for each, start_ns in starts[1:]:
            off_ns = start_ns - first_ns
            if abs(off_ns) > first.slack_ns + each.slack_ns + _TOLERANCE_NS:
                self.cards.note(_contradiction(first, first_ns, each, start_ns))
                continue
            is_same = abs(off_ns) <= first.step_ns + each.step_ns
            if is_same and max(each.step_ns, _FINE_NS) * _MUCH_FINER <= chosen.step_ns:
                chosen, chosen_ns = each, start_ns
        for words, day in self._dateless:
            if abs(day - chosen_ns // NS_PER_DAY) > 1:
                self.cards.note(f"{words}; {first.words} is of another day, and is used")
        if chosen.step_ns > _COARSE_NS:
            self.cards.note(
                f"the time of exposure by {chosen.words} is known to"
                f" {chosen.step_ns / NS_PER_S:.3g} s only"
            )
        if chosen.words in _CONVENTIONS:
            self.cards.note(f"{chosen.words} is taken as {_CONVENTIONS[chosen.words]}")
        return chosen_ns

    def _utc_in_spite_of_scale(
        self, starts: list[tuple[_Instant, int]]
    ) -> list[tuple[_Instant, int]]:
        """Take the first card, and those that agree with it, as UTC where a later one says so.

        Pipelines set TIMESYS to TAI for the cards that they add, and leave DATE-OBS as it was.
        """
        first, first_ns = starts[0]
        if self._scale in ("UTC", None):
            return starts
        # The scale's lead over UTC hardly changes within a minute.
        ahead_ns = first_ns - utc_ns_of_scale(first_ns, str(self._scale))
        for each, start_ns in starts[1:]:
            allowed_ns = first.slack_ns + each.slack_ns + _TOLERANCE_NS
            if abs(start_ns - first_ns - ahead_ns) > allowed_ns or abs(ahead_ns) <= allowed_ns:
                continue
            self.cards.note(
                f"{first.words} is UTC although TIMESYS is {self._scale}: so it agrees with"
                f" {each.words}"
            )
            return [
                (one, ns + (ahead_ns if abs(ns - first_ns) <= allowed_ns else 0))
                for one, ns in starts
            ]
        return starts

    def start_fault(self) -> str:
        """Reason why the start is not known."""
        return "; ".join(dict.fromkeys(self._start_faults)) or f"DATE-OBS{_MISSING}"

    def instants(self) -> Iterator[_Instant]:
        """Yield what the header states about the exposure's moments, the most trusted first."""
        for key, time_keys in _DATES:
            if self.cards.value(key) is not None:
                yield from self._of_date(key, time_keys, "start")
        for key, moment, epoch in _DAYS:
            if self.cards.value(key) is None:
                continue
            if epoch:
                yield from self._of_day_count(key, moment, epoch)
            else:
                yield from self._of_date(key, (), moment)

    def _of_date(self, key: str, time_keys: tuple[str, ...], moment: Moment) -> Iterator[_Instant]:
        value = self.cards.value(key)
        is_day = isinstance(value, int) and not isinstance(value, bool) and 10**7 <= value < 10**8
        if not isinstance(value, str) and not is_day:
            self._refuse(key, "it is no date like 2023-06-22T03:04:05.678")
            return
        try:
            written = parse_date(str(value))
        except ValueError as error:
            self._refuse(key, str(error))
            return
        words, time = key, written.time
        if time is None:
            words, time = self._time_beside(key, time_keys)
        else:
            self._compare_times(key, time, time_keys)
        if time is None:
            self._note_dateless(key, written.day)
            return
        yield from self._converted(key, words, written, time, moment)

    def _converted(
        self, key: str, words: str, written: WrittenDate, time: TimeOfDay, moment: Moment
    ) -> Iterator[_Instant]:
        count_ns = written.day * NS_PER_DAY + time.since_midnight_ns
        scale, fault = self._scale, self._scale_fault
        if time.offset_s is not None:
            if scale not in ("UTC", None):
                fault, scale = f"it is UTC by its offset, but TIMESYS is {scale}", None
            elif not fault.startswith("TREFPOS"):
                scale = "UTC"
            count_ns -= time.offset_s * NS_PER_S
        elif words.endswith(_TAI_TIME):
            scale = "TAI" if self._scale in ("UTC", "TAI") else None
        if scale is None:
            self._refuse(key, fault)
            return
        yield _Instant(
            words=words,
            utc_ns=utc_ns_of_scale(count_ns, scale),
            step_ns=time.step_ns,
            slack_ns=time.step_ns,
            moment=moment,
        )

    def _time_beside(self, key: str, time_keys: tuple[str, ...]) -> tuple[str, TimeOfDay | None]:
        """Time of day in a card of its own."""
        for time_key in (*time_keys, _TAI_TIME) if time_keys else ():
            value = self.cards.value(time_key)
            if value is None:
                continue
            numeric = numeric_times(value)
            if len(numeric) == 1:
                return f"{key} and {time_key}", numeric[0]
            if numeric:
                self._refuse(time_key, "it may be hours, seconds or hhmmss")
                continue
            try:
                return f"{key} and {time_key}", parse_time_of_day(str(value))
            except ValueError as error:
                self._refuse(time_key, str(error))
        return key, None

    def _compare_times(self, key: str, time: TimeOfDay, time_keys: tuple[str, ...]) -> None:
        """Note times of day in cards of their own that are not those of the date's card."""
        for time_key in time_keys:
            value = self.cards.value(time_key)
            if value is None:
                continue
            others = numeric_times(value)
            with contextlib.suppress(ValueError):
                others.append(parse_time_of_day(str(value)))
            if not any(_is_same_time(time, each) for each in others):
                self.cards.not_used(time_key, f"it is not the time of day of {key}")

    def _of_day_count(self, key: str, moment: Moment, epoch: float) -> Iterator[_Instant]:
        low, high = (_day_of_year(year) + epoch for year in (FIRST_YEAR, LAST_YEAR))
        name = "modified Julian date" if epoch == MJD_UNIX else "Julian date"
        days = self.cards.decimal(
            key, f"a {name} of the years {FIRST_YEAR} to {LAST_YEAR}", low, high
        )
        if days is None:
            self._start_faults.append(self.cards.notes[-1])
            return
        exponent = days.normalize().as_tuple().exponent
        step_ns = round(10.0 ** min(int(exponent), 0) * NS_PER_DAY)
        midnight = 0.5 if epoch == JD_UNIX else 0.0
        if days % 1 in (0, Decimal(midnight)):
            self._note_dateless(key, int(days - Decimal(repr(epoch))))
            return
        scale = "UTC" if key == "JD_UTC" else self._scale
        if scale is None:
            self._refuse(key, self._scale_fault)
            return
        count_ns = int(((days - Decimal(repr(epoch))) * NS_PER_DAY).to_integral_value())
        yield _Instant(
            words=key,
            utc_ns=utc_ns_of_scale(count_ns, scale),
            step_ns=step_ns,
            slack_ns=min(step_ns, _MAX_SLACK_NS),
            moment=moment,
        )

    def _note_dateless(self, key: str, day: int) -> None:
        value = shown_value(self.cards.value(key))
        words = f"{key} {value} names no time of day, nor does TIME-OBS or UT"
        self._dateless.append((words, day))

    def _refuse(self, key: str, why: str) -> None:
        self._start_faults.append(self.cards.not_used(key, why))


def _day_of_year(year: int) -> int:
    """Days from 1970 to about the beginning of a year."""
    return round((year - 1970) * 365.2425)


def _seconds_before(moment: Moment, length_s: float | None) -> float | None:
    """Seconds from the start to a moment of an exposure."""
    if moment == "start":
        return 0.0
    return None if length_s is None else length_s if moment == "end" else length_s / 2.0


def _is_same_time(one: TimeOfDay, other: TimeOfDay) -> bool:
    off_ns = abs(one.since_midnight_ns - other.since_midnight_ns)
    off_ns = min(off_ns, NS_PER_DAY - off_ns)
    return off_ns <= one.step_ns + other.step_ns + _TOLERANCE_NS


def _contradiction(first: _Instant, first_ns: int, other: _Instant, other_ns: int) -> str:
    off_s = (other_ns - first_ns) / NS_PER_S
    of = {"start": "", "middle": " less half of the exposure", "end": " less the exposure"}
    return (
        f"{first.words} says that the exposure began at {utc_ns_to_iso(first_ns)},"
        f" {other.words}{of[other.moment]} {utc_ns_to_iso(other_ns)}, {abs(off_s):.1f} s"
        f" {'later' if off_s > 0 else 'earlier'}: {first.words} is used"
    )
