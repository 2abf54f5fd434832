"""The verb orbit: from a track to an orbit."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from rsoconsole.base import ConfigError, ExportError
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import ConfigOption, JsonOption, parse_site
from rsoconsole.cli.words.standard_input import open_input_files
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.config import load_config

if TYPE_CHECKING:
    from rsoconsole.library import ReadOptions

PriorChoice: TypeAlias = Literal["auto", "none", "slot", "geo", "meo", "leo"]
SigmaOption = Annotated[
    float,
    typer.Option("--sigma", min=0.001, help="Arcsec, of observations in files that state none."),
]
TrackOption = Annotated[
    int | None,
    typer.Option(
        min=1, help="Which of a session's tracks, in order of time. Default: the longest."
    ),
]
SiteOption = Annotated[
    str | None,
    typer.Option(
        metavar="LAT,LON,METRES",
        help="Where the station of a file stands that does not say so; east positive.",
    ),
]
StationsOption = Annotated[
    Path | None,
    typer.Option(help="File of stations: '2701 ME 43.6876 -79.3924 230 Name', a line each."),
]
ObjectOption = Annotated[
    str | None,
    typer.Option("--object", help="Which object of a file that holds several, as it is called."),
]
RadiansOption = Annotated[
    bool | None, typer.Option("--radians/--degrees", help="What the angles of a table are in.")
]
AHEAD_S = (600, 3600, 86_400)
_ANOTHER = 0.1
"""Probability that several tracks are of one object below which a warning is printed."""


def orbit(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="SESSION-or-FILE...",
            help="Sessions or files of observations; - for one on standard input.",
            autocompletion=completion.sessions,
        ),
    ],
    *,
    prior: Annotated[
        PriorChoice,
        typer.Option(help="What is believed of the orbit beforehand; auto: only what is needed."),
    ] = "auto",
    gooding: Annotated[
        bool,
        typer.Option("--gooding", help="Only Gooding's orbit through three of the directions."),
    ] = False,
    track: TrackOption = None,
    sigma: SigmaOption = 1.0,
    site: SiteOption = None,
    stations: StationsOption = None,
    object_: ObjectOption = None,
    radians: RadiansOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write elements for SGP4: .tle (two lines), or an OMM as .kvn, .xml or .json;"
            " - for two lines on stdout."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over an existing file.")] = False,
    norad: Annotated[
        int | None,
        typer.Option(min=1, max=999_999_999, help="Catalogue number to write into them."),
    ] = None,
    name: Annotated[str, typer.Option(help="Name to write into them.")] = "UNKNOWN",
    cospar: Annotated[
        str | None,
        typer.Option(metavar="2009-064A", help="International designator to write into them."),
    ] = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Determine the orbit of the object that was followed, and how well it is known.

    Only angles are used: a short arc hardly constrains the range, and the label
    says so. 'free': the directions alone give the semi-major axis to 100 km.
    'constrained by prior': they do with the assumption of --prior (slot: held over
    the equator; geo, meo, leo: nearly circular).
    'weak geometry': an orbit, but unchecked or vague. 'not observable': none.

    Several sessions or files are several nights of one object; for each
    further one the answer says how likely that is. Files may be CCSDS TDM (keyword =
    value or XML), IOD or UK lines, tables with named columns (time, ra_deg,
    dec_deg; CSV, ECSV, JSON lines), UDL EOObservation records, or JSON:
    "site" with lat_deg, lon_deg, alt_m; "obs", rows of UTC, RA and Dec
    (J2000 degrees as a plate solution measures them) and, if known, sigmas
    in arcsec. --site or --stations give the place where a file does not.

    State, covariance and elements are along GCRS axes at the epoch; the
    elements for SGP4 are TEME, as SGP4 requires.

    Elements for SGP4 are fitted where the orbit is free or constrained.

    Example: rsoconsole orbit sessions/intelsat-14 --out intelsat-14.tle
    """
    from rsoconsole.cli.words.orbit_words import elements_form, orbit_lines, write_elements
    from rsoconsole.library import Target, read_observations
    from rsoconsole.orbits import ANALYST_NUMBERS
    from rsoconsole.pipeline import (
        find_by_gooding,
        find_orbit,
        orbit_elements,
        orbit_outlook,
        orbit_report,
    )

    form = None if out is None else elements_form(out)  # before the work: a wrong ending ends it
    ask = read_options(sigma, site, stations, object_, is_radians=radians)
    with as_usage_error("--cospar", ExportError):
        target = Target(cospar=cospar)
    with open_input_files(paths) as files, progress_bar("orbit"):
        read = [
            group for path in files.paths for group in read_observations(path, ask, track=track)
        ]
        if gooding:
            if len(read) > 1:
                raise typer.BadParameter("--gooding takes one session or file")
            found = find_by_gooding(read[0][0])
        else:
            others = [each for tracks in read for each in tracks[1:]]
            found = find_orbit([tracks[0] for tracks in read], prior=prior, others=others)
    outlook = None
    if found.orbit is not None and found.orbit.label != "not observable":
        limits = found.observed.limits or load_config(config).limits
        place, last = found.observed.site, int(found.seen.t_utc_ns[-1])
        outlook = orbit_outlook(found.orbit, place, limits, last, AHEAD_S)
    number = ANALYST_NUMBERS.start if norad is None else norad
    elements = orbit_elements(found, norad_id=number, name=name, cospar=target.cospar or "")
    report = orbit_report(found, outlook, elements.tle)
    for part in found.parts:
        if part.is_used and part.probability is not None and part.probability < _ANOTHER:
            output.print_to_stderr(
                f"rsoconsole: {part.name} is probably of another object: leave it out"
            )
    if out is not None and form is not None:
        words = write_elements(elements, out, form, force=force)
        if str(out) == "-":
            return
        output.print_to_stderr(words)
    names = [path.name for path in paths]
    output.print_answer(json_, report, lambda found: orbit_lines(names, found))


def read_options(
    sigma_arcsec: float,
    site: str | None,
    stations: Path | None,
    target: str | None,
    *,
    is_radians: bool | None,
) -> "ReadOptions":
    """Return the command line's options for reading observations.

    ``sigma_arcsec``: error of directions without one. ``site``: LAT,LON,ELEV. ``stations``: file
    of stations. ``target``: the object to read. ``is_radians``: True for angles in radians.
    Raises BadParameter for a bad site.
    """
    from rsoconsole.library import ReadOptions

    with as_usage_error("", ConfigError):
        place = None if site is None else parse_site(site)
    return ReadOptions(
        sigma_arcsec=sigma_arcsec,
        site=place,
        stations=stations,
        target=target,
        is_radians=is_radians,
    )
