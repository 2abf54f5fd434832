"""Contents of frames in words, for people; lines of at most 80 columns except for long names."""

from collections.abc import Iterator, Sequence
from typing import Any

from rsoconsole.orbits import SURE_SAME
from rsoconsole.words import (
    catalogued_name,
    count_words,
    direction,
    duration_words,
    element_age_words,
    light_words,
    probability_words,
    signed_angle,
    streak_name_words,
)

_NAME_WIDTH = 28


def frame_lines(found: dict[str, Any]) -> Iterator[str]:
    """Lines on one frame: its streaks with their names, and catalogued objects not seen in it."""
    streaks, crossed = found["streaks"], found["crossed"]
    yield (
        f"{found['frame']}: {count_words(len(streaks), 'streak')}, {len(crossed)} of"
        f" {found['compared']:,} catalogued objects can have crossed"
    )
    where = direction(found["ra"], found["dec"], "bare")
    plate = "plate solved" if found["plate"] == "solved" else "plate of the header"
    at = found["t_mid_utc"][:23].replace("T", " ")
    yield f"  {at} UTC, {found['exposure_s']:g} s, {where}, {plate}"
    for each in streaks:
        yield from _streak_lines(each)
    unseen = [each for each in crossed if each["unseen_because"] is not None]
    if unseen:
        yield "  catalogued and not seen:"
        for each in unseen:
            yield from _unseen_lines(each)


def movers_lines(report: dict[str, Any], fewest: int) -> Iterator[str]:
    """Yield lines on points that move from frame to frame.

    ``fewest``: least number of frames in which such points are searched for.
    """
    count = len(report["frames"])
    if count < fewest:
        yield f"{count} frames: points that move are looked for in {fewest} or more"
        return
    movers = count_words(len(report["movers"]), "point")
    yield f"{count} frames: {movers} that move and are no star"
    for each in report["movers"]:
        head = (
            f"  mover {each['mover']}: in {len(each['places'])} frames,"
            f" {each['rate_arcsec_s']:.2f}″/s towards {each['position_angle_deg']:.1f} deg"
        )
        yield f"{head}{_mag_words(each)}; {_identified_as(each)}"
        yield from _matches(each)
        for place in each["places"]:
            clock = place["t_utc"][11:23]
            where = direction(place["ra"], place["dec"], "bare")
            error = f"±{place['sigma_arcsec']:.1f}″{_mag_words(place)}"
            yield f"    {clock}  {where}  {error}  {place['frame']}"


def _streak_lines(each: dict[str, Any]) -> Iterator[str]:
    kind = streak_name_words(
        each["kind"], each["class"], each["class_probability"], train=each["train"]
    )
    about = f", {kind}" if kind else ""
    about += ", below tau" if each["below_tau"] else ""
    yield (
        f"  streak {each['streak']} at ({each['x']:.0f}, {each['y']:.0f}),"
        f" {each['length']:.0f} px{_mag_words(each)}{about}: {_identified_as(each)}"
    )
    yield from _matches(each)


def _mag_words(each: dict[str, Any]) -> str:
    """Magnitude of a streak or point: ``, mag 12.84±.03 V``; empty where it has none."""
    words = light_words(
        each["mag"], each["mag_sigma"], each["band"], is_saturated=bool(each["is_saturated"])
    )
    return f", {words}" if words else ""


def _identified_as(each: dict[str, Any]) -> str:
    if each["verdict"] == "unknown":
        return "not in catalogue"
    if each["verdict"] == "ambiguous":
        return "ambiguous"
    return _called(each["matches"][0])


def _matches(each: dict[str, Any]) -> Iterator[str]:
    """Lines on each candidate's errors along and across."""
    is_open = each["verdict"] == "ambiguous"
    for one in each["matches"]:
        name = f"{probability_words(one['probability']):>5}  {_called(one)}: " if is_open else ""
        yield f"    {name}{_errors(one)}"
    if is_open and each["not_catalogued"] >= 0.005:
        yield f"    {probability_words(each['not_catalogued']):>5}  not in catalogue"


def _errors(one: dict[str, Any]) -> str:
    along = one["along_track_s"]
    sense = "ahead of" if along > 0 else "behind"
    digits = 1 if abs(along) >= 10.0 else 2
    across = signed_angle(one["cross_track_arcsec"])
    words = f"{abs(along):.{digits}f} s {sense} its elements, {across} across"
    return f"{words}; elements {element_age_words(one['tle_age_days'])}"


def _unseen_lines(each: dict[str, Any]) -> Iterator[str]:
    yield (
        f"    {_called(each)}: {each['unseen_because']};"
        f" {probability_words(each['chance'])} to have crossed"
    )
    yield (
        f"      {each['rate_arcsec_s']:.1f}″/s, {each['range_km']:,.0f} km, sought"
        f" ±{each['gate_along_s']:.0f} s along and ±{each['gate_across_arcmin']:.1f}' across;"
        f" elements {element_age_words(each['tle_age_days'])}"
    )


def _called(one: dict[str, Any]) -> str:
    return catalogued_name(one["name"][:_NAME_WIDTH], one["norad_id"])


def track_identification_lines(tracks: Sequence[dict[str, Any]]) -> Iterator[str]:
    """One line per track in order of time, followed by its candidates where there are several."""
    for each in tracks:
        arc = f"{each['directions']} in {duration_words(each['arc_s'], 'line')}"
        head = f"track {each['track']}: {each['verdict']}"
        if each["verdict"] == "identified":
            best = each["candidates"][0]
            name = catalogued_name(best["name"], best["norad_id"])
            yield f"{head}: {name}, {probability_words(best['probability'])}; {arc}"
            continue
        past = each["ledger"]
        if each["verdict"] == "unknown" and past is not None:
            head += f", {_past_words(past)}"
        yield f"{head}; {arc}"
        if each["verdict"] == "ambiguous":
            for one in each["candidates"]:
                name = catalogued_name(one["name"], one["norad_id"])
                yield f"  {probability_words(one['probability']):>5}  {name}"
            yield f"  {probability_words(each['not_catalogued']):>5}  not in catalogue"


def ledger_match_lines(report: dict[str, Any]) -> Iterator[str]:
    """Lines on the ledger entries that match tracks, and on tracks put into the ledger now."""
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
    return f"{doubt}{past['name']}, seen {seen} ({probability_words(past['probability'])})"
