"""The tracks of a night with their names, for people; 80 columns at most."""

from collections.abc import Iterator, Sequence
from typing import Any

from rsoconsole.orbits.identification import SURE_SAME
from rsoconsole.words import called, chance, span


def named_tracks_lines(tracks: Sequence[dict[str, Any]]) -> Iterator[str]:
    """One line a track, in order of time, with the candidates below where they are several."""
    for each in tracks:
        arc = f"{each['directions']} in {span(each['arc_s'], 'line')}"
        head = f"track {each['track']}: {each['verdict']}"
        if each["verdict"] == "identified":
            best = each["candidates"][0]
            name = called(best["name"], best["norad_id"])
            yield f"{head}: {name}, {chance(best['probability'])}; {arc}"
            continue
        past = each["ledger"]
        if each["verdict"] == "unknown" and past is not None:
            head += f", {_past_words(past)}"
        yield f"{head}; {arc}"
        if each["verdict"] == "ambiguous":
            for one in each["candidates"]:
                yield f"  {chance(one['probability']):>5}  {called(one['name'], one['norad_id'])}"
            yield f"  {chance(each['not_catalogued']):>5}  not in catalogue"


def past_tracks_lines(report: dict[str, Any]) -> Iterator[str]:
    """What the ledger says of the tracks, and what was kept in it."""
    for each in report["tracks"]:
        if each["ledger"] is not None and len(report["tracks"]) == 1:
            yield f"  in the ledger: {_past_words(each['ledger'])}"
    for each in report["kept"] or ():
        words = "new" if each["is_new"] else "known before"
        yield f"  track {each['track']} is kept in the ledger as UCT {each['number']}, {words}"
    if report["kept"] == []:
        yield "  nothing to keep: no track of it is unknown and long enough"


def _past_words(past: dict[str, Any]) -> str:
    seen = past["t_last_utc"][:10]
    doubt = "" if past["probability"] >= SURE_SAME else "perhaps "
    return f"{doubt}{past['name']}, seen {seen} ({chance(past['probability'])})"
