"""Times of an exposure that the cards of a header state, each with its moment and precision.

Source: FITS standard 4.0, chapter 9; for keys outside it, the programs and archives that write
them.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, Literal

from rsoconsole.instruments.frames.exposure_length import MISSING
from rsoconsole.instruments.frames.header_cards import Cards, card_text, shown_value
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
from rsoconsole.words import NS_PER_DAY, NS_PER_S

_TIME_KEYS = (
    *("UT-STR", "UTSTART", "UT-START", "UTCSTART", "UTC-STAR", "UT-BEG", "UTC-BEG", "TIME-BEG"),
    *("TIME-OBS", "TIME_OBS", "TIMEOBS", "UT", "UTC", "UTC-OBS", "UTC_OBS", "UT-OBS", "UTSHUT"),
    *("TIME-UTC", "UTC-TIME", "UT-TIME", "TAIHMS"),
)
"""Keys of times of day, those that name the start first; TAIHMS is of the SDSS, always TAI."""
_DATE_KEYS = (
    *("DATE-OBS", "DATE_OBS", "DATEOBS", "UTDATE", "DATE-UTC", "UTC-DATE", "UT-DATE", "DATE-BEG"),
    "SHUTOPEN",
)
_OF_DATE_BEG = ("TIME-BEG", "UT-BEG", "UTC-BEG")
"""Times of day that DATE-BEG is compared with; without its own it may have any."""
_UTC_NAME = re.compile(r"UT.*|.*[-_]UTC?")
"""Keys that say that their time is UTC."""
_END_KEYS = ("UT-END", "UTC-END", "UTEND", "UTSTOP")
"""Keys of the time of day of the end, UTC by their names."""
Moment = Literal["start", "middle", "end"]
_DAYS: tuple[tuple[str, Moment, float], ...] = (
    ("MJD-OBS", "start", MJD_UNIX),
    ("MJD_OBS", "start", MJD_UNIX),
    ("MJD-BEG", "start", MJD_UNIX),
    ("MJD-STR", "start", MJD_UNIX),
    ("OBSMJD", "start", MJD_UNIX),
    ("DATE-AVG", "middle", 0.0),
    ("DATE-MID", "middle", 0.0),
    ("MJD-AVG", "middle", MJD_UNIX),
    ("MJD-MID", "middle", MJD_UNIX),
    ("DATE-END", "end", 0.0),
    ("MJD-END", "end", MJD_UNIX),
    ("JD-OBS", "start", JD_UNIX),
    ("JD", "start", JD_UNIX),
    ("JD_UTC", "middle", JD_UNIX),
)
"""Further keys: which moment each names, and 1970 in its count of days; 0 for a date."""
_NOT_READ = (
    *("MJD", "OBSJD", "HJD", "BJD", "UT-END", "UTSTOP", "TIME-END", "DATE-LOC", "LOCTIME", "TIME"),
    *("UNIXTIME", "EXPSTART", "DATE-LT", "TIME-LT"),
)
"""Keys of times whose moment or scale is not certain, named where there is no other time."""
_TOPOCENTRES = ("TOPOCENT", "GEOCENT", "RELOCATA", "CUSTOM")
TOLERANCE_NS = NS_PER_S // 10
"""Difference of two times of one exposure that is no contradiction, beside their rounding.

Programs stamp order and shutter some hundredths of a second apart; at 15 arcsec/s a tenth moves a
geostationary satellite by 1.5 arcsec.
"""
_MAX_SLACK_NS = NS_PER_DAY // 10_000
"""Rounding of a count of days that is believed: a number has lost the zeros at its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """One statement of a header about start, middle or end of its exposure."""

    words: str
    utc_ns: int
    step_ns: int
    """One unit of the last digit."""
    slack_ns: int
    """Difference from another time that the rounding explains."""
    moment: Moment
    is_midnight: bool = False
    """True for a date with 00:00:00 behind it, which may stand for no time."""


