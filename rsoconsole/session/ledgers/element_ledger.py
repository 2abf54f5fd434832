"""Ledger of the errors of orbital elements, kept across nights in the user's state folder.

A file of lines (``line_file``). Each line is a row: a track of one night compared with its object's
elements. A later row of the same track replaces the earlier row.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rsoconsole.config import state_dir
from rsoconsole.orbits import ElementErrorRow, StandardMagnitude, standard_magnitude
from rsoconsole.session.log.codec import from_json_value
from rsoconsole.session.log.line_file import Change, LineFile, Lines

FORMAT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementLedger:
    """Rows of the ledger that were not replaced or withdrawn since."""

    rows: tuple[ElementErrorRow, ...] = ()
    unreadable: tuple[int, ...] = ()
    """Numbers, from 1, of the lines of the file that cannot be read."""

    def standard_magnitudes(self) -> dict[int, StandardMagnitude]:
        """Return the median of each object's standard magnitudes over its tracks, by NORAD id."""
        known: dict[int, list[tuple[float, float]]] = {}
        for row in self.rows:
            if row.standard_mag is not None and row.standard_mag_sigma is not None:
                both = (row.standard_mag, row.standard_mag_sigma)
                known.setdefault(row.norad_id, []).append(both)
        found = {n: standard_magnitude(*zip(*each, strict=True)) for n, each in known.items()}
        return {n: each for n, each in found.items() if each is not None}


def element_ledger_path(*, is_simulated: bool = False) -> Path:
    """Return the path of this user's element ledger; simulated nights have another file."""
    return state_dir() / ("elements-simulated.jsonl" if is_simulated else "elements.jsonl")


def read_element_ledger(path: Path) -> ElementLedger:
    """Read the ledger; an empty one where there is no file. Raises SessionError."""
    file = _file(path)
    return _folded(file, file.lines())


def replace_session_rows(
    sessions: Sequence[str], rows: Sequence[ElementErrorRow], path: Path
) -> tuple[ElementLedger, Path | None]:
    """Replace all rows of these sessions by ``rows``; they are on the disk on return.

    Returns (the new ledger, path to which a damaged file was moved or None). Raises SessionError
    where the file cannot be written, and where another writer takes too long.
    """

    def step(before: ElementLedger) -> list[Change]:
        known = {each.key: each for each in before.rows}
        kept = {each.key for each in rows}
        gone = [key for key in known if key[0] in sessions and key not in kept]
        return [
            *({"did": "taken back", "session": key[0], "track": key[1]} for key in gone),
            *({"did": "kept", "row": asdict(row)} for row in rows if known.get(row.key) != row),
        ]

    return _file(path).append_changes(_folded, step)


def _file(path: Path) -> LineFile:
    return LineFile(path=path, called="the ledger of element errors", format=FORMAT)


def _folded(file: LineFile, lines: Lines) -> ElementLedger:
    """Add up the lines. Raises SessionError for a ledger that a later version has written."""
    rows: dict[tuple[str, str], ElementErrorRow] = {}

    def take(said: Mapping[str, Any]) -> None:
        match said["did"]:
            case "kept":
                row = _row(said["row"])
                rows[row.key] = row
            case "taken back":
                rows.pop((str(said["session"]), str(said["track"])), None)
            case _:
                raise ValueError(f"{said['did']!r} is nothing that a ledger says")

    bad = file.parse_lines(lines, take)
    return ElementLedger(
        rows=tuple(sorted(rows.values(), key=lambda each: (each.t_utc_ns, each.key))),
        unreadable=bad,
    )


def _row(said: object) -> ElementErrorRow:
    """Read a row. Raises ValueError, KeyError or TypeError for values unfit for computation."""
    row: ElementErrorRow = from_json_value(ElementErrorRow, said)
    sigmas = (row.sigma_along_s, row.sigma_along_km, row.sigma_across_arcsec, row.sigma_across_km)
    if min(sigmas) <= 0.0:
        raise ValueError("an error of a measurement is above 0")
    return row
