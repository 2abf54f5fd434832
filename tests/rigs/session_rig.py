"""Closed nights to be spoilt, cut off, packed and pruned."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np

from rsoconsole.records import Frame
from rsoconsole.session import Verification
from tests.nights.made_up_night import add_frames, add_previews, armed, begin

NOW_UTC_NS = 1_900_000_000_000_000_000


def make(folder: Path, frames: int = 4) -> Path:
    """A closed night of some frames with pictures and pixels."""
    writer = begin(folder, is_simulated=True)
    armed(writer)
    add_frames(writer, range(1, frames + 1))
    add_previews(writer, range(1, frames + 1))
    for frame_id in range(1, frames + 1):
        noise = np.random.default_rng(frame_id).integers(0, 4000, (64, 64), dtype=np.uint16)
        writer.save_frame(Frame(frame_id=frame_id, name="", pixels=noise << 4))
        assert writer._frames.drain(10)
    writer.close()
    assert writer.faults == ()
    return folder


def run_sql(folder: Path, *statements: str) -> None:
    """Change a session behind its back."""
    with closing(sqlite3.connect(folder / "session.db")) as connection, connection:
        for statement in statements:
            connection.execute(statement)


def cut_off(folder: Path) -> None:
    """As if its engine, long gone, had not closed it."""
    run_sql(
        folder,
        "UPDATE meta SET value = 'false' WHERE key = 'is_closed'",
        "DELETE FROM meta WHERE key IN ('log_digest', 'writer')",
    )


def flip(path: Path, place: int = -100) -> None:
    """Spoil one byte of a file."""
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)


def damage(found: Verification) -> list[tuple[str, str]]:
    """(place, what) of all that is called damaged."""
    return [(each.place, each.what) for each in found.findings if each.severity == "damage"]
