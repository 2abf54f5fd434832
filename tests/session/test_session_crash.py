"""A cut in the middle of any write leaves a session that opens, verifies and has all it promised.

Power loss is simulated by SIGKILL at random moments of a writer at full speed and of its closing,
by a write-ahead log that ends anywhere, and by one whose end is garbage. That what was promised had
reached the disk, and not only the system's memory, is read from the system calls themselves.
"""

import json
import os
import random
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from rsoconsole.config import Config
from rsoconsole.session import SessionReader, SessionWriter, repair_session, verify_session
from tests.children.session_crash_child import T0_UTC_NS, pixels, record

ROOT = Path(__file__).parents[2]
CUTS = 200
CUTS_IN_CLOSING = 40
TRUNCATIONS = 200
GARBAGE = 60
FEW = 10
"""Times fewer in the plain tier."""
MOST_WORDS = 6
LONGEST_DELAY_S = 0.03
NOW_UTC_NS = T0_UTC_NS + 10**15


ALL = pytest.param(1, marks=pytest.mark.nightly("many random cuts"))
FEW_IN_PLAIN = pytest.mark.parametrize("share", [FEW, ALL])
HALF_IN_PLAIN = pytest.mark.parametrize("share", [2, ALL])


class Lives:
    """Lives and deaths on order."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.children.session_crash_child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
        )
        assert self._line() == "ready"

    def cuts(
        self, folders: Iterable[Path], moments: random.Random, *, most_words: int | None
    ) -> Iterator[tuple[Path, dict[str, int]]]:
        """Each folder with what its writer had been told when it was killed.

        ``most_words``: at most so many acknowledgements before a random delay begins; None: the
        delay begins with the closing. The next life is lived while the last one is looked at.
        """
        before: Path | None = None
        for folder in folders:
            told = None if before is None else json.loads(self._line())
            self._order(folder, moments, most_words)
            if before is not None and told is not None:
                yield before, told
            before = folder
        assert before is not None
        yield before, json.loads(self._line())

    def _order(self, folder: Path, moments: random.Random, most_words: int | None) -> None:
        assert self._process.stdin is not None
        words = None if most_words is None else moments.randint(0, most_words)
        delay_s = moments.uniform(0.0, LONGEST_DELAY_S)
        order = {"folder": str(folder), "words": words, "delay_s": delay_s}
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def end(self) -> None:
        """No more lives."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(20)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


@pytest.fixture(scope="module")
def lives() -> Iterator[Lives]:
    made = Lives()
    yield made
    made.end()


def check_what_was_promised(folder: Path, told: dict[str, int]) -> int:
    """Every acknowledged record and frame is there, value for value; returns the records."""
    reader = SessionReader(folder)
    found = list(reader.records())
    assert len(found) >= told["records"]
    assert found == [(n, T0_UTC_NS + n, record(n)) for n in range(1, len(found) + 1)]
    for frame_id in range(1, told["frames"] + 1):
        path = reader.frame_path(frame_id)
        assert path is not None
        assert reader.preview_path(frame_id) is not None
    if told["frames"]:
        with fits.open(reader.frame_path(told["frames"])) as hdus:
            assert np.array_equal(hdus[1].data, pixels(told["frames"]))
    return len(found)


def check_a_cut(folder: Path, told: dict[str, int]) -> str:
    """It opens, verifies, is repaired, and says the same afterwards; returns how it was found."""
    records = check_what_was_promised(folder, told)
    found = verify_session(folder)
    assert found.is_sound, found.findings
    assert found.records == records
    assert found.state == "closed" or not told["closed"]
    repaired = repair_session(folder, NOW_UTC_NS)
    assert repaired.recovered is None
    assert repaired.left == {}
    assert check_what_was_promised(folder, told) == records
    whole = verify_session(folder)
    assert (whole.state, whole.digest, whole.findings) == ("closed", "confirmed", [])
    if records % 5 == 0:
        assert not repair_session(folder, NOW_UTC_NS).did_anything
    return found.state


