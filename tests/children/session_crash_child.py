"""Writes sessions until it is killed: a process that is prepared once and forks one life a cut.

Orders come by standard input, one JSON line each: ``folder``, ``words`` and ``delay_s``: after how
many words of its own, and how long after the last of them, the life ends; ``words`` null: when it
closes its session. The answer is one JSON line: what the life had been told is on disk when it was
cut. A fork, so that no interpreter's start is paid for; no thread is begun before it.
"""

import json
import os
import signal
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rsoconsole.config import Config
from rsoconsole.records import Event, Frame, Miss, Missed
from rsoconsole.session import SessionWriter, compress_frame
from rsoconsole.session.files.frame_encoding import encode_preview

SAID = struct.Struct("=BQ")
BEGUN, RECORD, FRAME, CLOSING, CLOSED = range(5)
"""The session is begun · so many records, frames with previews are on disk · it is closed."""
T0_UTC_NS = 1_800_000_000_000_000_000
FRAMES_BEFORE_CLOSING = 3
RECORDS_A_FRAME = 8
LONGEST_S = 20.0


def record(seq: int) -> Miss | Event:
    """What stands at this place of the log in every life."""
    if seq % 3:
        return Miss(frame_id=seq, reason=Missed(kind="not solved", detail="cloud " * (seq % 40)))
    return Event(level="info", text=f"line {seq} " + "é" * (seq % 17))


def pixels(frame_id: int) -> np.ndarray:
    """The frame of this number."""
    return np.random.default_rng(frame_id).integers(0, 4095, (64, 64), dtype=np.uint16) << 4


def preview(frame_id: int) -> np.ndarray:
    """The small picture of the frame of this number."""
    return (pixels(frame_id) >> 8).astype(np.uint8)


def live(folder: Path, pipe: int, is_to_close: bool) -> None:
    """Write as fast as the disk takes it, and say what it has taken."""

    def say(what: int, number: int = 0) -> None:
        os.write(pipe, SAID.pack(what, number))

    writer = SessionWriter.create(folder, Config(), {"title": "cut"})
    say(BEGUN)
    seq = frame_id = 0
    while True:
        for _ in range(RECORDS_A_FRAME):
            seq += 1
            assert writer.append(record(seq), T0_UTC_NS + seq) == seq
        if writer.flush():
            say(RECORD, seq)
        frame_id += 1
        writer.save_frame(Frame(frame_id=frame_id, name="", pixels=pixels(frame_id)))
        writer.save_preview(frame_id, preview(frame_id))
        if frame_id % 2:
            assert writer._frames.drain(LONGEST_S)
            assert writer._previews.drain(LONGEST_S)
            if writer.flush():
                say(FRAME, frame_id)
        if is_to_close and frame_id == FRAMES_BEFORE_CLOSING:
            say(CLOSING)
            writer.close()
            say(CLOSED)
            time.sleep(LONGEST_S)


def heard(pipe: int) -> Iterator[tuple[int, int]]:
    """What the life says, one by one, until it is over."""
    while said := os.read(pipe, SAID.size):
        yield SAID.unpack(said)


def cut(folder: Path, words: int | None, delay_s: float) -> dict[str, int]:
    """One life, and what it had been told when it was killed."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            live(folder, writing, words is None)
        finally:
            os._exit(1)
    os.close(writing)
    told = dict.fromkeys((BEGUN, RECORD, FRAME, CLOSING, CLOSED), 0)
    says = heard(reading)
    try:
        for place, (what, number) in enumerate(says):
            told[what] = max(told[what], number)
            if place == words or what == CLOSING:
                break
        time.sleep(delay_s)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    for what, number in says:
        told[what] = max(told[what], number) or int(what == CLOSED)
    os.close(reading)
    return {"records": told[RECORD], "frames": told[FRAME], "closed": told[CLOSED]}


def main() -> None:
    """Prepare, then live and die as told."""
    # What is loaded late is loaded now: a life writes from its first moment.
    compress_frame(Frame(frame_id=1, name="", pixels=pixels(1)))
    encode_preview(preview(1))
    print("ready", flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        told = cut(Path(order["folder"]), order["words"], order["delay_s"])
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
