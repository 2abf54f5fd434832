"""An orbit and a name in words and columns, for people; 80 columns at most."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import direction

_ELEMENT_WORDS = (
    ("a_km", "semi-major axis", "km"),
    ("e", "eccentricity", ""),
    ("i_deg", "inclination", "deg"),
    ("raan_deg", "ascending node", "deg"),
    ("argp_deg", "perigee from node", "deg"),
    ("m_deg", "mean anomaly", "deg"),
)
_MOST_DECIMALS = 7
_WIDTH = 78
_HALF_SKY_ARCSEC = 648_000.0
_NAME_WIDTH = 28


def orbit_lines(names: Sequence[str], report: dict[str, Any]) -> list[str]:
    """The report of ``rsoconsole orbit`` as a page."""
    lines = [f"{', '.join(names)}: {report['label']}", *_wrapped(report["reason"])]
    lines.extend(_wrapped(_data_words(report)))
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
    """The report of ``rsoconsole identify`` as a page."""
    lines = [f"{report['name']}: {report['verdict']}", *_wrapped(report["reason"])]
    if report["hint"]:
        lines.extend(_wrapped(report["hint"]))
    lines += ["", *_match_lines(report["matches"]), ""]
    at = _clock(report["t_utc"], with_date=True)
    gate = f"gate {report['gate_deg']:g} deg"
    lines.append(f"  {report['catalogued']} objects compared at {at} UTC; {gate}")
    if report["not_propagated"]:
        lines.append(f"  {report['not_propagated']} of them have no place then by SGP4 (decayed?)")
    lines.append("  off: measured minus predicted; along > 0: ahead, across > 0: north of eastward")
    return lines


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="  ")


def _data_words(report: dict[str, Any]) -> str:
    words = [f"{report['observations']} directions over {span_words(report['arc_s'])}"]
    if report["rms_arcsec"] is not None:
        words.append(f'rms {report["rms_arcsec"]:.2f}"')
    if report["outliers"]:
        words.append(f"{report['outliers']} left out as outliers")
    if report["prior"] not in (None, "none"):
        words.append(f"prior {report['prior']}")
    words.append(f"by {report['method'].replace('gooding', 'Gooding')}")
    return ", ".join(words)


def _part_lines(parts: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Only where there is more than one arc."""
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
        value, spread = _with_sigma(report[key], sigma)
        yield f"  {name:18} {value:>14} {spread:>14} {unit}".rstrip()
    if report["period_s"] is not None and math.isfinite(report["period_s"]):
        yield f"  {'period':18} {report['period_s'] / 60.0:14.2f} {'':14} min"


def _with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """Digits up to the second that is uncertain."""
    if sigma is None or not math.isfinite(sigma):
        return f"{value:.4g}", "± ?"
    decimals = 0
    if sigma < 10.0:
        decimals = min(_MOST_DECIMALS, 1 - math.floor(math.log10(max(sigma, 1e-12))))
    return f"{value:.{decimals}f}", f"± {sigma:.{decimals}f}"


def _ahead_lines(report: dict[str, Any]) -> Iterator[str]:
    yield f"  {'UTC':11} {'RA':13} {'Dec':13} {'±':>8} {'alt':>6} {'az':>6}"
    first = report["t_last_utc"]
    for each in report["predicted"]:
        name = span_words((iso_to_utc_ns(each["t_utc"]) - iso_to_utc_ns(first)) / 1e9)
        shade = "" if each["lit"] >= 1.0 else "  in shadow" if each["lit"] <= 0.0 else "  penumbra"
        clock, place = (
            _clock(each["t_utc"], seconds=True),
            direction(each["ra"], each["dec"], "bare"),
        )
        sigma = _angle(min(each["sigma_arcsec"], _HALF_SKY_ARCSEC))
        altaz = f"{each['alt']:6.1f} {each['az']:6.1f}"
        yield f"  {clock:11} {place:27} {sigma:>8} {altaz}  in {name}{shade}"


def _event_lines(report: dict[str, Any]) -> Iterator[str]:
    if report["is_up"]:
        sets = report["sets_utc"]
        yield "  " + (
            "stays above the telescope's limit for a day"
            if sets is None
            else f"sinks below the telescope's limit {_clock(sets, with_date=True)} UTC"
        )
    else:
        rises = report["rises_utc"]
        yield "  is below the telescope's limit" + (
            ", and stays there for a day"
            if rises is None
            else f"; rises above it {_clock(rises, with_date=True)} UTC"
        )
    begins, ends = report["eclipse_begins_utc"], report["eclipse_ends_utc"]
    if begins is None:
        yield "  no eclipse within a day"
    else:
        until = "" if ends is None else f" to {_clock(ends)}"
        yield f"  in the Earth's shadow {_clock(begins, with_date=True)}{until} UTC"


def _match_lines(matches: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield f"  {'':28} {'off':>7} {'along':>9} {'across':>7} {'rate':>7} {'age':>6} {'score':>6}"
    for each in matches:
        name = f"{each['norad_id']} {each['name']}"[:_NAME_WIDTH]
        rate = each["rate_difference_percent"]
        yield (
            f"  {name:28} {_angle(each['separation_arcsec']):>7} {each['along_track_s']:+8.1f}s"
            f" {_angle(each['cross_track_arcsec'], signed=True):>7}"
            f" {_rate(rate):>7}"
            f" {each['tle_age_days']:+5.1f}d {_score(each['score']):>6}"
        )


def _rate(percent: float | None) -> str:
    if percent is None:
        return "-"
    return f"{percent:+.2f}%" if abs(percent) < 10.0 else f"{percent:+.0f}%"


def _score(value: float) -> str:
    return f"{value:.1f}" if value < 1000.0 else ">1000"


def _angle(arcsec: float, *, signed: bool = False) -> str:
    sign = "+" if signed else ""
    size = abs(arcsec)
    if size < 600.0:
        return f'{arcsec:{sign}.{1 if size < 100.0 else 0}f}"'
    return f"{arcsec / 3600.0:{sign}.{2 if size < 36_000.0 else 1}f}°"


def span_words(seconds: float) -> str:
    if seconds < 5400.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{seconds / 3600.0:.3g} h" if seconds < 2 * 86_400.0 else f"{seconds / 86_400.0:.3g} d"


def _clock(iso: str, *, with_date: bool = False, seconds: bool = False) -> str:
    words = iso.replace("T", " ")[: 19 if seconds else 16]
    return words if with_date else words[11:]
