"""The likely cause of a hint that the stars contradict, and the hint that it should have been."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.instruments import frame_from_array
from rsoconsole.pipeline.frame.hints import (
    header_hint,
    hint_with_overrides,
    likely_hints,
    wrong_hints,
)
from rsoconsole.records import Frame, Solution, Wcs
from rsoconsole.words import ALIGN

CONFIG = Config()
RIGHT = {
    "RA": 313.41,
    "DEC": -4.67,
    "FOCALLEN": 620.0,
    "XPIXSZ": 15.2,
    "XBINNING": 4,
    "YBINNING": 4,
}
PIXELS = np.zeros((768, 960), np.uint16)
RA_DEG, DEC_DEG, SCALE = 313.389, -4.764, 5.0566
SOLVED = Solution(
    frame_id=1,
    wcs=Wcs(
        crval_ra_deg=RA_DEG,
        crval_dec_deg=DEC_DEG,
        crpix_x_px=479.5,
        crpix_y_px=383.5,
        cd=(-SCALE / 3600, 0.0, 0.0, SCALE / 3600),
    ),
    ra_icrs_deg=RA_DEG,
    dec_icrs_deg=DEC_DEG,
    scale_arcsec_px=SCALE,
    rotation_deg=0.0,
    is_flipped=False,
    matched=58,
    rms_arcsec=0.9,
    path="full",
    ms=1.0,
)


def frame_with(**cards: Any) -> Frame:
    """A frame with some cards changed; those that are None are left out."""
    header = {key: value for key, value in (RIGHT | cards).items() if value is not None}
    return frame_from_array(PIXELS, 1, "a", header=header)


def words_of(frame: Frame) -> dict[str, str]:
    wrong = wrong_hints(header_hint(frame, CONFIG), SOLVED, frame, CONFIG)
    return {each.hint: each.words.partition("; ")[2] for each in wrong}


def test_right_cards_are_not_complained_of():
    assert words_of(frame_with()) == {}


@pytest.mark.parametrize(
    ("cards", "cause"),
    [
        ({"XPIXSZ": 3.8}, "XPIXSZ 3.8 um is the size before binning by 4: after it it is 15.2 um"),
        ({"XPIXSZ": "3,8"}, "XPIXSZ 3.8 um is the size before binning by 4"),
        ({"XPIXSZ": 7.6, "XBINNING": 2}, "XPIXSZ 7.6 um is the size before binning by 2"),
        (
            {"XPIXSZ": 3.8, "XBINNING": None, "YBINNING": None, "CCDSUM": "4 4"},
            "XPIXSZ 3.8 um is the size before binning by 4",
        ),
        ({"XPIXSZ": 60.8}, "has the binning by 4 in it once too often"),
        ({"XPIXSZ": None, "PIXSIZE1": 15.2}, "PIXSIZE1 15.2 um has the binning by 4 in it once"),
    ],
)
def test_a_size_of_pixels_without_or_with_their_binning_leaves_the_focal_length(cards, cause):
    frame = frame_with(**cards)
    words = words_of(frame)["scale"]
    assert cause in words
    assert "FOCALLEN 620 mm is right" in words
    assert "should be 155" not in words
    corrected = likely_hints(header_hint(frame, CONFIG), frame, CONFIG)
    scales = [hint.scale_arcsec_px for hint in corrected]
    assert any(low < SCALE < high for low, high in scales)


@pytest.mark.parametrize(
    ("cards", "cause"),
    [
        ({"FOCALLEN": 62.0}, "FOCALLEN 62 is in cm: it should be 620 mm"),
        ({"FOCALLEN": 24.4}, "FOCALLEN 24.4 is in inches: it should be 620 mm"),
        ({"FOCALLEN": 100.0, "APTDIA": 100.0}, "FOCALLEN 100 mm is the aperture (APTDIA)"),
        ({"FOCALLEN": 984.0}, "as by a 0.63x reducer that is not counted"),
        ({"FOCALLEN": 413.0}, "as by a 1.5x extender that is not counted"),
        ({"FOCALLEN": 700.0}, "FOCALLEN says 700 mm, it should be 620"),
        (
            {"XBINNING": None, "YBINNING": None, "XPIXSZ": 3.8},
            "either the frame is binned by 4, which no XBINNING says, and the pixel's size is that",
        ),
        (
            {"XBINNING": 1, "YBINNING": 1, "XPIXSZ": 3.8},
            "either the frame is binned by 4, although XBINNING says 1",
        ),
        (
            {"XBINNING": 2, "YBINNING": 2, "XPIXSZ": 3.8},
            "either the frame is binned by 4, although XBINNING says 2",
        ),
    ],
)
def test_a_wrong_focal_length_has_its_likely_cause(cards, cause):
    assert cause in words_of(frame_with(**cards))["scale"]


@pytest.mark.parametrize(
    ("cards", "likely"),
    [
        ({"FOCALLEN": 0.62}, "FOCALLEN looks like metres"),
        ({"XPIXSZ": 0.0152}, "XPIXSZ looks like mm"),
        ({"XPIXSZ": 1.52e-5}, "XPIXSZ looks like m, um are wanted"),
    ],
)
def test_an_impossible_scale_has_its_likely_unit(cards, likely):
    notes = frame_with(**cards).header["NOTES"]
    (note,) = (each for each in notes if "arcsec/px: not used" in each)
    assert likely in note


@pytest.mark.parametrize(
    ("cards", "cause"),
    [
        ({"RA": 20.894}, "RA is in hours, a number there is in degrees: 313.410 is right"),
        ({"RA": "20,894"}, "RA is in hours"),
        ({"RA": 0.0, "DEC": 0.0}, "no mount is connected"),
        ({"DEC": 4.67}, "DEC has the wrong sign"),
        ({"RA": 5.46997, "DEC": -0.08151}, "RA and DEC are in radians"),
        (
            {"RA": 10.0, "DEC": 50.0, "OBJCTRA": "20 53 38", "OBJCTDEC": "-04 40 00"},
            "OBJCTRA and OBJCTDEC are right, RA and DEC are not",
        ),
        ({"RA": 0.0, "DEC": 90.0}, "the pole is where a mount believes itself"),
        ({"RA": 100.0, "DEC": 30.0}, ALIGN),
    ],
)
def test_a_wrong_position_has_its_likely_cause(cards, cause):
    words = words_of(frame_with(**cards))["position"]
    assert cause in words
    assert (ALIGN in words) == (cards.get("DEC") in (30.0, 90.0))


def test_a_sexagesimal_position_in_degrees_and_one_exchanged_are_known():
    degrees = frame_with(RA="20:53:38")
    solved = _solved_at(20.894, -4.67)
    (wrong,) = wrong_hints(header_hint(degrees, CONFIG), solved, degrees, CONFIG)
    assert "RA is in degrees, text there is in hours" in wrong.words
    exchanged = frame_with(RA=40.0, DEC=20.0)
    (wrong,) = wrong_hints(
        header_hint(exchanged, CONFIG), _solved_at(20.0, 40.0), exchanged, CONFIG
    )
    assert "RA and DEC are exchanged" in wrong.words


def _solved_at(ra_deg: float, dec_deg: float) -> Solution:
    return replace(SOLVED, ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg)


def test_both_hints_are_corrected_together_and_an_operators_never():
    frame = frame_with(RA=20.894, XPIXSZ=3.8)
    own = header_hint(frame, CONFIG)
    corrected = likely_hints(own, frame, CONFIG)
    assert any(
        hint.scale_arcsec_px[0] < SCALE < hint.scale_arcsec_px[1]
        and hint.ra_icrs_deg == pytest.approx(313.41)
        for hint in corrected
    )
    assert own not in corrected
    given = hint_with_overrides(own, 10.0, 10.0, None, (1.0, 2.0))
    assert likely_hints(given, frame, CONFIG) == ()


def test_right_cards_that_are_not_binned_have_nothing_to_correct():
    plain = frame_with(XBINNING=1, XPIXSZ=15.2)
    assert likely_hints(header_hint(plain, CONFIG), plain, CONFIG) == ()
