"""The verb lightcurve: how bright an object was, and whether it turns."""

from typing import Annotated

import typer

from rsoconsole.base import InputError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import JsonOption, SessionArgument
from rsoconsole.cli.words.usage import as_usage_error


def lightcurve(
    session: SessionArgument,
    *,
    track: Annotated[
        int | None,
        typer.Option(min=1, help="Which track; default: the one of the most streaks."),
    ] = None,
    csv_: Annotated[
        bool,
        typer.Option("--csv", help="Print streaks and steps as CSV instead."),
    ] = False,
    json_: JsonOption = False,
) -> None:
    """Show the light curve of a track: magnitudes, period, glints.

    Each streak gives a magnitude, and where the direction of motion is known its light in steps
    gives changes within an exposure. Frames under different transparency compare.

    A period is claimed where its false-alarm probability is below 1 %, from 20 streaks or steps
    on; half and double are named, for a body with two like sides turns in the double. Slow changes
    (phase angle, range) are no period, and neither are the images that the cadence makes.

    A glint is a short brightening far above the rest.

    Example: rsoconsole lightcurve NIGHT --json
    """
    from rsoconsole.cli.words.light_words import light_csv, light_json, light_lines
    from rsoconsole.library import lightcurve as light_of

    if csv_ and json_:
        raise typer.BadParameter("--csv and --json exclude each other")
    with progress_bar("light curve"), as_usage_error("--track", InputError):
        found = light_of(session, track).found
    name = session.resolve().name
    if csv_:
        output.emit_text(light_csv(found))
        return
    if json_:
        output.emit_json(light_json(name, found))
        return
    output.say(*light_lines(name, found))
