"""What detectors said of frames, one line of JSON a frame and detector, so that work goes on.

A row holds the digest of all that it depends on: settings, the frame's code, the detector's where
it is ours. A row of another digest counts as missing.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.bench.peers.roster import PEERS
from tests.campaign.pairs import Key, Look

_ROOT = Path(__file__).parents[2]
_DRAWING = (
    *(f"models/{name}.py" for name in ("altered", "fields", "frames", "telescopes")),
    *(f"rsoconsole/simulator/{room}/*.py" for room in ("camera", "scene", "sky")),
)
_JUDGING = ("tests/bench/peers/joining.py", "tests/bench/peers/scoring.py")


def digest(peer: str) -> str:
    """Of what this peer's rows depend on."""
    roster = PEERS[peer]
    patterns = (*_DRAWING, *_JUDGING, f"tests/bench/peers/{roster.module}.py", *roster.ours)
    made = hashlib.sha256(json.dumps(dict(roster.settings()), sort_keys=True).encode())
    for path in sorted({path for pattern in patterns for path in _ROOT.glob(pattern)}):
        made.update(path.read_bytes())
    return made.hexdigest()[:12]


def read(path: Path) -> dict[str, dict[Key, Look]]:
    """By peer, those of today's digest."""
    looks: dict[str, dict[Key, Look]] = {}
    wanted = {name: digest(name) for name in PEERS}
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for row in (_row_of(line) for line in lines):
        if row is not None and wanted.get(row["peer"]) == row["digest"]:
            kept = {name: row[name] for name in Look.__slots__}
            look = Look(**(kept | {"false": tuple(row["false"])}))
            key = row["family"], int(row["number"])
            looks.setdefault(row["peer"], {})[key] = look
    return looks


def _row_of(line: str) -> dict[str, Any] | None:
    """None for a line that a crash left unfinished."""
    try:
        row: dict[str, Any] = json.loads(line)
    except ValueError:
        return None
    return row


def end_line(path: Path) -> None:
    """A line that a crash left unfinished must not swallow the next one."""
    if path.exists() and not path.read_bytes().endswith(b"\n"):
        with path.open("ab") as rows:
            rows.write(b"\n")


def append(path: Path, peer: str, made: str, key: Key, look: Look) -> None:
    """One more row, on the disk when this returns."""
    row = {"peer": peer, "family": key[0], "number": key[1], "digest": made} | asdict(look)
    with path.open("a", encoding="utf-8") as rows:
        rows.write(json.dumps(row) + "\n")


def write(path: Path, looks: dict[str, dict[Key, Look]]) -> None:
    """A file of these alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    path.touch()
    for peer, kept in looks.items():
        made = digest(peer)
        for key, look in kept.items():
            append(path, peer, made, key, look)
