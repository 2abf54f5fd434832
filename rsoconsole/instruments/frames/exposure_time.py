"""When a frame was exposed and for how long, from any of the cards that say so.

Start, in order of trust: the camera's GPS receiver, DATE-OBS, DATE-BEG, MJD-OBS, MJD-BEG, DATE-AVG,
MJD-AVG, DATE-END, MJD-END, JD. Of those that agree with the first, the one written most finely is
used; those that disagree are notes. Source: FITS standard 4.0, chapter 9.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rsoconsole.instruments.frames.exposure_length import (
    MISSING,
    exposure_length_fault,
    exposure_length_s,
)
from rsoconsole.instruments.frames.gps_receiver import gps_time
from rsoconsole.instruments.frames.header_instants import (
    TOLERANCE_NS,
    Instant,
    InstantReader,
    Moment,
    midnight_words,
)
from rsoconsole.sky import utc_ns_of_scale
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

_CONVENTIONS = {
    "JD": "the start of the exposure, as MaxIm DL writes it",
    "JD-OBS": "the start of the exposure",
    "JD_UTC": "mid-exposure, as SharpCap and AstroImageJ write it",
    "OBSMJD": "the start of the exposure, as the ZTF writes it",
}
"""Keys of no standard, and which moment they are taken for."""
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


def exposure_time(header: Mapping[str, Any]) -> ExposureTime:
    """Return start and length of the exposure, and what of the header is not used, and why."""
    reader = _StartChooser(header)
    length_s = exposure_length_s(reader.cards)
    instants = list(reader.instants())
    if length_s is None:
        length_s = reader.length_between(instants)
    stated_ns = reader.start_utc_ns(instants, length_s)
    gps_ns, why_not = gps_time(header, stated_ns, length_s)
    if why_not is not None:
        reader.cards.note(why_not)
    start_ns = stated_ns if gps_ns is None else gps_ns
    faults = [] if start_ns is not None else [reader.start_fault()]
    faults += [] if length_s is not None else [exposure_length_fault(reader.cards)]
    not_read = [] if start_ns is not None else reader.not_read()
    return ExposureTime(
        start_utc_ns=start_ns,
        exposure_s=length_s,
        time_by="header" if gps_ns is None else "gps",
        fault="; ".join(filter(None, [_joined(faults), *not_read])),
        notes=tuple(reader.cards.notes),
    )


def exposure_s(header: Mapping[str, Any]) -> float | None:
    """Return the exposure time, s; None where no card states it."""
    return exposure_time(header).exposure_s


def _joined(faults: list[str]) -> str:
    missing = [each.removesuffix(MISSING) for each in faults if each.endswith(MISSING)]
    if len(missing) == 2:
        return f"{missing[0]} and {missing[1]} are missing"
    return "; ".join(faults)


class _StartChooser(InstantReader):
    """Chooses among the times of one header."""

    def length_between(self, instants: list[Instant]) -> float | None:
        """Exposure time from the first start to the first end, or twice that to the first middle.

        For headers in which no card states it.
        """
        start = next((each for each in instants if each.moment == "start"), None)
        end = None if start is None else self.end_after(start)
        others = [*instants, *([] if end is None else [end])]
        for moment, factor in (("end", 1), ("middle", 2)):
            other = next((each for each in others if each.moment == moment), None)
            if start is None or other is None or start.is_midnight:
                continue
            if not 0 < other.utc_ns - start.utc_ns < NS_PER_DAY:
                continue
            seconds = factor * (other.utc_ns - start.utc_ns) / NS_PER_S
            middle = ", the middle," if moment == "middle" else ""
            self.cards.note(
                f"no card states the exposure time: from {start.words} to {other.words}{middle} it"
                f" is {seconds / factor:g} s{f', {seconds:g} s in all' if middle else ''}"
            )
            return seconds
        return None

    def start_utc_ns(self, instants: list[Instant], length_s: float | None) -> int | None:
        """Start by the most trusted card; those that contradict it become notes."""
        starts = [
            (each, each.utc_ns - round(before_s * NS_PER_S))
            for each in instants
            if (before_s := _seconds_before(each.moment, length_s)) is not None
        ]
        if not starts:
            for words, _ in self.dateless:
                self.cards.note(words)
                self.start_faults.append(words)
            for each in instants:
                self.start_faults.append(f"{each.words} needs an exposure time to give the start")
            return None
        starts = self._without_bare_midnights(self._utc_in_spite_of_scale(starts))
        first, first_ns = starts[0]
        chosen, chosen_ns = first, first_ns
        for each, start_ns in starts[1:]:
            off_ns = start_ns - first_ns
            if abs(off_ns) > first.slack_ns + each.slack_ns + TOLERANCE_NS:
                self.cards.note(_contradiction(first, first_ns, each, start_ns))
                continue
            is_same = abs(off_ns) <= first.step_ns + each.step_ns
            if is_same and max(each.step_ns, _FINE_NS) * _MUCH_FINER <= chosen.step_ns:
                chosen, chosen_ns = each, start_ns
        for words, day in self.dateless:
            if abs(day - chosen_ns // NS_PER_DAY) > 1:
                is_ = "are" if " and " in first.words else "is"
                self.cards.note(f"{words}; {first.words} {is_} of another day, and {is_} used")
        if chosen.step_ns > _COARSE_NS:
            self.cards.note(
                f"the time of exposure by {chosen.words} is known to"
                f" {chosen.step_ns / NS_PER_S:.3g} s only"
            )
        if chosen.words in _CONVENTIONS:
            self.cards.note(f"{chosen.words} is taken as {_CONVENTIONS[chosen.words]}")
        return chosen_ns

    def _utc_in_spite_of_scale(
        self, starts: list[tuple[Instant, int]]
    ) -> list[tuple[Instant, int]]:
        """Take the first card, and those that agree with it, as UTC where a later one says so.

        Pipelines set TIMESYS to TAI for the cards that they add, and leave DATE-OBS as it was.
        """
        first, first_ns = starts[0]
        if self.scale in ("UTC", None):
            return starts
        # The scale's lead over UTC hardly changes within a minute.
        ahead_ns = first_ns - utc_ns_of_scale(first_ns, str(self.scale))
        for each, start_ns in starts[1:]:
            allowed_ns = first.slack_ns + each.slack_ns + TOLERANCE_NS
            if abs(start_ns - first_ns - ahead_ns) > allowed_ns or abs(ahead_ns) <= allowed_ns:
                continue
            self.cards.note(
                f"{first.words} is UTC although TIMESYS is {self.scale}: so it agrees with"
                f" {each.words}"
            )
            return [
                (one, ns + (ahead_ns if abs(ns - first_ns) <= allowed_ns else 0))
                for one, ns in starts
            ]
        return starts

    def _without_bare_midnights(
        self, starts: list[tuple[Instant, int]]
    ) -> list[tuple[Instant, int]]:
        """Leave out a date with 00:00:00 where another card has a time of that day."""
        kept: list[tuple[Instant, int]] = []
        for each, start_ns in starts:
            if not each.is_midnight:
                kept.append((each, start_ns))
                continue
            others = [other for other in starts if other[0] is not each]
            if not others:
                self.cards.note(
                    f"{each.words} is exactly midnight, as programs write a date without a time:"
                    " check it"
                )
            better = next(
                (
                    other
                    for other, ns in others
                    if not other.is_midnight
                    and each.slack_ns + other.slack_ns + TOLERANCE_NS < ns - start_ns < NS_PER_DAY
                ),
                None,
            )
            if better is None:
                kept.append((each, start_ns))
            else:
                self.cards.note(midnight_words(each.words, better.words))
        return kept


def _seconds_before(moment: Moment, length_s: float | None) -> float | None:
    """Seconds from the start to a moment of an exposure."""
    if moment == "start":
        return 0.0
    return None if length_s is None else length_s if moment == "end" else length_s / 2.0


def _contradiction(first: Instant, first_ns: int, other: Instant, other_ns: int) -> str:
    off_s = (other_ns - first_ns) / NS_PER_S
    of = {"start": "", "middle": " less half of the exposure", "end": " less the exposure"}
    says, is_ = ("say", "are") if " and " in first.words else ("says", "is")
    return (
        f"{first.words} {says} that the exposure began at {utc_ns_to_iso(first_ns)},"
        f" {other.words}{of[other.moment]} {utc_ns_to_iso(other_ns)}, {abs(off_s):.1f} s"
        f" {'later' if off_s > 0 else 'earlier'}: {first.words} {is_} used"
    )
