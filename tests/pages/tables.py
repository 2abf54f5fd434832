"""Tables of measurements read back as users do: by csv, json and astropy, no code of ours."""

import csv
import json
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import Table

from rsoconsole.library.formats.rows import COLUMNS, MeasuredRow

_OF_TEXT: Mapping[str, Callable[[str], Any]] = {
    "integer": int,
    "real": float,
    "truth": {"true": True, "false": False}.__getitem__,
    "text": str,
}
_MADE_OF_OTHERS = "t_mid_utc"


def read_csv(path: Path) -> tuple[MeasuredRow, ...]:
    """The measurements of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file, strict=True))
    return tuple(
        _row({c.name: _OF_TEXT[c.type](line[c.name]) if line[c.name] else None for c in COLUMNS})
        for line in lines
    )


def read_jsonl(path: Path) -> tuple[MeasuredRow, ...]:
    """The measurements of a file of JSON lines."""
    lines = path.read_text(encoding="utf-8").split("\n")
    return tuple(_row(json.loads(line)) for line in lines if line)


def read_ecsv(path: Path) -> tuple[MeasuredRow, ...]:
    """The measurements of an ECSV file."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*dubious year")
        table = Table.read(path, format="ascii.ecsv")
    names = [column.name for column in COLUMNS if column.name != _MADE_OF_OTHERS]
    return tuple(
        _row(
            {
                name: None if np.ma.is_masked(each[name]) else np.asarray(each[name]).item()
                for name in names
            }
        )
        for each in table
    )


def _row(values: Mapping[str, Any]) -> MeasuredRow:
    names = [column.name for column in COLUMNS if column.name != _MADE_OF_OTHERS]
    own = {name: values[name] for name in names if name in MeasuredRow.__dataclass_fields__}
    beside = tuple((name, values[name]) for name in names if name not in own)
    return MeasuredRow(**own, beside=beside)