class InstantReader:
    """Reads the cards about time of one header."""

    def __init__(self, header: Mapping[str, Any]) -> None:
        self.cards = Cards(header)
        self.start_faults: list[str] = []
        self.dateless: list[tuple[str, int]] = []
        """Faults of dates without a time of day, which are none where another card has the time.

        Each with its day since 1970.
        """
        self.scale, self._scale_fault = self._time_scale()

    def _time_scale(self) -> tuple[str | None, str]:
        """Time scale of the header; None with the reason where it is not converted to UTC."""
        place = self.cards.value("TREFPOS")
        if isinstance(place, str) and not place.strip().upper().startswith(_TOPOCENTRES):
            return None, f"TREFPOS {shown_value(place)} refers the time to another place"
        stated = self.cards.value("TIMESYS")
        if stated is None:
            return "UTC", ""
        scale = time_scale(card_text(stated))
        if scale is None:
            return None, (
                f"TIMESYS {shown_value(stated)} is no time scale that can be converted to UTC"
                f" ({', '.join(TIME_SCALES)} can)"
            )
        return scale, ""

    def start_fault(self) -> str:
        """Reason why the start is not known."""
        return "; ".join(dict.fromkeys(self.start_faults)) or f"DATE-OBS{MISSING}"

    def not_read(self) -> list[str]:
        """Name the cards about time that are not read."""
        keys = [key for key in _NOT_READ if self.cards.value(key) is not None]
        if not self.start_faults:
            keys += [key for key in _TIME_KEYS if self.cards.value(key) is not None]
        if not keys:
            return []
        shown = [f"{key} {shown_value(self.cards.value(key))}" for key in keys[:4]]
        words = f"not read, as its date, moment or time scale is not certain: {', '.join(shown)}"
        self.cards.note(words)
        return [words]

    def instants(self) -> Iterator[Instant]:
        """Yield what the header states about the exposure's moments, the most trusted first."""
        dates = [key for key in _DATE_KEYS if self.cards.value(key) is not None]
        for key in dates or self._dated_times():
            yield from self._of_date(key, _TIME_KEYS, "start")
        for key, moment, epoch in _DAYS:
            if self.cards.value(key) is None:
                continue
            if epoch:
                yield from self._of_day_count(key, moment, epoch)
            else:
                yield from self._of_date(key, ("TIME-END",) if moment == "end" else (), moment)

    def _dated_times(self) -> list[str]:
        """Keys of times of day that have a date and a time."""
        return [key for key in _TIME_KEYS if self._date_in(key) is not None]

    def _date_in(self, key: str) -> WrittenDate | None:
        """Date and time in a card; None where it has not both."""
        value = self.cards.value(key)
        try:
            written = parse_date(value) if isinstance(value, str) else None
        except ValueError:
            return None
        return None if written is None or written.time is None else written

    def _of_date(self, key: str, time_keys: tuple[str, ...], moment: Moment) -> Iterator[Instant]:
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
        time_keys = tuple(each for each in time_keys if each != key)
        time, time_key = written.time, key
        is_midnight = time is not None and time.since_midnight_ns == 0 and time.scale is None
        if time is None or is_midnight:
            time_key, beside = self._time_beside(key, written.day, time_keys)
            if is_midnight and beside is not None and beside.since_midnight_ns:
                self.cards.note(midnight_words(key, time_key))
            is_midnight &= beside is None
            time = beside or time
        if time is None:
            self._note_dateless(key, written.day)
            return
        found = self._converted(key, time_key, written.day, time, moment)
        if found is None:
            return
        yield replace(found, is_midnight=is_midnight)
        compared = _OF_DATE_BEG if key == "DATE-BEG" else time_keys
        for other in (each for each in compared if each != time_key):
            yield from self._compared(other, found, time)

    def _converted(
        self, key: str, time_key: str, day: int, time: TimeOfDay, moment: Moment
    ) -> Instant | None:
        """Instant of a day and a time of day; None where its time scale is not converted."""
        count_ns = day * NS_PER_DAY + time.since_midnight_ns - time.offset_s * NS_PER_S
        scale, fault, named = self.scale, self._scale_fault, self._scale_by_name(time_key)
        is_stated = self.cards.value("TIMESYS") is not None
        if time.scale is not None:
            if is_stated and scale not in (time.scale, None):
                by = "offset" if time.scale == "UTC" else "ending"
                fault, scale = f"it is {time.scale} by its {by}, but TIMESYS is {scale}", None
            elif not fault.startswith("TREFPOS"):
                scale = time.scale
        elif scale is not None and named is not None:
            if is_stated and scale != named:
                self.cards.note(f"{time_key} is {named} by its name, although TIMESYS is {scale}")
            scale = named
        if scale is None:
            self._refuse(key, fault)
            return None
        return Instant(
            words=key if time_key == key else f"{key} and {time_key}",
            utc_ns=utc_ns_of_scale(count_ns, scale),
            step_ns=time.step_ns,
            slack_ns=time.step_ns,
            moment=moment,
        )

    def _scale_by_name(self, key: str) -> str | None:
        """Time scale in the name of a card; None without one."""
        if key == "TAIHMS":
            return "TAI"
        if not _UTC_NAME.fullmatch(key) or (self.scale == "UT1" and "UTC" not in key):
            return None
        return "UTC"

    def _times(self, key: str) -> list[TimeOfDay]:
        """Times of day that a card may mean. Raises ValueError with the reason for none."""
        value = self.cards.value(key)
        written = self._date_in(key)
        if written is not None and written.time is not None:
            return [written.time]
        return numeric_times(value) or [parse_time_of_day(card_text(value))]

    def _time_beside(
        self, key: str, day: int, time_keys: tuple[str, ...]
    ) -> tuple[str, TimeOfDay | None]:
        """Time of day in a card of its own, and that card's key."""
        for time_key in time_keys:
            if self.cards.value(time_key) is None:
                continue
            try:
                found = self._times(time_key)
            except ValueError as error:
                self._refuse(time_key, str(error))
                continue
            written = self._date_in(time_key)
            if len(found) > 1:
                self._refuse(time_key, "it may be hours, seconds or hhmmss")
            elif written is not None and written.day != day:
                self._refuse(time_key, f"it is of another day than {key}")
            else:
                return time_key, found[0]
        return key, None

    def _compared(self, key: str, used: Instant, time: TimeOfDay) -> Iterator[Instant]:
        """Note a time of day other than that in use.

        One that is UTC by its name, where TIMESYS is another scale, is an instant of its own.
        """
        if self.cards.value(key) is None:
            return
        try:
            others = self._times(key)
        except ValueError:
            others = []
        is_utc = self._scale_by_name(key) == "UTC"
        if is_utc:
            time = replace(time, since_midnight_ns=used.utc_ns % NS_PER_DAY)
        if is_utc and self.scale != "UTC" and len(others) == 1:
            off_ns = others[0].since_midnight_ns - used.utc_ns % NS_PER_DAY
            off_ns = (off_ns + NS_PER_DAY // 2) % NS_PER_DAY - NS_PER_DAY // 2
            step_ns = others[0].step_ns
            yield Instant(
                words=f"the card {key}",
                utc_ns=used.utc_ns + off_ns,
                step_ns=step_ns,
                slack_ns=step_ns,
                moment=used.moment,
            )
        elif not any(_is_same_time(time, each) for each in others):
            self.cards.not_used(key, f"it is not the time of day of {used.words}")

    def end_after(self, start: Instant) -> Instant | None:
        """End of the exposure by a time of day in a card of its own, within a day of its start."""
        for key in _END_KEYS:
            try:
                found = [] if self.cards.value(key) is None else self._times(key)
            except ValueError as error:
                self.cards.not_used(key, str(error))
                continue
            if len(found) != 1:
                continue
            after_ns = (found[0].since_midnight_ns - start.utc_ns) % NS_PER_DAY
            return replace(start, words=key, utc_ns=start.utc_ns + after_ns, moment="end")
        return None

    def _of_day_count(self, key: str, moment: Moment, epoch: float) -> Iterator[Instant]:
        low, high = (_day_of_year(year) + epoch for year in (FIRST_YEAR, LAST_YEAR))
        name = "modified Julian date" if epoch == MJD_UNIX else "Julian date"
        days = self.cards.decimal(
            key, f"a {name} of the years {FIRST_YEAR} to {LAST_YEAR}", low, high
        )
        if days is None:
            self.start_faults.append(self.cards.notes[-1])
            return
        exponent = days.normalize().as_tuple().exponent
        step_ns = round(10.0 ** min(int(exponent), 0) * NS_PER_DAY)
        midnight = 0.5 if epoch == JD_UNIX else 0.0
        if days % 1 in (0, Decimal(midnight)):
            self._note_dateless(key, int(days - Decimal(repr(epoch))))
            return
        scale = "UTC" if key == "JD_UTC" else self.scale
        if scale is None:
            self._refuse(key, self._scale_fault)
            return
        count_ns = int(((days - Decimal(repr(epoch))) * NS_PER_DAY).to_integral_value())
        yield Instant(
            words=key,
            utc_ns=utc_ns_of_scale(count_ns, scale),
            step_ns=step_ns,
            slack_ns=min(step_ns, _MAX_SLACK_NS),
            moment=moment,
        )

    def _note_dateless(self, key: str, day: int) -> None:
        value = shown_value(self.cards.value(key))
        words = f"{key} {value} names no time of day, nor does TIME-OBS or UT"
        self.dateless.append((words, day))

    def _refuse(self, key: str, why: str) -> None:
        self.start_faults.append(self.cards.not_used(key, why))


def _day_of_year(year: int) -> int:
    """Days from 1970 to about the beginning of a year."""
    return round((year - 1970) * 365.2425)


def _is_same_time(one: TimeOfDay, other: TimeOfDay) -> bool:
    off_ns = abs(one.since_midnight_ns - other.since_midnight_ns)
    off_ns = min(off_ns, NS_PER_DAY - off_ns)
    return off_ns <= one.step_ns + other.step_ns + TOLERANCE_NS


def midnight_words(key: str, time_key: str) -> str:
    return f"{key} is exactly midnight, and taken as a date: the time is by {time_key}"
