"""JSON objects on stdout, words for people elsewhere."""

import json
import math
from typing import Any

import typer

from rsoconsole.sky.angles import format_dec, format_ra


def emit_json(value: Any) -> None:
    """One object, one line; NaN and infinity become null."""
    typer.echo(json.dumps(_finite(value), allow_nan=False))


def say(text: str) -> None:
    """A line for a person on stdout."""
    typer.echo(text)


def complain(text: str) -> None:
    """A line for a person on stderr."""
    typer.echo(text, err=True)


def direction_text(ra_deg: float, dec_deg: float) -> str:
    """Sexagesimal RA and Dec."""
    return f"{format_ra(ra_deg)} {format_dec(dec_deg)}"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
