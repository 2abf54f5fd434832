"""The verb figures: a session's figures for print."""

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from rsoconsole.cli.words import output
from rsoconsole.cli.words.options import JsonOption, SessionArgument

FigureFormat: TypeAlias = Literal["png", "svg", "pdf"]


def figures(
    session: SessionArgument,
    *,
    out: Annotated[
        Path | None, typer.Option(help="Where to write; default: SESSION/branches/figures.")
    ] = None,
    format_: Annotated[FigureFormat, typer.Option("--format", help="Kind of file.")] = "png",
    truth: Annotated[
        Path | None,
        typer.Option(help="A simulation's truth: adds the errors against what really was."),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Draw confidence, track, residuals and NIS of a session, as the paper does.

    Measured red squares, updated blue triangles, predicted green circles, 3-sigma bounds dashed;
    frames in which the object was missed are shaded. Existing figures are replaced.
    Example: rsoconsole figures ~/.local/share/rsoconsole/sessions/NIGHT --format pdf
    """
    from rsoconsole.library import write_figures

    folder = session / "branches" / "figures" if out is None else out
    for path in write_figures(session, folder, truth=truth, file_format=format_):
        output.emit_json({"figure": str(path)}) if json_ else output.say(str(path))
