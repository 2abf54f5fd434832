"""The verb crossings: catalogued objects that will cross a field of the sky."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.cli.telescope.passes import (
    emit_not_used,
    magnitude_cells,
    magnitude_report,
    night_span_asked,
    predicted_magnitudes,
    report_lost,
)
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import ConfigOption, JsonOption, TleOption, read_element_sets
from rsoconsole.cli.words.standard_input import open_input_files
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.config import load_config
from rsoconsole.words import NS_PER_S, utc_ns_to_iso, utc_text

if TYPE_CHECKING:
    from rsoconsole.orbits import CatalogueEntry, ElementErrors
    from rsoconsole.pipeline import FieldCrossing, LostObject, RoundField

_NAME_COLUMNS = 19


def _header(mag: str) -> str:
    return (
        f"{'in, UTC':11}  {'out':8}  {'alt':>3}  {'off':>5}  {'to':>4}  {'″/s':>6}"
        f"  {'km up':>6}  {'±s':>5}{mag}  name"
    )


def crossings(
    *,
    at: Annotated[
        tuple[str, str],
        typer.Option(
            metavar="RA DEC", help="Centre of the field, ICRS: degrees, or 20:54:44 -04:47:00."
        ),
    ],
    field: Annotated[float, typer.Option(metavar="DEG", help="Diameter of the field, degrees.")],
    tle: TleOption = None,
    start: Annotated[
        str,
        typer.Option(
            "--from", metavar="UTC", help="From when on; default: from dusk, or now if it is dark."
        ),
    ] = "",
    hours: Annotated[
        float | None, typer.Option(min=0.01, max=48.0, help="How long. Default: until dawn.")
    ] = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """List the catalogued objects that will cross a field of the sky, with times and path.

    The field is round and stays among the stars. A crossing counts while the object is above the
    horizon; times are as sure as the elements (±s, one sigma by their age). Without --tle the files
    of catalogue.tle_files in the configuration are used.

    Listed: when it comes in and goes out; altitude, distance from the centre (off, degrees),
    direction of motion (to, from north through east) and rate where it is nearest to the centre;
    its height over the Earth. Objects whose brightness was measured on your own nights
    (calibrate-elements) have the magnitude (V) that they will have there, as a diffuse
    sphere, above the air; none in the Earth's shadow.

    Example: rsoconsole crossings --at 313.7 -4.8 --field 1.5 --tle active.tle
    """
    from rsoconsole.pipeline import MAX_FIELD_DEG, RoundField, catalogue_errors
    from rsoconsole.sky import parse_dec_deg, parse_ra_deg

    with as_usage_error("--at"):
        ra_deg, dec_deg = parse_ra_deg(at[0]), parse_dec_deg(at[1])
    with as_usage_error("--field"):
        if not 0.0 < field <= MAX_FIELD_DEG:
            raise ValueError(f"{field:g} degrees: above 0, and {MAX_FIELD_DEG:g} at most")
    loaded = load_config(config)
    with open_input_files(tle or list(loaded.catalogue.tle_files)) as files:
        sets = read_element_sets(files.paths, files)
    span = night_span_asked(loaded, start, hours, "--from")
    of = RoundField(
        site=loaded.site.to_site(), ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg, diameter_deg=field
    )
    found, lost = _looked_for(sets.entries, of, span, catalogue_errors(loaded.catalogue))
    mags = predicted_magnitudes(found)
    if json_:
        for each, mag in zip(found, mags, strict=True):
            output.emit_json(crossing_report(each, mag))
        emit_not_used(sets, lost)
        return
    begins, ends = (utc_text(span[0], "dated minute", ""), utc_text(span[1], "dated minute"))
    words = f"of {field:g}° about RA {ra_deg:.3f} Dec {dec_deg:+.3f} from {begins} to {ends}"
    if not found:
        output.say(f"no crossing {words}, by {len(sets.entries)} element sets")
        return
    is_any_dark = any(not each.is_lit for each in found)
    head = f"{len(found)} crossing{'s' * (len(found) > 1)} {words}" + "; * in shadow" * is_any_dark
    cells, header = magnitude_cells(mags)
    output.say(head, _header(header), *map(_line, found, cells))


def _looked_for(
    entries: "Sequence[CatalogueEntry]",
    field: "RoundField",
    span: tuple[int, int],
    errors: "ElementErrors",
) -> "tuple[list[FieldCrossing], list[LostObject]]":
    from rsoconsole.pipeline import field_crossings

    found: list[FieldCrossing] = []
    lost: list[LostObject] = []
    before = 0
    with progress_bar("objects", len(entries)) as bar:
        for some in field_crossings(entries, field, span, errors):
            found += some.crossings
            lost += some.lost
            bar(some.done - before)
            before = some.done
    report_lost(lost, entries, is_all=not found)
    return sorted(found, key=lambda each: each.enter.t_utc_ns), lost


def _line(one: "FieldCrossing", mag: str) -> str:
    enter, leave = (utc_ns_to_iso(each.t_utc_ns)[:19] for each in (one.enter, one.leave))
    name = f"{'' if one.is_lit else '*'}{one.norad_id} {one.name}"
    return (
        f"{enter[8:10]} {enter[11:]}  {leave[11:]}  {one.nearest.alt_deg:3.0f}"
        f"  {one.offset_deg:5.2f}  {one.motion_deg:3.0f}°  {one.rate_arcsec_s:6.1f}"
        f"  {one.height_km:6.0f}  {one.sigma_s:5.1f}{mag}"
        f"  {name[: _NAME_COLUMNS - len(mag)]}"
    )


def crossing_report(one: "FieldCrossing", mag: tuple[float, float] | None) -> dict[str, object]:
    """One crossing of a field as a JSON object; ``mag``: predicted magnitude and its sigma."""
    points = {
        f"{name}_{key}": value
        for name, each in (("enter", one.enter), ("nearest", one.nearest), ("leave", one.leave))
        for key, value in (
            ("utc", utc_ns_to_iso(each.t_utc_ns)),
            ("ra", each.ra_icrs_deg),
            ("dec", each.dec_icrs_deg),
            ("alt_deg", each.alt_deg),
        )
    }
    return {
        "norad_id": one.norad_id,
        "name": one.name,
        **points,
        "duration_s": (one.leave.t_utc_ns - one.enter.t_utc_ns) / NS_PER_S,
        "offset_deg": one.offset_deg,
        "motion_deg": one.motion_deg,
        "rate_arcsec_s": one.rate_arcsec_s,
        "range_km": one.range_km,
        "height_km": one.height_km,
        "sunlit": one.is_lit,
        "tle_age_days": one.tle_age_days,
        "sigma_s": one.sigma_s,
        **magnitude_report(one, mag),
    }
