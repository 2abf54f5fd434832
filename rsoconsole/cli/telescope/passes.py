"""The verb passes: satellites in low orbits over the site tonight."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rsoconsole.base import OrbitError, SessionError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import ConfigOption, JsonOption, TleOption, read_element_sets
from rsoconsole.cli.words.standard_input import InputFiles, open_input_files
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.config import Config, load_config
from rsoconsole.words import NS_PER_S, count_words, no_night_text, utc_ns_to_iso, utc_text

if TYPE_CHECKING:
    from rsoconsole.orbits import CatalogueEntry, ElementSets, StandardMagnitude
    from rsoconsole.pipeline import FieldCrossing, LostObject, NightPass

_NAME_COLUMNS = 19
MAG_COLUMNS = 6
"""Width of the column of magnitudes, which is there where one is known, at the names' cost."""


def _header(mag: str) -> str:
    return (
        f"{'rises, UTC':11}  {'az':>3}  {'top':8} {'alt':>3}  {'sets':8}  {'az':>3}"
        f"  {'°/s':>5}  {'±s':>5}{mag}  name"
    )


def passes(
    *,
    tle: TleOption = None,
    norad: Annotated[
        list[int] | None,
        typer.Option(help="Only the object with this catalogue number; may be repeated."),
    ] = None,
    at: Annotated[
        str, typer.Option(help="UTC from which on; default: from dusk, or now if it is dark.")
    ] = "",
    hours: Annotated[
        float | None, typer.Option(min=0.1, max=48.0, help="How long. Default: until dawn.")
    ] = None,
    top: Annotated[
        float, typer.Option(min=0.0, max=90.0, help="Only passes that come so high, degrees.")
    ] = 30.0,
    every: Annotated[
        bool, typer.Option("--all", help="Higher orbits, and passes in the Earth's shadow, too.")
    ] = False,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """List the night's passes of catalogued objects in low orbits over the site.

    Without --tle the files of catalogue.tle_files in the configuration are used. A pass lasts
    while the object is above limits.min_altitude_deg and the horizon mask. Listed are passes that
    are sunlit at least in part; times are as sure as their elements (±s, one sigma by the
    elements' age). Element sets that cannot be used, and objects for which SGP4 has no place
    in the time asked for, are named on stderr; with --json in a last object.

    Objects whose brightness was measured on your own nights (calibrate-elements) have the
    magnitude (V) that they will have at the top of the pass, as a diffuse sphere, above the air;
    none in the Earth's shadow.

    Example: rsoconsole passes --tle active.tle --top 45
    """
    loaded = load_config(config)
    with open_input_files(tle or list(loaded.catalogue.tle_files)) as files:
        sets = _element_sets(files, norad or [])
    span = night_span_asked(loaded, at, hours, "--at")
    found, lost = _looked_for(sets.entries, loaded, span, is_low_only=not (every or norad))
    shown = [p for p in found if p.top.alt_deg >= top and (every or p.lit_from_utc_ns is not None)]
    mags = predicted_magnitudes(shown)
    if json_:
        for each, mag in zip(shown, mags, strict=True):
            output.emit_json(pass_report(each, mag))
        emit_not_used(sets, lost)
        return
    start, end = (utc_text(span[0], "dated minute", ""), utc_text(span[1], "dated minute"))
    words = f"from {start} to {end}"
    if not shown:
        output.say(f"no pass {words}: {_left_out_words(found, top)}")
        return
    dark = any(each.lit_from_utc_ns is None for each in shown)
    head = f"{len(shown)} passes {words}" + "; * in shadow" * dark
    cells, header = magnitude_cells(mags)
    output.say(head, _header(header), *map(_line, shown, cells))


def predicted_magnitudes(
    found: "Sequence[NightPass | FieldCrossing]",
) -> list[tuple[float, float] | None]:
    """Return the magnitude of each with its sigma, by the user's ledger; None where not known."""
    from rsoconsole.pipeline import predicted_magnitude

    standard = _standard_magnitudes() if found else {}
    return [predicted_magnitude(each, standard) for each in found]


def _standard_magnitudes() -> "Mapping[int, StandardMagnitude]":
    """Those of the ledger; none, said on stderr, where it cannot be read."""
    from rsoconsole.session import element_ledger_path, read_element_ledger

    try:
        return read_element_ledger(element_ledger_path()).standard_magnitudes()
    except SessionError as error:
        output.print_to_stderr(f"rsoconsole: without magnitudes: {error}")
        return {}


def magnitude_cells(mags: Sequence[tuple[float, float] | None]) -> tuple[list[str], str]:
    """Return the cells of the column of magnitudes and its heading; all empty if none is known."""
    width = MAG_COLUMNS if any(mags) else 0
    cells = ["" if each is None else f"{each[0]:.1f}" for each in mags]
    return [f"{each:>{width}}" for each in cells], f"{'mag':>{width}}" if width else ""


def _element_sets(files: InputFiles, norad: Sequence[int]) -> "ElementSets":
    sets = read_element_sets(files.paths, files)
    known = {each.norad_id for each in sets.entries}
    missing = [each for each in norad if each not in known]
    if missing:
        why = "; ".join(each.words for each in sets.not_used if each.norad_id in missing)
        raise OrbitError(
            f"no elements of {', '.join(map(str, missing))} in {', '.join(map(str, files.paths))}"
            + (f" can be used: {why}" if why else "")
        )
    if not norad:
        return sets
    return replace(sets, entries=tuple(e for e in sets.entries if e.norad_id in norad))


def night_span_asked(config: Config, at: str, hours: float | None, option: str) -> tuple[int, int]:
    """Return first and last instant, UTC ns, of the night or of the hours from ``at`` on.

    ``option``: the option's name, for errors. Raises OrbitError where the night has no dark time.
    """
    from rsoconsole.sky import iso_to_utc_ns, night_span

    with as_usage_error(option):
        now_ns = iso_to_utc_ns(at) if at else time.time_ns()
    twilight_deg = config.limits.twilight_deg
    dark = night_span(config.site.to_site(), now_ns, twilight_deg)
    first_ns = now_ns
    if not at and dark is not None:
        first_ns = max(dark[0], now_ns)
    if hours is not None:
        last_ns = first_ns + round(hours * 3600.0 * NS_PER_S)
    elif dark is not None:
        last_ns = max(dark[1], first_ns)
    else:
        raise OrbitError(f"{no_night_text(twilight_deg)}: say how long with --hours")
    return first_ns, last_ns


def _looked_for(
    entries: "Sequence[CatalogueEntry]", config: Config, span: tuple[int, int], *, is_low_only: bool
) -> "tuple[list[NightPass], list[LostObject]]":
    """Passes, and the objects for which SGP4 has no place in all or a part of the time.

    Raises OrbitError where it has none for any.
    """
    from rsoconsole.pipeline import catalogue_errors, night_passes

    found: list[NightPass] = []
    lost: list[LostObject] = []
    before = 0
    with progress_bar("objects", len(entries)) as bar:
        for done, some, failed in night_passes(
            entries,
            config.site.to_site(),
            span,
            config.limits,
            is_low_only=is_low_only,
            errors=catalogue_errors(config.catalogue),
        ):
            found += some
            lost += failed
            bar(done - before)
            before = done
    report_lost(lost, entries, is_all=not found)
    return sorted(found, key=lambda each: each.rise.t_utc_ns), lost


def report_lost(
    lost: "Sequence[LostObject]", entries: "Sequence[CatalogueEntry]", *, is_all: bool
) -> None:
    """Say on stderr for which objects SGP4 has no place in all or a part of the time.

    ``is_all``: nothing was found of any other. Raises OrbitError where it then has one for none.
    """
    from rsoconsole.orbits import first_few

    always = [each.words for each in lost if each.is_always]
    if always and is_all and len(always) == len({each.norad_id for each in entries}):
        raise OrbitError(f"no object can be propagated there: {first_few(always)}")
    for when, words in (
        ("at no time", always),
        ("in a part of the time only", [each.words for each in lost if not each.is_always]),
    ):
        if words:
            count = count_words(len(words), "object")
            said = f"{count} with a place {when}: {first_few(words)}"
            output.print_to_stderr(f"rsoconsole: {said}")


def emit_not_used(sets: "ElementSets", lost: "Sequence[LostObject]") -> None:
    """Print as JSON what has no place in all or a part of the time, where anything has none."""
    not_used = [*sets.not_used, *(each.unused for each in lost if each.is_always)]
    in_part = [each for each in lost if not each.is_always]
    if not_used or in_part:
        output.emit_json({"not_used": not_used, "placed_in_part": in_part})


def _left_out_words(found: "Sequence[NightPass]", top: float) -> str:
    if not found:
        return "no object of these elements in a low orbit comes above the limit"
    low = sum(each.top.alt_deg < top for each in found)
    dark = sum(each.lit_from_utc_ns is None for each in found)
    return f"of {len(found)} passes {low} stay below --top {top:g}, {dark} are in shadow (--all)"


def _line(one: "NightPass", mag: str) -> str:
    rise, top, sets = (utc_ns_to_iso(each.t_utc_ns)[:19] for each in (one.rise, one.top, one.set))
    # With --all some lie in the shadow of the Earth.
    name = f"{one.norad_id} {one.name}" if one.lit_from_utc_ns else f"*{one.norad_id} {one.name}"
    return (
        f"{rise[8:10]} {rise[11:]}  {one.rise.az_deg:3.0f}  {top[11:]} {one.top.alt_deg:3.0f}"
        f"  {sets[11:]}  {one.set.az_deg:3.0f}"
        f"  {one.rate_arcsec_s / 3600.0:5.3f}  {one.sigma_s:5.1f}{mag}"
        f"  {name[: _NAME_COLUMNS - len(mag)]}"
    )


def pass_report(one: "NightPass", mag: tuple[float, float] | None) -> dict[str, Any]:
    """One pass over the site as a JSON object; ``mag``: predicted magnitude and its sigma."""
    corners = {
        f"{name}_{key}": value
        for name, each in (("rise", one.rise), ("top", one.top), ("set", one.set))
        for key, value in (
            ("utc", utc_ns_to_iso(each.t_utc_ns)),
            ("alt_deg", each.alt_deg),
            ("az_deg", each.az_deg),
        )
    }
    lit = (one.lit_from_utc_ns, one.lit_until_utc_ns)
    from_utc, until_utc = (None if each is None else utc_ns_to_iso(each) for each in lit)
    return {
        "norad_id": one.norad_id,
        "name": one.name,
        **corners,
        "lit_from_utc": from_utc,
        "lit_until_utc": until_utc,
        "range_km": one.range_km,
        "rate_arcsec_s": one.rate_arcsec_s,
        "tle_age_days": one.tle_age_days,
        "sigma_s": one.sigma_s,
        **magnitude_report(one, mag),
    }


def magnitude_report(
    one: "NightPass | FieldCrossing", mag: tuple[float, float] | None
) -> dict[str, float | None]:
    """Phase angle and predicted magnitude, as a part of a JSON object."""
    value, sigma = (None, None) if mag is None else mag
    return {"phase_deg": one.phase_deg, "mag": value, "mag_sigma": sigma}
