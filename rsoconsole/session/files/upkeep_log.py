"""Notes on a session's upkeep after its night: the files ``upkeep.jsonl`` and ``KEEP``.

The database belongs to the night, and upkeep does not write to it. A program that repairs, prunes
or archives a session adds a line to ``upkeep.jsonl``: a JSON object with ``t_utc``, ``verb`` and
what was done. A file named ``KEEP`` forbids to prune the session; its text says why.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError, parse_json, sync_folder, system_errors_as, write_durably
from rsoconsole.words import utc_ns_to_iso

UPKEEP = "upkeep.jsonl"
KEEP = "KEEP"

Note = Mapping[str, Any]


def read_notes(folder: Path) -> list[Note]:
    """Read all readable notes, the oldest first; [] where there is no file.

    Raises SessionError when the file is there and cannot be read.
    """
    with system_errors_as(SessionError, f"{folder / UPKEEP} cannot be read: "):
        try:
            return parse_notes((folder / UPKEEP).read_bytes())
        except FileNotFoundError:
            return []


def parse_notes(content: bytes) -> list[Note]:
    """Parse the content of ``upkeep.jsonl``; lines that are no notes are skipped."""
    notes: list[Note] = []
    for line in content.decode("utf-8", errors="replace").splitlines():
        try:
            note = parse_json(line)
        except ValueError:
            continue
        if isinstance(note, dict):
            notes.append(note)
    return notes


def add_note(folder: Path, verb: str, t_utc_ns: int, details: Mapping[str, Any]) -> None:
    """Add a note to ``upkeep.jsonl``; it is on the disk on return.

    The file is replaced as a whole. ``details``: further members of the line. Raises OSError.
    """
    note = {"t_utc": utc_ns_to_iso(t_utc_ns), "verb": verb, **details}
    path = folder / UPKEEP
    before = path.read_bytes() if path.exists() else b""
    if before and not before.endswith(b"\n"):
        before += b"\n"
    write_durably(path, before + json.dumps(note).encode() + b"\n")


def pruning_times(notes: Iterable[Note]) -> dict[str, str]:
    """Return when each pruned file was removed (ISO 8601 UTC), by its path in the session."""
    return {
        str(path): str(note.get("t_utc"))
        for note in notes
        if note.get("verb") == "prune" and isinstance(note.get("files"), list)
        for path in note["files"]
    }


def is_prune_protected(folder: Path) -> bool:
    """True where the session is marked as never to be pruned."""
    return (folder / KEEP).exists()


def protect_from_pruning(folder: Path, why: str) -> None:
    """Mark the session as never to be pruned, with the reason ``why``. Raises SessionError."""
    with system_errors_as(SessionError, f"{folder} cannot be marked: "):
        write_durably(folder / KEEP, (why.strip() + "\n").encode() if why.strip() else b"")


def allow_pruning(folder: Path) -> None:
    """Remove the mark that forbids to prune the session. Raises SessionError."""
    with system_errors_as(SessionError, f"{folder} cannot be released: "):
        (folder / KEEP).unlink(missing_ok=True)
        sync_folder(folder)
