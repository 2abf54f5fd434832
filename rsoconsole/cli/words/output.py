"""Printing: JSON objects or words for people on stdout, reports on stderr.

All that the verbs print passes through this module: text from sessions, INDI servers, headers,
element files and file names is cleaned, so that it cannot reach the terminal as a control
sequence. JSON.md beside this file describes the keys of the JSON.
"""

import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import typer

from rsoconsole.control import SCHEMA, one_line, to_printable
from rsoconsole.words import utc_ns_to_iso

Answer = TypeVar("Answer")
WITH_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "ra": "ra_icrs_deg",
        "dec": "dec_icrs_deg",
        "alt": "alt_deg",
        "az": "az_deg",
        "mount_ra": "mount_ra_icrs_deg",
        "mount_dec": "mount_dec_icrs_deg",
        "x": "x_px",
        "y": "y_px",
        "x_a": "x_a_px",
        "y_a": "y_a_px",
        "x_b": "x_b_px",
        "y_b": "y_b_px",
        "box": "box_px",
        "length": "length_px",
        "width": "width_px",
        "height": "height_px",
        "bytes": "size_bytes",
    }
)
"""Keys with unit and frame by the older key without them; the JSON has both."""


def emit_json(found: Any, **more: Any) -> None:
    """Print a record or mapping as a JSON object in one line; NaN and infinity become null.

    The schema's number, keys that name their units, and ``more`` are added.
    """
    whole = {"schema": SCHEMA, **with_unit_keys(found), **with_unit_keys(more)}
    typer.echo(json.dumps(_finite(whole), allow_nan=False))


def print_answer(
    json_: bool, found: Answer, lines: Callable[[Answer], str | Iterable[str]], **more: Any
) -> None:
    """Print a verb's answer: as JSON, or as the lines for people that ``lines`` returns.

    ``more``: further keys of the JSON.
    """
    if json_:
        emit_json(found, **more)
        return
    words = lines(found)
    say(*((words,) if isinstance(words, str) else words))


def say(*lines: str) -> None:
    """Print lines for a person on stdout; a line break inside one of them becomes a space."""
    for line in lines:
        typer.echo(one_line(line))


def print_to_stderr(*lines: str) -> None:
    """Print lines for a person on stderr; a line break inside one of them becomes a space."""
    for line in lines:
        typer.echo(one_line(line), err=True)


def exit_if(failed: int, words: str = "") -> None:
    """Exit with status 1 if ``failed`` is not 0, after printing ``words`` on stderr."""
    if failed and words:
        print_to_stderr(f"rsoconsole: {words}")
    if failed:
        raise typer.Exit(1)


def report_fault(json_: bool, words: str, **of: Any) -> None:
    """Report why an input failed: on stderr, and with ``json_`` as JSON on stdout too.

    ``of``: keys and values that name the input in the JSON.
    """
    if json_:
        emit_json({**of, "error": words})
    print_to_stderr(f"rsoconsole: {words}")


def emit_text(text: str) -> None:
    """Print a document on stdout: unchanged to a file or a pipe, cleaned for a terminal."""
    typer.echo(to_printable(text) if sys.stdout.isatty() else text, nl=False)


def with_unit_keys(value: Any) -> Any:
    """Convert records to mappings, at every depth, and add the keys of ``WITH_UNITS``.

    A record's keys are its fields and properties; a time ``NAME_utc_ns`` gets a text ``NAME_utc``
    too.
    """
    if isinstance(value, list | tuple):
        return [with_unit_keys(item) for item in value]
    is_record = is_dataclass(value)
    if is_record:
        value = {name: getattr(value, name) for name in _names_of(value)}
    if not isinstance(value, Mapping):
        return value
    result: dict[str, Any] = {}
    for key, item in value.items():
        result[str(key)] = with_unit_keys(item)
        if key in WITH_UNITS:
            result.setdefault(WITH_UNITS[key], result[key])
        if is_record and key.endswith("_utc_ns"):
            result[key.removesuffix("_ns")] = None if item is None else utc_ns_to_iso(item)
    return result


def _names_of(record: Any) -> list[str]:
    members = {name: each for kind in type(record).__mro__ for name, each in vars(kind).items()}
    return [
        *(each.name for each in fields(record)),
        *(name for name, each in members.items() if isinstance(each, property) and name[0] != "_"),
    ]


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path | date):
        return str(value)
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
