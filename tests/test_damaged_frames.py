"""Files that lie: each is read or refused in one sentence; none hangs, crashes, fills the memory.

The seeds are printed with what fails. ``python -m tests.test_damaged_frames 10000`` tries more.
"""

import bz2
import gzip
import io
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from rsoconsole.errors import FrameError
from rsoconsole.instruments.fits_structure import structure_fault
from rsoconsole.instruments.frame_decoder import FrameDecoder
from rsoconsole.instruments.frame_files import frame_from_bytes, read_frame

FAULTS = Path(__file__).resolve().parents[2] / "shared" / "faults"
MOST_S = 5.0
MUTATIONS = 500


def _pixels() -> np.ndarray:
    sky = np.random.default_rng(1).normal(800.0, 20.0, (96, 128))
    return np.clip(sky, 0, 65535).astype(np.uint16)


def _fits(*units: fits.hdu.base._BaseHDU) -> bytes:
    file = io.BytesIO()
    fits.HDUList(list(units)).writeto(file)
    return file.getvalue()


def _plain() -> bytes:
    unit = fits.PrimaryHDU(_pixels())
    for key, value in (("EXPTIME", 10.0), ("DATE-OBS", "2023-06-22T04:00:00.5")):
        unit.header[key] = value
    return _fits(unit)


def _packed(kind: str) -> bytes:
    return _fits(fits.PrimaryHDU(), fits.CompImageHDU(_pixels(), compression_type=kind))


def _picture(ending: str) -> bytes:
    return bytes(cv2.imencode(ending, _pixels())[1])


WHOLE: dict[str, bytes] = {
    "plain": _plain(),
    "gzip": gzip.compress(_plain()),
    "bzip2": bz2.compress(_plain()),
    "Rice": _packed("RICE_1"),
    "HCOMPRESS": _packed("HCOMPRESS_1"),
    "gzip tiles": _packed("GZIP_1"),
    "extensions": _fits(fits.PrimaryHDU(), fits.ImageHDU(_pixels()), fits.ImageHDU(_pixels())),
    "PNG": _picture(".png"),
    "TIFF": _picture(".tiff"),
}


def _flipped(content: bytearray, draw: random.Random) -> None:
    for _ in range(draw.randint(1, 40)):
        content[draw.randrange(len(content))] = draw.randrange(256)


def _digits(content: bytearray, draw: random.Random) -> None:
    """Other figures in the header."""
    places = [n for n in range(min(len(content), 8640)) if chr(content[n]) in "0123456789T-"]
    for place in draw.sample(places, min(len(places), draw.randint(1, 6))):
        content[place] = ord(draw.choice("0123456789-TF. E"))


def _cut(content: bytearray, draw: random.Random) -> None:
    del content[draw.randrange(len(content)) :]


def _torn(content: bytearray, draw: random.Random) -> None:
    at = draw.randrange(len(content))
    del content[at : at + draw.randint(1, 4000)]


def _stuffed(content: bytearray, draw: random.Random) -> None:
    at = draw.randrange(len(content))
    content[at:at] = draw.randbytes(draw.randint(1, 4000))


DAMAGES: tuple[Callable[[bytearray, random.Random], None], ...] = (
    _flipped,
    _digits,
    _digits,
    _cut,
    _torn,
    _stuffed,
)


def outcome_of(seed: int) -> tuple[str, float, str]:
    """(read or refused, seconds, what was damaged); raises what is no FrameError."""
    draw = random.Random(seed)
    kind = draw.choice(list(WHOLE))
    content, damage = bytearray(WHOLE[kind]), draw.choice(DAMAGES)
    damage(content, draw)
    began_s, what = time.monotonic(), f"{kind}, {damage.__name__}"
    said = ""
    try:
        frame_from_bytes(bytes(content), 1, "frame.fits")
    except FrameError as error:
        said = str(error)
    assert "\n" not in said
    return "refused" if said else "read", time.monotonic() - began_s, what


@pytest.mark.parametrize("kind", WHOLE)
def test_whole_ones_are_read(kind):
    frame = frame_from_bytes(WHOLE[kind], 1, "frame.fits")
    assert np.array_equal(frame.pixels, _pixels()) or kind == "HCOMPRESS"


@pytest.mark.parametrize("block", range(10))
def test_damaged_ones_are_read_or_refused_in_time(block):
    found: Counter[str] = Counter()
    for seed in range(block * MUTATIONS // 10, (block + 1) * MUTATIONS // 10):
        try:
            word, took_s, what = outcome_of(seed)
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        found[word] += 1
        assert took_s < MOST_S, (seed, what)
    assert found["refused"] > 5
    assert found["read"] > 5


@pytest.mark.skipif(not FAULTS.exists(), reason=f"{FAULTS} is not here")
@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["hang_naxis1", "hang_pcount", "rot_rice", "hcompress_heap"])
def test_those_that_once_hung_or_crashed_are_refused(name):
    began_s = time.monotonic()
    with pytest.raises(FrameError, match=f"{name}.fits is (truncated or )?damaged"):
        read_frame(FAULTS / f"{name}.fits", 1)
    assert time.monotonic() - began_s < 2.0 * MOST_S


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
    monkeypatch.setattr("rsoconsole.instruments.frame_files.MOST_BYTES", 10_000_000)
    with pytest.raises(FrameError, match="unpacks to more than"):
        frame_from_bytes(pack(bytes(20_000_000)), 1, "bomb.fits")


def test_a_decoder_that_was_ended_is_started_afresh():
    decoder = FrameDecoder()
    try:
        for _ in range(2):
            assert decoder.decode(WHOLE["Rice"], "a", None, 1).raw.shape == (96, 128)
            assert decoder._process is not None
            decoder._process.kill()
            decoder._process.wait()
    finally:
        decoder.close()


if __name__ == "__main__":
    tally: Counter[str] = Counter()
    slowest = (0.0, -1)
    for number in range(int(sys.argv[1])):
        word_, took_s_, what_ = outcome_of(number)
        tally[f"{what_}: {word_}"] += 1
        slowest = max(slowest, (took_s_, number))
    for what_, count in sorted(tally.items()):
        print(f"{count:6d}  {what_}")
    print(f"slowest: {slowest[0]:.2f} s, seed {slowest[1]}")
