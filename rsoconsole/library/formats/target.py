"""Names of the observed object in formats that require one, also for unknown objects."""

import re
from dataclasses import dataclass

from rsoconsole.base import ExportError
from rsoconsole.records import CatalogueMatch, Identified
from rsoconsole.words import catalogued_name, utc_text

_COSPAR = re.compile(r"(\d{4})-(\d{3})([A-Z]{1,3})", re.ASCII)
LARGEST_NORAD = 999_999_999
"""Largest catalogue number in an OMM."""
LARGEST_IOD_NORAD = 99_999
"""Largest catalogue number in the five columns of an IOD line."""
UNKNOWN_NORAD = 99_900
"""Base of the numbers that stand for unknown objects: track n of a session gets 99900 + n."""
UNKNOWN_LAUNCH = 999
_PIECES = "ABCDEFGHJKLMNPQRSTUVWXYZ"
"""Letters of pieces: without I and O."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Catalogue numbers of the observed object; None for a number that is not given."""

    norad_id: int | None = None
    cospar: str | None = None
    """International designator, e.g. ``2009-064A``."""

    def __post_init__(self) -> None:
        """Check the numbers. Raises ExportError for one that is not valid."""
        if self.norad_id is not None and not 1 <= self.norad_id <= LARGEST_NORAD:
            raise ExportError(f"{self.norad_id} is no catalogue number of one to nine digits")
        if self.cospar is not None and _COSPAR.fullmatch(self.cospar) is None:
            raise ExportError(
                f"{self.cospar!r} is no international designation: write it like 2009-064A"
            )

    @property
    def is_known(self) -> bool:
        """True where at least one of the two numbers is given."""
        return self.norad_id is not None or self.cospar is not None

    def tdm_name(self, track: int) -> str:
        """Return the international designator, else catalogue number, else ``UNKNOWN-track``."""
        if self.cospar is not None:
            return self.cospar
        return f"UNKNOWN-{track}" if self.norad_id is None else str(self.norad_id)

    def iod_name(self, track: int, year: int) -> str:
        """Return columns 1 to 15 of an IOD line: catalogue number and international designator.

        An unknown object gets the number 999NN, where NN is its track, and launch 999 of ``year``,
        the year of the observation: no real launch has that number. Raises ExportError for a track
        above 99, and for a catalogue number of more than five digits.
        """
        if self.norad_id is not None and self.norad_id > LARGEST_IOD_NORAD:
            raise ExportError(
                f"an IOD line has five columns for a catalogue number, no room for {self.norad_id}:"
                " leave --norad out and give --cospar, or export tdm"
            )
        if track > LARGEST_IOD_NORAD - UNKNOWN_NORAD:
            raise ExportError("more than 99 tracks: give one at a time with --track")
        norad = UNKNOWN_NORAD + track if self.norad_id is None else self.norad_id
        match = _COSPAR.fullmatch(self.cospar or "")
        if match is None:
            piece = piece_letters(track)
            return f"{norad:05d} {year % 100:02d} {UNKNOWN_LAUNCH:03d}{piece:<3}"
        return f"{norad:05d} {int(match[1]) % 100:02d} {match[2]}{match[3]:<3}"


def piece_letters(number: int) -> str:
    """Return the letters of piece ``number`` of a launch: 1 is A, 24 is Z, 25 is AA.

    The letters I and O are not used.
    """
    letters = ""
    while number > 0:
        number, place = divmod(number - 1, len(_PIECES))
        letters = _PIECES[place] + letters
    return letters


_LIKELY = 0.05


def identification_words(name: Identified) -> str:
    """Format an identification in one line: its result, the objects and their probabilities.

    The line is ASCII where the names of the objects are ASCII.
    """
    with_others = ""
    if name.named_with:
        others = "1 other track" if name.named_with == 1 else f"{name.named_with} other tracks"
        with_others = f", named together with {others}"
    if name.verdict == "identified" and name.matches:
        return f"identified: {_called(name.matches[0])}{with_others}"
    if name.verdict == "ambiguous":
        likely = [_called(each) for each in name.matches if each.probability >= _LIKELY]
        return f"ambiguous: {' or '.join(likely) or 'no object is likely'}{with_others}"
    past = name.ledger
    if past is None:
        return "uncorrelated: no catalogued object"
    doubt = "" if past.is_sure else "perhaps "
    seen = utc_text(past.t_last_utc_ns, "day", "")
    return f"uncorrelated: {doubt}{past.name}, seen {seen}, probability {past.probability:.3f}"


def _called(match: CatalogueMatch) -> str:
    return f"{catalogued_name(match.name, match.norad_id)}, probability {match.probability:.3f}"
