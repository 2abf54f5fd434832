"""The tracks of a night with their names, for people; 80 columns at most."""

from collections.abc import Iterator, Sequence
from typing import Any

from rsoconsole.cli.orbit_words import span_words


def named_tracks_lines(tracks: Sequence[dict[str, Any]]) -> Iterator[str]:
    """One line a track, in order of time, with the candidates below where they are several."""
    for each in tracks:
        arc = f"{each['directions']} in {span_words(each['arc_s'])}"
        head = f"track {each['track']}: {each['verdict']}"
        if each["verdict"] == "identified":
            best = each["candidates"][0]
            yield f"{head}: {_called(best)}, {_percent(best['probability'])}; {arc}"
            continue
        yield f"{head}; {arc}"
        if each["verdict"] == "ambiguous":
            for one in each["candidates"]:
                yield f"  {_percent(one['probability']):>5}  {_called(one)}"
            yield f"  {_percent(each['not_catalogued']):>5}  not catalogued"


def _called(candidate: dict[str, Any]) -> str:
    name, number = candidate["name"], candidate["norad_id"]
    return f"{name} ({number})" if name else str(number)


def _percent(probability: float) -> str:
    """Never more certain than it is."""
    if probability >= 0.995:
        return ">99 %"
    return "<1 %" if probability < 0.005 else f"{100.0 * probability:.0f} %"
