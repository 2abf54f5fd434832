"""Orbits and identifications in lines of at most 80 columns for people."""

import math
import textwrap
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import typer

from rsoconsole.base import OrbitError
from rsoconsole.cli.words import output
from rsoconsole.library import write_file
from rsoconsole.orbits import omm_message
from rsoconsole.pipeline import FittedElements
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import (
    angle,
    direction,
    duration_words,
    eclipse_words,
    rounded_to_sigma,
    set_or_rise_words,
    signed_angle,
)

_ELEMENT_WORDS = (
    ("a_km", "semi-major axis", "km"),
    ("e", "eccentricity", ""),
    ("i_deg", "inclination", "deg"),
    ("raan_deg", "ascending node", "deg"),
    ("argp_deg", "perigee from node", "deg"),
    ("m_deg", "mean anomaly", "deg"),
)
_WIDTH = 78
_HALF_SKY_ARCSEC = 648_000.0
_NAME_WIDTH = 28
_NOT_USED_SHOWN = 8


def orbit_lines(names: Sequence[str], report: dict[str, Any]) -> list[str]:
    """Return ``rsoconsole orbit``'s report as lines for people; ``names``: the inputs' names."""
    lines = [f"{', '.join(names)}: {report['label']}", *_wrapped(report["reason"])]
    lines.extend(_wrapped(_data_words(report)))
    lines.extend(not_used_lines(report["lines_not_used"]))
    lines.extend(_part_lines(report["parts"]))
    if report["a_km"] is not None:
        lines += ["", *_element_lines(report)]
    if len(report["solutions"]) > 1:
        lines += ["", "Other orbits through the same three directions:"]
        lines.extend(
            f"  a {each['a_km']:.0f} km, e {each['e']:.4f}, i {each['i_deg']:.2f} deg,"
            f" range {each['range_km']:.0f} km"
            for each in report["solutions"][1:]
        )
    if report["predicted"]:
        lines += ["", *_ahead_lines(report), "", *_event_lines(report)]
    if report["tle"]:
        lines += [
            "",
            f"  Elements for SGP4, {report['tle_frame']} (--out writes them):",
            *report["tle"],
        ]
    return lines


def identification_lines(report: dict[str, Any]) -> list[str]:
    """The report of ``rsoconsole identify`` as lines for people."""
    lines = [f"{report['name']}: {report['verdict']}", *_wrapped(report["reason"])]
    if report["hint"]:
        lines.extend(_wrapped(report["hint"]))
    lines.extend(not_used_lines(report["lines_not_used"]))
    lines += ["", *_match_lines(report["matches"]), ""]
    at = _clock(report["t_utc"], with_date=True)
    gate = f"gate {report['gate_deg']:g} deg"
    lines.append(f"  {report['catalogued']} objects compared at {at} UTC; {gate}")
    if report["not_propagated"]:
        lines.append(f"  {report['not_propagated']} of them have no place then by SGP4 (decayed?)")
    lines.append("  off: measured minus predicted; along > 0: ahead, across > 0: north of eastward")
    return lines


def not_used_lines(not_used: Sequence[str]) -> list[str]:
    """Lines on what of a file gave no direction: how much, and the first of it with why."""
    if not not_used:
        return []
    count = "1 line" if len(not_used) == 1 else f"{len(not_used)} lines"
    more = len(not_used) - _NOT_USED_SHOWN
    shown = [line for each in not_used[:_NOT_USED_SHOWN] for line in _wrapped(each)]
    rest = [f"  and {more} more: --json has all"] if more > 0 else []
    return [f"  not used: {count}", *shown, *rest]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="  ")


def _data_words(report: dict[str, Any]) -> str:
    words = [f"{report['observations']} directions over {duration_words(report['arc_s'], 'line')}"]
    if report["rms_arcsec"] is not None:
        words.append(f"rms {report['rms_arcsec']:.2f}″")
    if report["outliers"]:
        times = ", ".join(_clock(each, seconds=True) for each in report["outliers_utc"][:3])
        more = ", ..." if report["outliers"] > 3 else ""
        words.append(f"{report['outliers']} left out as outliers ({times}{more})")
    if report["prior"] not in (None, "none"):
        words.append(f"prior {report['prior']}")
    words.append(f"by {report['method'].replace('gooding', 'Gooding')}")
    return ", ".join(words)


