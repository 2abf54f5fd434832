"""The orbit pane's contents and lines: identification, elements, places ahead, quality.

Each line has a rank: in a low pane the lines of the lowest ranks stay, in the order of the pane.
"""

import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.night.engine_view import EngineView, OrbitPrediction
from rsoconsole.console.tuning.what_if_watch import TrackQuality, track_quality
from rsoconsole.console.words.words import (
    Item,
    cut_to_width,
    draw_rule,
    frame_clock_utc_ns,
    items_in_rows,
    wrap_to_rows,
)
from rsoconsole.control import one_line
from rsoconsole.night import NightView, merit
from rsoconsole.records import CatalogueMatch, Identified, OrbitEstimate
from rsoconsole.tracking import NIS_BAND
from rsoconsole.words import (
    NS_PER_S,
    angle,
    catalogued_name,
    count_words,
    duration_words,
    eclipse_words,
    format_dec,
    format_ra,
    identity_words,
    match_words,
    number,
    plus_minus,
    semi_major_axis_words,
    set_or_rise_words,
    utc_text,
)

MIN_MEASUREMENTS = 3
AHEAD_GOOD_S = 300.0
"""Seconds from the instant of a prediction within which it is still shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitPaneContents:
    """What the orbit pane shows: orbit, identification, prediction, track quality."""

    estimate: OrbitEstimate | None = None
    identified: Identified | None = None
    ahead: OrbitPrediction | None = None
    now_utc_ns: int | None = None
    last_utc_ns: int | None = None
    """Time at which the orbit was found, UTC ns, where its track has ended; else None."""
    is_past: bool = False
    since_word_s: float | None = None
    """Age in seconds of an orbit that is fitted again since the operator decided; else None."""
    absence: str = ""
    """Reason why there is no orbit; empty where there is an orbit."""
    quality: TrackQuality | None = None
    """The lead track's quality; None before its first update."""
    has_site: bool = True
    """True where the session's settings, and with them its site, are known."""
    has_catalogue: bool = True
    """False where the settings are known to name no catalogue to identify by."""


def orbit_pane_contents(
    night: NightView, engine: EngineView, ahead: OrbitPrediction | None
) -> OrbitPaneContents:
    """Return the contents of the orbit pane.

    ``ahead``: the last prediction, which may be of another orbit and is then left out.
    """
    now = frame_clock_utc_ns(night, engine)
    is_fit = ahead is not None and _is_near(ahead, night, now) and _is_of(ahead, night)
    return OrbitPaneContents(
        estimate=night.orbit,
        identified=night.identified,
        ahead=ahead if is_fit else None,
        now_utc_ns=now,
        last_utc_ns=night.orbit_utc_ns if night.is_orbit_of_past_lead else None,
        is_past=night.is_orbit_of_past_lead,
        quality=track_quality(night),
        since_word_s=_since_word_s(night, now),
        absence="" if night.orbit is not None else _absence(night, engine),
        has_site=night.config is not None,
        has_catalogue=night.config is None or bool(night.config.catalogue.tle_files),
    )


def _since_word_s(night: NightView, now: int | None) -> float | None:
    """Return the age in seconds of an orbit that is being fitted again; None: none is."""
    orbit, found_ns = night.orbit, night.orbit_utc_ns
    if orbit is None or found_ns is None or orbit.track_id not in night.being_fitted_again:
        return None
    return max(((now or found_ns) - found_ns) / NS_PER_S, 0.0)


def _is_near(ahead: OrbitPrediction, night: NightView, now: int | None) -> bool:
    """Return True if a prediction is of this session, and for about this instant."""
    if now is None or ahead.folder != night.folder:
        return False
    return abs(now - ahead.from_utc_ns) <= AHEAD_GOOD_S * NS_PER_S


def _is_of(ahead: OrbitPrediction, night: NightView) -> bool:
    """Return True if a prediction is of the recorded orbit, or of an earlier one of its track."""
    if night.orbit is None:
        return False
    if ahead.estimate == night.orbit:
        return True
    is_same_track = ahead.estimate.track_id == night.orbit.track_id
    is_before = ahead.estimate.frame_id < night.orbit.frame_id
    return not night.is_orbit_of_past_lead and is_same_track and is_before


