"""FITS headers and images read without astropy: the same as astropy reads, or left to it."""

import io
import warnings

import numpy as np
import pytest
from astropy.io import fits
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.instruments import exposure_time, frame_from_bytes
from rsoconsole.instruments.frames._fits_by_astropy import image_by_astropy
from rsoconsole.instruments.frames.plain_fits import read_plain
from rsoconsole.simulator import fits_bytes

NUMBERS = np.random.default_rng(3).integers(0, 65535, (80, 96), dtype=np.uint16)
VALUES = st.one_of(
    st.booleans(),
    st.integers(-(10**17), 10**17),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=60),
)
KEYWORDS = st.from_regex("[A-Z][A-Z0-9_-]{0,5}X", fullmatch=True)


def written(hdu: fits.PrimaryHDU) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        hdu.writeto(buffer, output_verify="silentfix")
    return buffer.getvalue()


def with_card(card: str) -> bytes:
    """A frame whose header has this card as its last one."""
    content = bytearray(fits_bytes(NUMBERS, {"FILLER": 1}))
    place = content.index(b"FILLER  =")
    content[place : place + 80] = card.ljust(80).encode("latin-1")
    return bytes(content)


@given(st.dictionaries(KEYWORDS, VALUES, max_size=12))
def test_every_header_that_is_read_plainly_is_read_as_astropy_reads_it(cards):
    hdu = fits.PrimaryHDU(NUMBERS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for key, value in cards.items():
            hdu.header[key] = value
    content = written(hdu)
    found = read_plain(content)
    image = image_by_astropy(content, "frame.fits")
    raw, header = image.raw, image.header
    if found is not None:
        assert found[1] == header
        assert [type(value) for value in found[1].values()] == [type(v) for v in header.values()]
        assert np.array_equal(found[0], raw)


@pytest.mark.parametrize(
    "card",
    [
        "AIRMASS =                 1.25 / as it is",
        "AIRMASS =             1.25D+00",
        "AIRMASS =              -.5E-03",
        "AIRMASS = 7",
        "AIRMASS =                   +7 /",
        "AIRMASS = 'it''s / so   '   / a comment",
        "AIRMASS = ''",
        "AIRMASS =                     / no value",
        "AIRMASS =                    F",
        "COMMENT   whatever = this is",
        "HISTORY",
        "",
    ],
)
def test_the_usual_forms_of_a_card_need_no_astropy(card):
    content = with_card(card)
    found = read_plain(content)
    assert found is not None
    assert found[1] == image_by_astropy(content, "frame.fits").header


@pytest.mark.parametrize(
    "card",
    [
        "HIERARCH ESO DET NAME = 'long'",
        "CONTINUE  'the rest of it'",
        "AIRMASS = 'DP1.AXIS: 2.0'",
        "AIRMASS = 'goes on&'",
        "AIRMASS = (1.0, 2.0)",
        "AIRMASS = 1.2.3",
        "AIRMASS = 'never closed",
        "AIRMASS   1.25",
        "airmass = 1.25",
        "AIRMASS = 'M\u00fcnchen'",
        "AIRMASS = 1.5 \t",
    ],
)
def test_what_is_unusual_is_left_to_astropy(card):
    assert read_plain(with_card(card)) is None


@pytest.mark.parametrize(
    "hdus",
    [
        [fits.PrimaryHDU(), fits.ImageHDU(NUMBERS)],
        [fits.PrimaryHDU(), fits.CompImageHDU(NUMBERS)],
        [fits.PrimaryHDU(np.zeros((3, 80, 96), np.uint16))],
    ],
)
def test_an_image_elsewhere_than_in_the_first_unit_is_left_to_astropy(hdus):
    buffer = io.BytesIO()
    fits.HDUList(hdus).writeto(buffer)
    assert read_plain(buffer.getvalue()) is None


@pytest.mark.parametrize("dtype", ["u1", ">i2", "u2", ">i4", ">f4", ">f8"])
def test_pixels_of_every_type_are_those_that_astropy_reads(dtype):
    content = written(fits.PrimaryHDU(NUMBERS.astype(dtype)))
    found = read_plain(content)
    assert found is not None
    image = image_by_astropy(content, "frame.fits")
    raw, header = image.raw, image.header
    assert found[0].dtype == raw.dtype
    assert np.array_equal(found[0], raw)
    assert found[1] == header


def test_a_frame_that_was_cut_short_is_not_read_as_if_it_were_whole():
    content = bytes(fits_bytes(NUMBERS, {}))
    whole = 2880 + NUMBERS.nbytes
    assert read_plain(content[:whole]) is not None
    for length in (whole - 1, 2880, 2879, 80, 0):
        assert read_plain(content[:length]) is None


def test_pixels_are_written_where_there_is_room_for_them():
    room = np.zeros(NUMBERS.shape, np.uint16)
    frame = frame_from_bytes(bytes(fits_bytes(NUMBERS, {})), 1, "a", room=lambda _: room)
    assert frame.pixels is room
    assert np.array_equal(room, NUMBERS)


def test_a_frame_is_never_the_files_own_memory():
    content = bytearray(fits_bytes(NUMBERS, {}))
    frame = frame_from_bytes(memoryview(content), 1, "a")
    content[2880:] = bytes(len(content) - 2880)
    assert np.array_equal(frame.pixels, NUMBERS)


def test_a_true_value_that_is_no_number_is_no_size():
    content = bytes(fits_bytes(NUMBERS, {})).replace(
        b"NAXIS   =                    2", b"NAXIS   =                    T"
    )
    assert read_plain(content) is None


def with_cards(*cards: str) -> bytes:
    content = bytearray(fits_bytes(NUMBERS, {f"FILLER{n}": n for n in range(len(cards))}))
    for n, card in enumerate(cards):
        place = content.index(f"FILLER{n} ".encode())
        content[place : place + 80] = card.ljust(80).encode()
    return bytes(content)


@pytest.mark.parametrize(
    ("card", "seconds"),
    [
        ("EXPTIME =               2000.0 / [ms] exposure time", 2.0),
        ("EXPTIME =                 2000 /[ms]", 2.0),
        ("EXPTIME =                  2.0 / [s]", 2.0),
        ("EXPTIME = '2.0 s'              / [ms] the value's own unit goes first", 2.0),
        ("EXPTIME =2.0", 2.0),
        ("EXPTIME =2000,0 / [ms]", 2.0),
        ("EXPTIME =                  2.0 / [fortnight]", None),
    ],
)
def test_units_in_comments_are_read_with_astropy_and_without(card, seconds):
    content = with_cards(card)
    assert exposure_time(image_by_astropy(content, "a").header).exposure_s == seconds
    frame = frame_from_bytes(content, 1, "a")
    assert frame.exposure_s == seconds
    assert any("its comment has the unit" in note for note in frame.header["NOTES"]) == (
        seconds is None
    )


def test_of_two_cards_of_one_name_the_first_is_used_and_both_are_named():
    content = with_cards("EXPTIME = 10.0", "GAIN    = 5", "EXPTIME = 20.0", "GAIN    = 5")
    frame = frame_from_bytes(content, 1, "a")
    assert frame.exposure_s == 10.0
    assert [note for note in frame.header["NOTES"] if "twice" in note] == [
        "EXPTIME stands twice, as 10.0 and 20.0: the first is used"
    ]