def _part_lines(parts: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines on the arcs; none where there is only one."""
    if len(parts) < 2:
        return
    yield ""
    for part in parts:
        probability = part["same_object_probability"]
        if probability is None:
            words = "begun with" if part["is_used"] else "too short to be asked"
        else:
            words = f"the same object: {100.0 * probability:.1f} %"
        words += "" if part["is_used"] else ", not used"
        begin = _clock(part["t_first_utc"], with_date=True)
        yield f"  {begin}  {part['observations']:4d} directions  {words}  ({part['name']})"


def _element_lines(report: dict[str, Any]) -> Iterator[str]:
    yield f"  {'epoch':18} {_clock(report['epoch_utc'], with_date=True, seconds=True)} UTC"
    yield f"  {'frame':18} {report['frame']}, osculating"
    for key, name, unit in _ELEMENT_WORDS:
        sigma = report["sigma_a_km"] if key == "a_km" else report["sigmas"][key]
        value, spread = rounded_to_sigma(report[key], sigma, digits=2)
        spread = f"± {spread or '?'}"
        yield f"  {name:18} {value:>14} {spread:>14} {unit}".rstrip()
    if report["period_s"] is not None and math.isfinite(report["period_s"]):
        yield f"  {'period':18} {report['period_s'] / 60.0:14.2f} {'':14} min"


def _ahead_lines(report: dict[str, Any]) -> Iterator[str]:
    yield f"  {'UTC':11} {'RA':13} {'Dec':13} {'±':>8} {'alt':>6} {'az':>6}"
    first = report["t_last_utc"]
    for each in report["predicted"]:
        name = duration_words((iso_to_utc_ns(each["t_utc"]) - iso_to_utc_ns(first)) / 1e9, "line")
        shade = "" if each["lit"] >= 1.0 else "  in shadow" if each["lit"] <= 0.0 else "  penumbra"
        clock, place = (
            _clock(each["t_utc"], seconds=True),
            direction(each["ra"], each["dec"], "bare"),
        )
        sigma = angle(min(each["sigma_arcsec"], _HALF_SKY_ARCSEC))
        altaz = f"{each['alt']:6.1f} {each['az']:6.1f}"
        yield f"  {clock:11} {place:27} {sigma:>8} {altaz}  in {name}{shade}"


def _event_lines(report: dict[str, Any]) -> Iterator[str]:
    sets, rises, begins, ends, last = (
        None if report[key] is None else iso_to_utc_ns(report[key])
        for key in ("sets_utc", "rises_utc", "eclipse_begins_utc", "eclipse_ends_utc", "t_last_utc")
    )
    is_up, now = bool(report["is_up"]), last or 0
    down = "" if is_up else "is down; "
    turn = set_or_rise_words(sets if is_up else rises, now, "dated minute", is_up=is_up)
    yield f"  by the telescope's limit it {down}{turn}"
    yield f"  {eclipse_words(None if begins is None else (begins, ends), now, now, 'dated minute')}"


def _match_lines(matches: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield f"  {'':28} {'off':>7} {'along':>9} {'across':>7} {'rate':>7} {'age':>6} {'score':>6}"
    for each in matches:
        name = f"{each['norad_id']} {each['name']}"[:_NAME_WIDTH]
        rate = each["rate_difference_percent"]
        score = f"{each['score']:.1f}" if each["score"] < 1000.0 else ">1000"
        yield (
            f"  {name:28} {angle(each['separation_arcsec']):>7} {each['along_track_s']:+8.1f}s"
            f" {signed_angle(each['cross_track_arcsec']):>7}"
            f" {_rate(rate):>7}"
            f" {each['tle_age_days']:+5.1f}d {score:>6}"
        )


def _rate(percent: float | None) -> str:
    if percent is None:
        return "-"
    return f"{percent:+.2f}%" if abs(percent) < 10.0 else f"{percent:+.0f}%"


def _clock(iso: str, *, with_date: bool = False, seconds: bool = False) -> str:
    words = iso.replace("T", " ")[: 19 if seconds else 16]
    return words if with_date else words[11:]


Form = Literal["tle", "kvn", "xml", "json"]
_BY_ENDING: dict[str, Form] = {
    ".tle": "tle",
    ".txt": "tle",
    ".kvn": "kvn",
    ".omm": "kvn",
    ".xml": "xml",
    ".json": "json",
}


def elements_form(path: Path) -> Form:
    """Form of elements (TLE or a kind of OMM) by the file's ending; BadParameter if unknown."""
    if str(path) == "-":
        return "tle"
    form = _BY_ENDING.get(path.suffix.lower())
    if form is None:
        raise typer.BadParameter(
            f"{path}: end it in .tle, or .kvn, .xml or .json for an OMM", param_hint="--out"
        )
    return form


def write_elements(elements: FittedElements, path: Path, form: Form, *, force: bool) -> str:
    """Write elements to a file; return what was done, in words.

    ``force``: replace an existing file. Raises OrbitError where no elements were fitted,
    ExportError where the file cannot be written.
    """
    if elements.mean is None:
        raise OrbitError(f"no elements to write: {elements.reason}")
    if form == "tle":
        if elements.tle is None:
            raise OrbitError(elements.reason)
        text = "\n".join((elements.mean.name, *elements.tle)) + "\n"
    else:
        text = omm_message(elements.mean, created_utc_ns=time.time_ns(), form=form)
    if str(path) == "-":
        output.emit_text(text if text.endswith("\n") else f"{text}\n")
        return ""
    write_file(path, text.encode("utf-8"), is_forced=force)
    return f"wrote {path}"
