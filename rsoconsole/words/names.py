"""What an object or a track is called, and how surely it is that."""

from collections.abc import Iterable

from rsoconsole.records import CatalogueMatch, Identified, LedgerName
from rsoconsole.words.times import age, clock


def called(name: str | None, norad_id: int) -> str:
    """INTELSAT 14 (36097), or its number where it has no name."""
    return f"{name} ({norad_id})" if name else str(norad_id)


def identity(found: Identified | None) -> str:
    """INTELSAT 14, UCT 7?, not in catalogue; "-": not known yet. "?" stands for doubt."""
    if found is None:
        return "-"
    if found.verdict == "unknown":
        past = found.ledger
        return "not in catalogue" if past is None else past.name + ("" if past.is_sure else "?")
    if not found.matches:
        return "-"
    best = found.matches[0]
    return (best.name or str(best.norad_id)) + ("" if found.verdict == "identified" else "?")


def off_words(match: CatalogueMatch) -> str:
    """How far beside its elements what was seen is: 3.1″, 12″, 2′, 1.7°."""
    off = match.separation_arcsec
    if off < 100.0:
        return f"{off:.{0 if off >= 10.0 else 1}f}″"
    return f"{off / 60.0:.0f}′" if off < 6000.0 else f"{off / 3600.0:.1f}°"


def match_words(match: CatalogueMatch) -> list[str]:
    """98%, 3.1″ off, elements 0.4 d old."""
    return [
        chance(match.probability),
        f"{off_words(match)} off",
        f"elements {age(match.tle_age_days)}",
    ]


def ledger_words(past: LedgerName) -> str:
    """UCT 7, seen 2026-11-20; perhaps UCT 7, seen 2026-11-20 (93%)."""
    words = f"{past.name}, seen {clock(past.t_last_utc_ns, 'day', '')}"
    return words if past.is_sure else f"perhaps {words} ({chance(past.probability)})"


def chance(probability: float) -> str:
    """Never more certain than it is: >99%."""
    if probability >= 0.995:
        return ">99%"
    return "<1%" if probability < 0.005 else f"{probability:.0%}"


def tracks_words(numbers: Iterable[int | str]) -> str:
    """Tracks by their numbers: "track 3", "tracks 1 3 4"."""
    words = [str(each) for each in numbers]
    return f"track{'s' if len(words) > 1 else ''} {' '.join(words)}"
