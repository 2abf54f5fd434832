"""Options that several verbs share, and conversion of their values."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.base import ConfigError, OrbitError
from rsoconsole.cli.words import completion, output
from rsoconsole.config import Graphics, SiteConfig
from rsoconsole.control import OVERRIDE_HELP
from rsoconsole.records import Site

JsonOption = Annotated[bool, typer.Option("--json", help="Print only JSON on stdout.")]
SocketOption = Annotated[
    Path | None, typer.Option("--socket", help="Ask the engine that listens here.")
]
SessionOption = Annotated[
    Path | None, typer.Option(help="Session folder, new or empty. Default: in your data folder.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="Configuration file (see 'config show').")
]
SessionArgument = Annotated[
    Path,
    typer.Argument(
        metavar="SESSION",
        help="A session's folder, or a branch's.",
        autocompletion=completion.sessions,
    ),
]
SessionsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="SESSION...",
        help="Folders of recorded sessions.",
        autocompletion=completion.sessions,
    ),
]
TleOption = Annotated[
    list[Path] | None,
    typer.Option(
        help="Element sets: TLE, or OMM as XML, JSON, CSV or KVN, - on standard input; may be"
        " repeated."
    ),
]
WriteOption = Annotated[
    bool, typer.Option("--write", help="Write the result into the configuration.")
]
TauOption = Annotated[float | None, typer.Option(help="Confidence a detection must exceed.")]
PresetOption = Annotated[
    str | None,
    typer.Option(
        help="Filter preset: adaptive, tuned or paper.", autocompletion=completion.presets
    ),
]
GraphicsOption = Annotated[
    Graphics | None,
    typer.Option(help="How pictures are drawn, if not as configured (console.graphics)."),
]
OverrideOption = Annotated[
    list[str] | None,
    typer.Option("--override", help=OVERRIDE_HELP, autocompletion=completion.checks),
]


def parse_site(text: str) -> Site:
    """Parse a site written LAT,LON,ELEV: degrees north, degrees east, metres (default 0).

    Raises ConfigError for anything else.
    """
    try:
        latitude_deg, longitude_deg, *height_m = map(float, text.split(","))
        (elevation_m,) = height_m or (0.0,)
        if abs(longitude_deg) > 360.0:
            raise ValueError(longitude_deg)
        if longitude_deg < -180.0:
            longitude_deg += 360.0
        place = SiteConfig(
            latitude_deg=latitude_deg, longitude_deg=longitude_deg, elevation_m=elevation_m
        )
    except ValueError as error:
        raise ConfigError(
            f"--site {text!r}: write LAT,LON,ELEV, like 52.2,21.0,110; latitude is -90 to 90,"
            " longitude -360 to 360, elevation -430 to 9000 m"
        ) from error
    return place.to_site()


def number_or_text(value: str) -> float | str:
    """Return the number that ``value`` is, if it is a finite one; else the text itself."""
    try:
        number = float(value)
    except ValueError:
        return value
    return number if math.isfinite(number) else value


if TYPE_CHECKING:
    from rsoconsole.cli.words.standard_input import InputFiles
    from rsoconsole.orbits import ElementSets


_OPTION = "--tle FILE"


def read_element_sets(files: Sequence[Path], given: "InputFiles | None" = None) -> "ElementSets":
    """Return the element sets of these files; those that cannot be used are said on stderr.

    ``given``: names for people of the files. Raises OrbitError with the remedy where ``files`` is
    empty.
    """
    from rsoconsole.pipeline import NO_ELEMENTS, read_catalogue

    if not files:
        raise OrbitError(NO_ELEMENTS.format(_OPTION))
    sets = read_catalogue(files)
    if given is not None:
        names = [given.name_standard_input(each.source) for each in sets.not_used]
        named = zip(sets.not_used, names, strict=True)
        sets = replace(sets, not_used=tuple(replace(each, source=name) for each, name in named))
    if words := sets.not_used_words:
        output.print_to_stderr(f"rsoconsole: {words}")
    return sets


def session_element_files(path: Path, configured: Sequence[Path]) -> list[Path]:
    """Return the element files with which to identify the tracks of the session ``path``.

    They are the configured ones; for a simulated night, or where none is configured, those with
    which the session was recorded. Raises OrbitError with the remedy where there are none.
    """
    from rsoconsole.pipeline import choose_element_files

    used = choose_element_files(path, configured, _OPTION)
    if used.is_recorded:
        named = ", ".join(map(str, used.files))
        output.print_to_stderr(
            f"rsoconsole: by the elements that the session was recorded with: {named}"
        )
    return list(used.files)
