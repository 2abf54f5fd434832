"""Files that lie: each is read or refused in one sentence; none hangs, crashes, fills the memory.

The seeds are printed with what fails.
"""

import bz2
import gzip
import os
import signal
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import FrameError
from rsoconsole.instruments import frame_from_bytes, read_frame
from rsoconsole.instruments.frames._decoder_child import DecodeRequest
from rsoconsole.instruments.frames._fits_by_astropy import structure_fault
from rsoconsole.instruments.frames._frame_decoder import FrameDecoder
from tests.drawn.damaged_frames import WHOLE, damaged, holds, pixels, process, table, write

FAULTS = Path(__file__).resolve().parents[3] / "shared" / "faults"
MAX_S = 5.0
MUTATIONS = 500
RUN, RUN_BY_NIGHT = 40, 200
"""Of them through a run of the program."""


def outcome_of(seed: int) -> tuple[str, float, str]:
    """(read or refused, seconds, what was damaged); raises what is no FrameError."""
    content, what = damaged(seed)
    began_s, said = time.monotonic(), ""
    try:
        frame_from_bytes(content, 1, "frame.fits")
    except FrameError as error:
        said = str(error)
    assert "\n" not in said
    return "refused" if said else "read", time.monotonic() - began_s, what


@pytest.mark.parametrize("kind", WHOLE)
def test_whole_ones_are_read(kind):
    frame = frame_from_bytes(WHOLE[kind], 1, "frame.fits")
    assert np.array_equal(frame.pixels, pixels()) or kind == "HCOMPRESS"


@pytest.mark.parametrize("block", range(10))
def test_damaged_ones_are_read_or_refused_in_time(block):
    found: Counter[str] = Counter()
    for seed in range(block * MUTATIONS // 10, (block + 1) * MUTATIONS // 10):
        try:
            word, took_s, what = outcome_of(seed)
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        found[word] += 1
        assert took_s < MAX_S, (seed, what)
    assert found["refused"] > 5
    assert found["read"] > 5


@pytest.mark.skipif(not FAULTS.exists(), reason=f"{FAULTS} is not here")
@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["hang_naxis1", "hang_pcount", "rot_rice", "hcompress_heap"])
def test_those_that_once_hung_or_crashed_are_refused(name):
    began_s = time.monotonic()
    with pytest.raises(FrameError, match=f"{name}.fits is (truncated or )?damaged"):
        read_frame(FAULTS / f"{name}.fits", 1)
    assert time.monotonic() - began_s < 2.0 * MAX_S


@pytest.mark.parametrize(
    ("keyword", "value"),
    [
        ("NAXIS1", -2147483648),
        ("NAXIS2", 10**18),
        ("NAXIS", 1000),
        ("PCOUNT", -1),
        ("BITPIX", 17),
        ("GCOUNT", 10**30),
    ],
)
def test_a_length_that_cannot_be_is_named(keyword, value):
    content = bytearray(WHOLE["plain"])
    at = content.find(f"{keyword:<8}=".encode())
    card = f"{keyword:<8}= {value:>20}".encode()[:80].ljust(80)
    if at < 0:
        at = content.find(b"EXTEND  ")
    content[at : at + 80] = card
    assert str(structure_fault(bytes(content)) or "").startswith(f"{keyword} = ")


def test_what_is_no_file_and_what_is_none_for_a_frame_is_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe.fits"
    os.mkfifo(pipe)
    huge = tmp_path / "huge.fits"
    with huge.open("wb") as file:
        file.truncate(10**12)
    for path, words in (
        (pipe, "no regular file"),
        (Path("/dev/zero"), "no regular file"),
        (huge, "1000.0 GB"),
    ):
        with pytest.raises(FrameError, match=words):
            read_frame(path, 1)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_a_bomb_is_refused_before_it_fills_the_memory(pack, monkeypatch):
    monkeypatch.setattr("rsoconsole.instruments.frames.frame_files.MAX_BYTES", 10_000_000)
    with pytest.raises(FrameError, match="unpacks to more than"):
        frame_from_bytes(pack(bytes(20_000_000)), 1, "bomb.fits")


def test_a_decoder_that_was_ended_is_started_again():
    decoder = FrameDecoder()
    try:
        for _ in range(2):
            assert decoder.decode(DecodeRequest(name="a"), WHOLE["Rice"]).raw.shape == (96, 128)
            assert decoder._child is not None
            os.kill(decoder._child.pid, signal.SIGKILL)
            decoder._child._process.wait()
    finally:
        decoder.close()


def picture(name):
    return DecodeRequest(name=name, is_picture=True)


def test_a_picture_that_ends_the_decoder_is_one_frames_fault():
    decoder = FrameDecoder()
    try:
        assert np.array_equal(decoder.decode(picture("a"), WHOLE["PNG"]).raw, pixels())
        assert decoder._child is not None
        os.kill(decoder._child.pid, signal.SIGSTOP)
        threading.Timer(0.2, os.kill, (decoder._child.pid, signal.SIGKILL)).start()
        with pytest.raises(FrameError, match="it crashed the decoder"):
            decoder.decode(picture("b.tiff"), WHOLE["TIFF"])
        assert np.array_equal(decoder.decode(picture("c"), WHOLE["TIFF"]).raw, pixels())
    finally:
        decoder.close()


@pytest.mark.slow("runs the program over damaged frames")
@pytest.mark.parametrize(
    "count", [RUN, pytest.param(RUN_BY_NIGHT, marks=pytest.mark.nightly("many damaged frames"))]
)
def test_a_run_over_damaged_frames_gives_each_one_line_and_goes_on(tmp_path, count):
    """Through the program itself; the campaign: ``python -m tests.drawn.damaged_frames 10000``."""
    (tmp_path / "frames").mkdir()
    damages = write(range(count), tmp_path / "frames")
    (tmp_path / "frames" / "whole.fits").write_bytes(WHOLE["plain"])
    damages["whole.fits"] = "none"
    found = process([tmp_path / "frames" / name for name in damages], tmp_path)
    assert holds(found, damages), table(found, damages)
    assert found.outcomes["whole.fits"] == "not solved"
    refused = [name for name, outcome in found.outcomes.items() if outcome == "refused"]
    assert found.status == 1
    complaints = [line for line in found.said if line.startswith("rsoconsole: ")]
    assert found.said == complaints
    assert all(sum(name in line for line in complaints) == 1 for name in refused)
