"""Elements written to a file: two lines, or an Orbit Mean-Elements Message."""

import time
from pathlib import Path
from typing import Literal

import typer

from rsoconsole.cli.words import output
from rsoconsole.errors import OrbitError
from rsoconsole.export import write_file
from rsoconsole.orbits.elements import omm
from rsoconsole.pipeline.orbits import FittedElements

Form = Literal["tle", "kvn", "xml", "json"]
_BY_ENDING: dict[str, Form] = {
    ".tle": "tle",
    ".txt": "tle",
    ".kvn": "kvn",
    ".omm": "kvn",
    ".xml": "xml",
    ".json": "json",
}


def form_of(path: Path) -> Form:
    """By the file's ending. Raises BadParameter for one that says nothing."""
    if str(path) == "-":
        return "tle"
    form = _BY_ENDING.get(path.suffix.lower())
    if form is None:
        raise typer.BadParameter(
            f"{path}: end it in .tle, or .kvn, .xml or .json for an OMM", param_hint="--out"
        )
    return form


def write_elements(elements: FittedElements, path: Path, form: Form, *, force: bool) -> str:
    """Write them; what was done, in words.

    Raises OrbitError where there are none, ExportError where the file cannot be written.
    """
    if elements.mean is None:
        raise OrbitError(f"no elements to write: {elements.reason}")
    if form == "tle":
        if elements.tle is None:
            raise OrbitError(elements.reason)
        text = "\n".join((elements.mean.name, *elements.tle)) + "\n"
    else:
        text = omm(elements.mean, created_utc_ns=time.time_ns(), form=form)
    if str(path) == "-":
        output.hand_over(text if text.endswith("\n") else f"{text}\n")
        return ""
    write_file(path, text.encode("utf-8"), is_forced=force)
    return f"wrote {path}"
