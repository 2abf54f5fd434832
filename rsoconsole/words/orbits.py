"""Names, orbits and pairs of satellites in words."""

from collections.abc import Iterable

from rsoconsole.records import CatalogueMatch, Identified, LedgerName, PairMotion, UnseenMember
from rsoconsole.words.angles import angle, plus_minus
from rsoconsole.words.times import NS_PER_S, Clock, duration_words, element_age_words, utc_text


def semi_major_axis_words(a_km: float, sigma_a_km: float) -> str:
    """Format a semi-major axis: a 42165±9 km."""
    return f"a {plus_minus(a_km, sigma_a_km)} km"


def due_words(what: str, t_utc_ns: int, now_utc_ns: int, form: Clock = "minute") -> str:
    """Format a coming event with its time and the time left: sets 04:23Z (2h00).

    ``what``: the event in words; ``form``: form of its time.
    """
    left = duration_words((t_utc_ns - now_utc_ns) / NS_PER_S)
    return f"{what} {utc_text(t_utc_ns, form)} ({left})"


def set_or_rise_words(
    t_utc_ns: int | None, now_utc_ns: int, form: Clock = "minute", *, is_up: bool
) -> str:
    """Say when an object that is up sets, or an object that is down rises.

    ``t_utc_ns``: time of the event; None: not within a day.
    """
    if t_utc_ns is None:
        return f"does not {'set' if is_up else 'rise'} within a day"
    return due_words("sets" if is_up else "rises", t_utc_ns, now_utc_ns, form)


def eclipse_words(
    eclipse_utc_ns: tuple[int, int | None] | None,
    from_utc_ns: int,
    now_utc_ns: int,
    form: Clock = "minute",
) -> str:
    """Say when an eclipse begins and ends, or that it has begun.

    ``eclipse_utc_ns``: its begin and end (None: end not known); None: no eclipse within a day. An
    eclipse that begins before ``from_utc_ns`` has begun.
    """
    if eclipse_utc_ns is None:
        return "no eclipse within a day"
    begins, ends = eclipse_utc_ns
    until = f" to {utc_text(ends, 'minute')}" if ends else ""
    is_in = begins <= from_utc_ns
    return ("in eclipse" if is_in else due_words("eclipse", begins, now_utc_ns, form)) + until


def separation_words(pair: PairMotion) -> str:
    """Format a pair's separation: 253.2 ± 0.5″."""
    return f"{pair.separation_arcsec:.1f} ± {pair.sigma_separation_arcsec:.1f}″"


def separation_rate_words(pair: PairMotion) -> str:
    """Format the rate of a separation: -1.44 ± 0.03″/min, negative while the pair approaches."""
    sigma = pair.sigma_separation_rate_arcsec_min
    return f"{pair.separation_rate_arcsec_min:+.2f} ± {sigma:.2f}″/min"


def approach_words(pair: PairMotion) -> str:
    """Say how close two satellites come and when, or that they move apart."""
    hours = pair.horizon_s / 3600.0
    if pair.closest == "now":
        return f"they part, looked {hours:.1f} h ahead"
    within = f"{pair.closest_low_arcsec:.0f} to {pair.closest_high_arcsec:.0f}″"
    if pair.closest == "beyond":
        return f"still nearing in {hours:.1f} h: {within}"
    off_min = max(pair.sigma_closest_s / 60.0, 0.5)
    return f"least {within} at {utc_text(pair.closest_utc_ns, 'minute', '')} ± {off_min:.0f} min"


def unseen_words(name: str, member: UnseenMember) -> str:
    """Say where in the frame an expected object is missing, and why it may not be visible."""
    whys = (("in shadow", member.is_lit), ("at the edge", member.is_usable))
    why = ", ".join(words for words, is_plain in whys if not is_plain)
    return f"{name} x {member.x_px:.0f} y {member.y_px:.0f} {why}".rstrip()


def catalogued_name(name: str | None, norad_id: int) -> str:
    """Format a catalogued object: INTELSAT 14 (36097), or its number where it has no name."""
    return f"{name} ({norad_id})" if name else str(norad_id)


def identity_words(found: Identified | None) -> str:
    """Format an identity: INTELSAT 14, UCT 7, not in catalogue; "?": in doubt, "-": none yet."""
    if found is None:
        return "-"
    if found.verdict == "unknown":
        past = found.ledger
        return "not in catalogue" if past is None else past.name + ("" if past.is_sure else "?")
    if not found.matches:
        return "-"
    best = found.matches[0]
    return (best.name or str(best.norad_id)) + ("" if found.verdict == "identified" else "?")


def match_separation_words(match: CatalogueMatch) -> str:
    """Format the separation of a track from a catalogued object: 0.45″, 3.1″, 4.2′."""
    return angle(match.separation_arcsec, "cell")


def match_words(match: CatalogueMatch) -> list[str]:
    """Return the parts of a catalogue match in words: 98%, 3.1″ off, elements 0.4 d old."""
    return [
        probability_words(match.probability),
        f"{match_separation_words(match)} off",
        f"elements {element_age_words(match.tle_age_days)}",
    ]


def ledger_words(past: LedgerName) -> str:
    """Format a name from the ledger with the day it was last seen: UCT 7, seen 2026-11-20.

    Where it is not sure: perhaps UCT 7, seen 2026-11-20 (93%).
    """
    words = f"{past.name}, seen {utc_text(past.t_last_utc_ns, 'day', '')}"
    return words if past.is_sure else f"perhaps {words} ({probability_words(past.probability)})"


def probability_words(probability: float) -> str:
    """Format a probability in per cent, between "<1%" and ">99%"."""
    if probability >= 0.995:
        return ">99%"
    return "<1%" if probability < 0.005 else f"{probability:.0%}"


def tracks_words(numbers: Iterable[int | str]) -> str:
    """Format tracks by their numbers: "track 3", "tracks 1 3 4"."""
    words = [str(each) for each in numbers]
    return f"track{'s' if len(words) > 1 else ''} {' '.join(words)}"
