"""What a track's name on record is, as a line of an exported file."""

from rsoconsole.records import CatalogueMatch, Identified
from rsoconsole.words import called, clock

_LIKELY = 0.05


def name_words(name: Identified) -> str:
    """Verdict, objects and probabilities, in one line of ASCII where the names are."""
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
    seen = clock(past.t_last_utc_ns, "day", "")
    return f"uncorrelated: {doubt}{past.name}, seen {seen}, probability {past.probability:.3f}"


def _called(match: CatalogueMatch) -> str:
    return f"{called(match.name, match.norad_id)}, probability {match.probability:.3f}"