def _absence(night: NightView, engine: EngineView) -> str:
    count = _measured(night)
    if night.track is None:
        return "nothing is followed: there is no orbit"
    if count < MIN_MEASUREMENTS:
        return f"an orbit needs {MIN_MEASUREMENTS} measurements: {count} so far"
    if night.setting("orbit.online") is False:
        return "no orbit is computed: the setting orbit.online is off"
    if engine.reach == "recorded":
        return "no orbit is on record here: recorded without, or too little was measured"
    return "no orbit yet: the measurements so far tell none"


def _measured(night: NightView) -> int:
    """Return the track's number of measurements, counted up to ``MIN_MEASUREMENTS``."""
    count = 1 if night.track_frame_id else 0  # a track begins with its second one
    for row in reversed(night.rows):
        if count >= MIN_MEASUREMENTS or row.frame_id < night.track_frame_id:
            break
        count += row.is_followed
    return count


if TYPE_CHECKING:
    from rsoconsole.pipeline import FuturePosition, OrbitOutlook

Ranked = tuple[int, Line]

WIDE_COLUMNS = 57
"""Columns of the pane from which on each predicted place names its own values, without a head."""
NARROW_COLUMNS = 47
"""Columns of the pane below which there is no room for an azimuth."""
SOON_S = 900.0
"""Seconds ahead within which an event is shown as a warning."""
MAX_ROWS = 4
KNOWN_DEG = 60.0
"""Sigma from which on the node and the argument of perigee are not shown, degrees."""
HALF_SKY_ARCSEC = 648_000.0
LABEL_INKS: dict[str, Ink] = {"free": "good", "weak geometry": "warn", "not observable": "warn"}


def orbit_lines(shown: OrbitPaneContents, width: int, height: int) -> list[Line]:
    """Return the pane's lines that fit, in their order; the highest ranks are left out first."""
    estimate = shown.estimate
    lines: list[Ranked] = [(0, _title(shown, width))]
    if estimate is None:
        lines += _ranked(_said(shown.absence, "dim", width), 1)
    if shown.quality is not None:
        lines += _track_lines(shown.quality, width)
    if estimate is not None or shown.identified is not None:
        lines += _name_lines(shown, width)
    if shown.since_word_s is not None:
        age = f"from {duration_words(shown.since_word_s)} ago"
        lines += _ranked(_said(f"{age}: being fitted again after your word", "warn", width), 1)
    if estimate is not None:
        lines += _element_lines(shown, estimate, width)
        lines += _ahead_lines(shown, width)
        lines += _quality_lines(shown, estimate, width)
    kept = sorted(range(len(lines)), key=lambda n: (lines[n][0], n))[: max(height, 0)]
    return [cut_to_width(lines[n][1], width) for n in sorted(kept)]


def target_words(shown: OrbitPaneContents) -> tuple[str, str, str]:
    """Return the target's name, the size of its orbit, and "by prior" if that size is assumed.

    Each is empty where it is not known or does not apply.
    """
    estimate, found = shown.estimate, shown.identified
    if shown.is_past:
        return "", "", ""
    name = "" if found is None else _one_wide(identity_words(found))
    if estimate is None or estimate.label == "not observable":
        return name, "", ""
    size = f"a = {plus_minus(estimate.a_km, estimate.sigma_a_km)} km"
    return name, size, _by_prior(estimate).strip()


def _by_prior(estimate: OrbitEstimate) -> str:
    """Return words for a size that rests on the prior; empty: the size was measured."""
    return "" if estimate.prior == "none" else " by prior"


def _title(shown: OrbitPaneContents, width: int) -> Line:
    estimate = shown.estimate
    head = "orbit"
    if shown.is_past:
        at = f" {utc_text(shown.last_utc_ns, zone='')}" if shown.last_utc_ns else ""
        head = f"last orbit{at}"
    if estimate is None:
        return draw_rule(head, "", width)
    label = estimate.label
    with_prior = f"{label} ({estimate.prior})" if estimate.prior != "none" else label
    if len(f"─ {head} · {with_prior} ") <= width:
        label = with_prior
    ink = LABEL_INKS.get(estimate.label, "")
    arc = f"{estimate.observations} in {duration_words(estimate.arc_s)}"
    return draw_rule([(head, "title"), (" · ", "dim"), (label, ink)], arc, width)


