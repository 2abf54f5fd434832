"""How long a frame was exposed, by the cards that state it."""

from collections.abc import Mapping

from rsoconsole.instruments.frames.header_cards import SECONDS, Cards

EXPOSURE_KEYS: Mapping[str, float] = {
    **dict.fromkeys(("EXPTIME", "EXPOSURE", "XPOSURE", "EXP_TIME", "EXP-TIME", "EXPTIM"), 1.0),
    **dict.fromkeys(("ITIME", "INTTIME", "INT_TIME", "INT-TIME", "ONTIME", "LIVETIME"), 1.0),
    **dict.fromkeys(("TELAPSE", "ELAPTIME"), 1.0),
    **dict.fromkeys(("EXPTIMMS", "EXPTIMEM", "EXP_MS", "EXP-MS", "EXPOSMS"), 1e-3),
    **dict.fromkeys(("EXPOINUS", "EXP_US", "EXP-US", "EXPTIMUS"), 1e-6),
}
"""Keys of the exposure time, the most trusted first, and the unit of a plain number, s."""
MISSING = " is missing"
_MAX_EXPOSURE_S = 1e6
_ELAPSED = ("TELAPSE", "ELAPTIME")
"""Keys of the time from start to end, pauses included."""
_LONG_PAUSES = 1.5
"""Ratio of the time from start to end to the exposure from which it is noted."""
_REPEATED, _REPEATS = "ITIME", "COADDS"
"""Exposure time of one of several read-outs that are added up, as at Keck, and their number."""


def exposure_length_s(cards: Cards) -> float | None:
    """Return the exposure time by the first card that states it; others that differ are noted."""
    first: tuple[str, float] | None = None
    for key, unit_s in EXPOSURE_KEYS.items():
        seconds = cards.number(
            key,
            "a number of seconds above 0",
            low=1e-9,
            high=_MAX_EXPOSURE_S,
            units=SECONDS,
            plain=unit_s,
        )
        if seconds is None:
            continue
        if key == _REPEATED:
            seconds *= _repeats(cards, seconds)
        if first is None:
            first = key, seconds
        elif key in _ELAPSED and seconds >= _LONG_PAUSES * first[1]:
            cards.note(
                f"{key} says {seconds:g} s from start to end, {first[0]} {first[1]:g} s:"
                f" {first[0]} is used, and pauses within the exposure are not known"
            )
        elif key not in _ELAPSED and abs(seconds - first[1]) > max(0.01, 0.05 * first[1]):
            cards.note(f"{key} says {seconds:g} s, {first[0]} {first[1]:g} s: {first[0]} is used")
    return None if first is None else first[1]


def _repeats(cards: Cards, seconds: float) -> float:
    repeats = cards.number(_REPEATS, "a number of exposures", 1.0, 1e5) or 1.0
    if repeats > 1.0:
        cards.note(
            f"{_REPEATED} {seconds:g} s is that of each of {repeats:g} {_REPEATS}: the exposure"
            f" time is {repeats * seconds:g} s"
        )
    return repeats


def exposure_length_fault(cards: Cards) -> str:
    """Return the reason why the exposure time is not known."""
    unread = [note for key in EXPOSURE_KEYS for note in cards.notes if note.startswith(f"{key} ")]
    return unread[0] if unread else f"EXPTIME{MISSING}"