@pytest.mark.slow("kills a writer twenty times")
@FEW_IN_PLAIN
def test_cuts_lose_nothing_that_was_acknowledged(lives: Lives, tmp_path: Path, share: int) -> None:
    cuts = CUTS // share
    folders = [tmp_path / str(number) for number in range(cuts)]
    records = frames = 0
    for folder, told in lives.cuts(folders, random.Random(1), most_words=MOST_WORDS):
        assert check_a_cut(folder, told) == "cut off"
        records, frames = records + told["records"], frames + told["frames"]
        shutil.rmtree(folder)
    # Had the lives been too short to write, nothing would have been tried.
    assert records > 10 * cuts
    assert frames > cuts // 2


@HALF_IN_PLAIN
def test_a_cut_while_the_session_is_closed_loses_nothing_either(
    lives: Lives, tmp_path: Path, share: int
) -> None:
    folders = [tmp_path / str(number) for number in range(CUTS_IN_CLOSING // share)]
    states = set()
    for folder, told in lives.cuts(folders, random.Random(2), most_words=None):
        states.add(check_a_cut(folder, told))
        shutil.rmtree(folder)
    assert states == {"cut off", "closed"}


class Written:
    """A live session's folder as it lay on the disk at one moment, and what was promised when."""

    def __init__(self, folder: Path) -> None:
        """Some records go into the database, the others stay in the write-ahead log."""
        self.folder = folder / "as it lay"
        live = folder / "live"
        wal = live / "session.db-wal"
        writer = SessionWriter.create(live, Config(), {"title": "cut"})
        self._append(writer, 1, 150)
        with closing(sqlite3.connect(live / "session.db")) as connection:
            ((busy, *_),) = connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            assert busy == 0
        self.promises: list[tuple[int, int]] = [(0, 150)]
        """(bytes of the write-ahead log, records promised by then)."""
        for first in range(151, 400, 5):
            self._append(writer, first, first + 4)
            self.promises.append((wal.stat().st_size, first + 4))
        shutil.copytree(live, self.folder)
        self.wal = (self.folder / "session.db-wal").read_bytes()
        writer.close()
        assert len(self.wal) == self.promises[-1][0], "SQLite folded its log in between"

    def with_wal(self, folder: Path, wal: bytes) -> Path:
        """The same session with another write-ahead log."""
        shutil.copytree(self.folder, folder, ignore=shutil.ignore_patterns("*-shm"))
        (folder / "session.db-wal").write_bytes(wal)
        return folder

    def promised_within(self, size: int) -> int:
        """Records that were promised when the log had at most so many bytes."""
        return max(records for wal_bytes, records in self.promises if wal_bytes <= size)

    @staticmethod
    def _append(writer: SessionWriter, first: int, last: int) -> None:
        for seq in range(first, last + 1):
            assert writer.append(record(seq), T0_UTC_NS + seq) == seq
        assert writer.flush()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return Written(tmp_path_factory.mktemp("written"))


def check_prefix(folder: Path, records: int) -> None:
    """It holds exactly the first so many records, sound, and so it does when it was repaired."""
    expected = [(n, T0_UTC_NS + n, record(n)) for n in range(1, records + 1)]
    assert list(SessionReader(folder).records()) == expected
    found = verify_session(folder)
    assert found.is_sound, found.findings


@FEW_IN_PLAIN
def test_a_write_ahead_log_cut_anywhere_leaves_what_was_promised_before(
    written: Written, tmp_path: Path, share: int
) -> None:
    offsets = random.Random(3).sample(range(len(written.wal) + 1), TRUNCATIONS // share)
    # The seams too: at them a promise is just kept or just not.
    seams = [size + step for size, _ in written.promises[1:8] for step in (-1, 0, 1)]
    for offset in (0, *seams, *offsets, len(written.wal)):
        folder = written.with_wal(tmp_path / "cut", written.wal[:offset])
        check_prefix(folder, written.promised_within(offset))
        shutil.rmtree(folder)


@FEW_IN_PLAIN
def test_garbage_at_the_end_of_the_write_ahead_log_is_no_record(
    written: Written, tmp_path: Path, share: int
) -> None:
    chance = random.Random(4)
    for offset in chance.sample(range(len(written.wal) + 1), GARBAGE // share):
        garbage = chance.randbytes(chance.choice((1, 100, 4096, 30_000)))
        if written.wal[offset : offset + 1] == garbage[:1]:
            continue  # one byte in 256 is by chance what it should be
        wal = written.wal[:offset] + garbage
        if chance.random() < 0.5:
            wal += written.wal[len(wal) :]
        folder = written.with_wal(tmp_path / "cut", wal)
        check_prefix(folder, written.promised_within(offset))
        shutil.rmtree(folder)


def test_what_a_cut_log_has_left_is_repaired_once_and_stays_the_same(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It was written by this very process, which lives.
    monkeypatch.setattr("rsoconsole.session.upkeep.repair.is_being_written", lambda _about: False)
    half = len(written.wal) // 2
    folder = written.with_wal(tmp_path / "cut", written.wal[:half] + b"garbage")
    assert repair_session(folder, NOW_UTC_NS).folded
    check_prefix(folder, written.promised_within(half))
    assert verify_session(folder).digest == "confirmed"
    assert not (folder / "session.db-wal").exists()


STRACED = """
import sys, os
from pathlib import Path
import numpy as np
from rsoconsole.config import Config
from rsoconsole.records import Missed
from rsoconsole.records import Miss
from rsoconsole.records import Frame
from rsoconsole.session import SessionWriter

def say(text):
    os.write(2, f"SAID {text}\\n".encode())

folder = Path(sys.argv[1])
writer = SessionWriter.create(folder, Config(), {})
say("begun")
writer.append(Miss(frame_id=1, reason=Missed(kind="not solved", detail="cloud")), 1)
assert writer.flush()
say("flushed")
writer.save_frame(Frame(frame_id=1, name="", pixels=np.ones((64, 64), np.uint16)))
assert writer._frames.drain(10) and writer.flush()
say("frame")
writer.close()
say("closed")
"""


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_what_is_promised_has_reached_the_disk_before_it_is_said(tmp_path: Path) -> None:
    trace, night = tmp_path / "trace", str(tmp_path / "night")
    calls = "trace=fsync,fdatasync,write,rename,pwrite64,renameat,renameat2"
    subprocess.run(
        [
            *("strace", "-f", "-y", "-o", str(trace), "-e", calls),
            *(sys.executable, "-c", STRACED, str(tmp_path / "night")),
        ],
        check=True,
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    synced: dict[str, list[str]] = {}
    unsynced: set[str] = set()
    since: list[str] = []
    for line in trace.read_text().splitlines():
        said = re.search(r'"SAID (\w+)', line)
        if said:
            synced[said[1]], since = since, []
            # A promise while something written still waits for the disk would be none.
            assert not {path for path in unsynced if path.startswith(night)}, line
        written_to = re.search(r"p?write(?:64)?\(\d+<([^>]+)>", line)
        if written_to and not written_to[1].endswith("-shm"):
            unsynced.add(written_to[1])
        sync = re.search(r"f(?:data)?sync\(\d+<([^>]+)>\)\s+= 0", line)
        if sync:
            since.append(Path(sync[1]).name)
            unsynced.discard(sync[1])
    assert {"night", "config.toml.part", tmp_path.name} <= set(synced["begun"])
    assert "session.db-wal" in synced["flushed"]
    frame = synced["frame"]
    # The file, then its name, and only then the row that speaks of it.
    assert (
        frame.index("000001.fits.fz.part") < frame.index("frames") < frame.index("session.db-wal")
    )
    assert "session.db" in synced["closed"]