def _name_lines(shown: OrbitPaneContents, width: int) -> list[Ranked]:
    """Return the identification, its runner-up, and a hint at a manoeuvre."""
    found = shown.identified
    if found is None:
        why = "not identified" if shown.is_past else "not identified yet"
        if not shown.has_catalogue:
            why = "no name: the setting catalogue.tle_files is empty"
        return [(1, [(f" {why}", "dim")])]
    lines: list[Ranked] = []
    if found.verdict == "unknown" or not found.matches:
        lines += _ranked(_said(f"unknown: {found.reason}", "warn", width), 1, 2)
    else:
        best, *others = found.matches
        is_sure = found.verdict == "identified"
        items: list[Item] = [(_called(best, is_sure=is_sure), "good" if is_sure else "warn")]
        items += [(word, "") for word in match_words(best)]
        lines += _ranked(items_in_rows(items, width, MAX_ROWS), 1, 5)
        if others:
            then = (f"then {_called(others[0])}", *match_words(others[0])[:2])
            lines += _ranked(items_in_rows([(word, "") for word in then], width, 2), 4, 8)
        if not is_sure:
            lines += _ranked(_said(f"ambiguous: {found.reason}", "warn", width), 6)
    if found.hint:
        lines += _ranked(_said(f"manoeuvre? {found.hint}", "warn", width), 2, 3)
    compared = f"by {found.observations} directions against {found.catalogued} objects"
    if found.named_with:
        compared += f", with {count_words(found.named_with, 'other track')}"
    return [*lines, (9, [(f" {compared}", "dim")])]


def _called(match: CatalogueMatch, *, is_sure: bool = True) -> str:
    return _one_wide(catalogued_name(match.name, match.norad_id)) + ("" if is_sure else "?")


def _element_lines(shown: OrbitPaneContents, estimate: OrbitEstimate, width: int) -> list[Ranked]:
    ahead = shown.ahead
    sigmas = dict(ahead.sigmas) if ahead is not None else {}
    ink = LABEL_INKS.get(estimate.label, "")
    ink = "" if ink == "good" else ink
    items: list[Item] = [
        (semi_major_axis_words(estimate.a_km, estimate.sigma_a_km) + _by_prior(estimate), ink),
        (f"e {plus_minus(estimate.e, sigmas.get('e'))}", ""),
        (f"i {plus_minus(estimate.i_deg, sigmas.get('i_deg'))}°", ""),
    ]
    for key, name in (("raan_deg", "node"), ("argp_deg", "argument")):
        value, sigma = (ahead.elements.get(key) if ahead is not None else None), sigmas.get(key)
        if value is not None and sigma is not None and sigma < KNOWN_DEG:
            turned = 0.0 if value > 359.95 else value
            items.append((f"{name} {plus_minus(turned, sigma)}°", ""))
    return _ranked(items_in_rows(items, width, MAX_ROWS), 1, 7)


def _ahead_lines(shown: OrbitPaneContents, width: int) -> list[Ranked]:
    """Return the predicted places, and rise, set and eclipse within a day."""
    ahead = shown.ahead
    if ahead is None:
        return [(3, [(" computing where it leads …", "dim")])] if shown.has_site else []
    if ahead.outlook is None:
        return [(3, [(" where it leads cannot be computed", "warn")])]
    lines: list[Ranked] = []
    if width < WIDE_COLUMNS:
        azimuth = "  az" if width >= NARROW_COLUMNS else ""
        lines.append((6, [(f" in    α        δ         ±1σ     alt{azimuth}", "dim")]))
    lines += [(3, _place_line(each, ahead.from_utc_ns, width)) for each in ahead.outlook.ahead]
    events = _event_items(ahead.outlook, ahead.from_utc_ns, shown.now_utc_ns)
    if width >= WIDE_COLUMNS and ahead.outlook.ahead:
        events.append(("± is 1σ", "dim"))
    return [*lines, *_ranked(items_in_rows(events, width, 2), 3, 7)]


def _place_line(place: "FuturePosition", from_utc_ns: int, width: int) -> Line:
    """Return the line of one predicted place; dim where it is below the horizon."""
    seconds = (place.t_utc_ns - from_utc_ns) / NS_PER_S
    value, unit = (seconds / 60.0, "min") if seconds < 3600.0 else (seconds / 3600.0, "h")
    if not math.isfinite(place.ra_icrs_deg + place.dec_icrs_deg + place.altitude_deg):
        return [(f" {value:.0f} {unit}: it has come down", "warn")]
    ra, dec = format_ra(place.ra_icrs_deg, 0), format_dec(place.dec_icrs_deg, 0)
    sigma = f"±{angle(place.sigma_arcsec, 'cell') if place.sigma_arcsec < HALF_SKY_ARCSEC else '?'}"
    alt, az = f"{place.altitude_deg:.0f}", f"{place.azimuth_deg:.0f}"
    if width < WIDE_COLUMNS:
        when = f"{value:.0f}min" if unit == "min" else f"{value:.0f} h"
        text = f" {when:<5} {ra} {dec} {sigma:<6} {alt + '°':>4}"
        text += f" {az + '°':>4}" if width >= NARROW_COLUMNS else ""
    else:
        text = f" {f'{value:.0f} {unit}':<6} α {ra} δ {dec} {sigma:<6} alt {alt:>3} az {az:>3}"
    light: Item = (" dark" if place.lit < 1.0 else "", "warn")
    return [(text, "dim" if place.altitude_deg < 0.0 else ""), light]


