"""Notes on a session's upkeep after its night, beside it: ``upkeep.jsonl``, and KEEP.

The database is the night's own and is not written for upkeep. Anyone who repairs, prunes or
archives a session adds a line to ``upkeep.jsonl``: a JSON object with ``t_utc``, ``verb`` and what
was done. A file named ``KEEP`` says that nothing of the session may be pruned; its text says why.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError, json_of, sync_folder, system_errors_as, write_durably
from rsoconsole.words import utc_ns_to_iso

UPKEEP = "upkeep.jsonl"
KEEP = "KEEP"

Note = Mapping[str, Any]


def read_notes(folder: Path) -> list[Note]:
    """Read every readable line, the oldest first; empty where nothing was ever done.

    Raises SessionError when the file is there and cannot be read.
    """
    with system_errors_as(SessionError, f"{folder / UPKEEP} cannot be read: "):
        try:
            return parse_notes((folder / UPKEEP).read_bytes())
        except FileNotFoundError:
            return []


def parse_notes(content: bytes) -> list[Note]:
    """Parse the notes in such a file; lines that are none are skipped."""
    notes: list[Note] = []
    for line in content.decode("utf-8", errors="replace").splitlines():
        try:
            note = json_of(line)
        except ValueError:
            continue
        if isinstance(note, dict):
            notes.append(note)
    return notes


def add_note(folder: Path, verb: str, t_utc_ns: int, details: Mapping[str, Any]) -> None:
    """Add a line; the file is replaced as a whole, and is on the disk on return.

    Raises OSError.
    """
    note = {"t_utc": utc_ns_to_iso(t_utc_ns), "verb": verb, **details}
    path = folder / UPKEEP
    before = path.read_bytes() if path.exists() else b""
    if before and not before.endswith(b"\n"):
        before += b"\n"
    write_durably(path, before + json.dumps(note).encode() + b"\n")


def pruned_on(notes: Iterable[Note]) -> dict[str, str]:
    """Instant at which each pruned file was removed, ISO 8601 UTC, by its path in the session's
    folder."""
    return {
        str(path): str(note.get("t_utc"))
        for note in notes
        if note.get("verb") == "prune" and isinstance(note.get("files"), list)
        for path in note["files"]
    }


def is_kept(folder: Path) -> bool:
    """True where nothing of the session may be pruned."""
    return (folder / KEEP).exists()


def keep(folder: Path, why: str) -> None:
    """Mark the session so that nothing of it is ever pruned. Raises SessionError."""
    with system_errors_as(SessionError, f"{folder} cannot be marked: "):
        write_durably(folder / KEEP, (why.strip() + "\n").encode() if why.strip() else b"")


def release(folder: Path) -> None:
    """Remove the mark. Raises SessionError."""
    with system_errors_as(SessionError, f"{folder} cannot be released: "):
        (folder / KEEP).unlink(missing_ok=True)
        sync_folder(folder)
