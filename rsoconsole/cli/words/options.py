"""Options that several verbs have, and values as a shell gives them."""

import math
from pathlib import Path
from typing import Annotated

import typer

from rsoconsole.cli.words import completion
from rsoconsole.config import Graphics
from rsoconsole.control import OVERRIDE_HELP

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


def number_or_text(value: str) -> float | str:
    """A number where that is one that can be worked with, else the text itself."""
    try:
        number = float(value)
    except ValueError:
        return value
    return number if math.isfinite(number) else value