def _event_items(outlook: "OrbitOutlook", from_utc_ns: int, now: int | None) -> list[Item]:
    now = now or from_utc_ns
    is_up, eclipse = outlook.is_up, outlook.eclipse_utc_ns
    turns = outlook.sets_utc_ns if is_up else outlook.rises_utc_ns
    coming = [
        (set_or_rise_words(turns, now, is_up=is_up), turns),
        (eclipse_words(eclipse, from_utc_ns, now), None if eclipse is None else eclipse[0]),
    ]
    items: list[Item] = [] if is_up else [("is down", "warn")]
    for words, t_utc_ns in coming:
        is_soon = t_utc_ns is not None and t_utc_ns - now < SOON_S * NS_PER_S
        items.append((words, "warn" if is_soon else ""))
    return items


def _track_lines(quality: TrackQuality, width: int) -> list[Ranked]:
    """Return the lead track's quality, in the words of the tuning pane."""
    low, high = quality.nis_band or (0.0, 0.0)
    nis = f"NIS {number(quality.nis_mean, '.1f')} /{quality.updates}"
    items: list[Item] = [
        (f"track, {quality.frames} frames: rms {_fine(quality.residual_rms_arcsec or 0.0)}", ""),
        (f"{merit.INSIDE.label} {merit.INSIDE.words(quality)}", ""),
        (f"{quality.misses} missed", "warn" if quality.misses else ""),
        (f"{nis} (ideal 2, sound {low:.1f}-{high:.1f})", "" if quality.is_nis_sound else "warn"),
    ]
    lines = _ranked(items_in_rows(items, width, MAX_ROWS), 2, 3)
    if quality.lag_one is not None:
        bound = quality.lag_one_bound
        said = f" lag-1 {quality.lag_one:+.2f} (sound ±{bound:.2f})"
        lines.append((7, [(said, "" if abs(quality.lag_one) <= bound else "warn")]))
    return lines


def _quality_lines(shown: OrbitPaneContents, estimate: OrbitEstimate, width: int) -> list[Ranked]:
    """Return what predicts the next aim, and how well the orbit fits."""
    items: list[Item] = []
    if not shown.is_past:
        items.append((f"aims by the {'orbit' if estimate.is_guide else 'filter'}", ""))
    if estimate.nis is not None:
        is_far = estimate.nis > NIS_BAND[1]
        items.append((f"orbit's NIS {estimate.nis:.1f} /1 (ideal 2)", "warn" if is_far else ""))
    items.append((f"rms {_fine(estimate.rms_arcsec)}", ""))
    items.append((f"{estimate.observations} directions in {duration_words(estimate.arc_s)}", ""))
    if estimate.outliers:
        items.append((f"{estimate.outliers} left out", "warn"))
    why = wrap_to_rows(_one_wide(estimate.reason), max(width - 2, 1), 3)
    return [
        *_ranked(items_in_rows(items, width, MAX_ROWS), 4, 7),
        *_ranked([[(" ", ""), (line[0][0], "dim")] for line in why], 8),
    ]


def _fine(arcsec: float) -> str:
    return angle(arcsec).removeprefix("0")


def _said(text: str, ink: Ink, width: int) -> list[Line]:
    """Return a sentence over as many lines as a group may have."""
    lines = wrap_to_rows(_one_wide(text), max(width - 2, 1), MAX_ROWS)
    return [[(" ", ""), (line[0][0], ink)] for line in lines]


def _ranked(lines: Sequence[Line], first: int, others: int | None = None) -> list[Ranked]:
    return [(first if n == 0 or others is None else others, line) for n, line in enumerate(lines)]


def _one_wide(text: str) -> str:
    """Return text from foreign files with each character one column wide."""
    return "".join(
        "?" if unicodedata.east_asian_width(c) in "WF" or unicodedata.combining(c) else c
        for c in one_line(text)
    )
