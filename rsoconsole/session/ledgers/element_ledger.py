"""The ledger of what elements were off, kept across nights in the user's state folder.

A file of lines (``line_file``): each a row, a track of a night against its object's elements. A row
of the same track takes the place of the one before.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, get_args

from rsoconsole.config import state_dir
from rsoconsole.orbits.identification import ElementRow, Regime
from rsoconsole.session.log import LineFile, Lines, frozen, objects_of

FORMAT = 1
_TEXT = ("session", "track", "name", "regime")
_ABOVE_0 = ("sigma_along_s", "sigma_along_km", "sigma_across_arcsec", "sigma_across_km")


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementLedger:
    """What holds."""

    rows: tuple[ElementRow, ...] = ()
    """In order of time."""
    unreadable: tuple[int, ...] = ()
    """Numbers of the lines that cannot be read."""


def element_ledger_path(*, is_simulated: bool = False) -> Path:
    """Where this user's rows lie; simulated nights have a file of their own."""
    return state_dir() / ("elements-simulated.jsonl" if is_simulated else "elements.jsonl")


def read_element_ledger(path: Path) -> ElementLedger:
    """All rows; none where there is no file. Raises SessionError."""
    file = _file(path)
    return _folded(file, file.lines())


def keep_rows(
    sessions: Sequence[str], rows: Sequence[ElementRow], path: Path
) -> tuple[ElementLedger, Path | None]:
    """Put rows in the place of all that there are of these sessions, on the disk when this returns.

    Returns the ledger, and where a damaged file was moved. Raises SessionError where the file
    cannot be written, and where another writer takes too long.
    """
    file = _file(path)

    def step(lines: Lines) -> tuple[Sequence[int], Sequence[Mapping[str, Any]]]:
        before = _folded(file, lines)
        known = {each.key: each for each in before.rows}
        kept = {each.key for each in rows}
        gone = [key for key in known if key[0] in sessions and key not in kept]
        return before.unreadable, [
            *({"did": "taken back", "session": key[0], "track": key[1]} for key in gone),
            *({"did": "kept", "row": asdict(row)} for row in rows if known.get(row.key) != row),
        ]

    lines, aside = file.change(step)
    return _folded(file, lines), aside


def element_damage_words(ledger: ElementLedger, path: Path) -> str:
    """What is wrong with it, and what comes of that; empty for a whole one."""
    return _file(path).damage_words(ledger.unreadable)


def _file(path: Path) -> LineFile:
    return LineFile(path=path, called="the ledger of element errors", format=FORMAT)


def _folded(file: LineFile, lines: Lines) -> ElementLedger:
    """Raises SessionError for a ledger that a later version has written."""
    rows: dict[tuple[str, str], ElementRow] = {}

    def take(said: Mapping[str, Any]) -> None:
        match said["did"]:
            case "begun":
                file.expect_format(said["format"])
            case "kept":
                row = _row(said["row"])
                rows[row.key] = row
            case "taken back":
                rows.pop((str(said["session"]), str(said["track"])), None)
            case _:
                raise ValueError(f"{said['did']!r} is nothing that a ledger says")

    bad = objects_of(lines, take)
    return ElementLedger(
        rows=tuple(sorted(rows.values(), key=lambda each: (each.t_utc_ns, each.key))),
        unreadable=bad,
    )


def _row(said: Mapping[str, Any]) -> ElementRow:
    """Raises ValueError, KeyError or TypeError for what nothing could be computed with."""
    known = {each.name for each in fields(ElementRow)}
    values = {key: frozen(value) for key, value in said.items() if key in known}
    row = ElementRow(**values)
    if row.regime not in get_args(Regime):
        raise ValueError(f"{row.regime!r} is no kind of orbit")
    if not all(isinstance(values[key], str) for key in _TEXT):
        raise TypeError("a name is text")
    numbers = [
        value for key, value in values.items() if key not in (*_TEXT, "along_by", "across_by")
    ]
    if len(row.along_by) != 3 or len(row.across_by) != 3:
        raise ValueError("slopes are by three errors")
    if not all(math.isfinite(each) for each in (*numbers, *row.along_by, *row.across_by)):
        raise ValueError("a value is not a number")
    if min(values[key] for key in _ABOVE_0) <= 0.0:
        raise ValueError("an error of a measurement is above 0")
    return row
