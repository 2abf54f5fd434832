"""Angles: wraps, distances and how they are written."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole import words
from rsoconsole.sky import angles

ANGLE = st.floats(-1e4, 1e4)
RA = st.floats(0, 359.999)
DEC = st.floats(-90, 90)


@given(angle=ANGLE)
def test_wraps_stay_in_their_interval_and_keep_the_direction(angle):
    low, high = angles.wrap_180(angle), angles.wrap_360(angle)
    assert -180 <= low < 180
    assert 0 <= high < 360
    for wrapped in (low, high):
        turns = (wrapped - angle) / 360
        assert turns == pytest.approx(round(turns), abs=1e-9)
    array = np.array([angle, angle])
    assert angles.wrap_180(array) == pytest.approx([low, low], abs=1e-9)
    assert angles.wrap_360(array) == pytest.approx([high, high], abs=1e-9)


def test_a_tiny_negative_angle_is_zero_and_not_360():
    assert angles.wrap_360(-1e-20) == 0.0
    assert angles.wrap_360(np.array([-1e-20]))[0] == 0.0
    assert angles.wrap_180(180.0) == -180.0


@given(ra_a=RA, dec_a=DEC, ra_b=RA, dec_b=DEC)
def test_separation_and_position_angle_agree_with_erfa(ra_a, dec_a, ra_b, dec_b):
    import erfa

    a, b, c, d = np.radians([ra_a, dec_a, ra_b, dec_b])
    assert angles.separation_deg(ra_a, dec_a, ra_b, dec_b) == pytest.approx(
        np.degrees(erfa.seps(a, b, c, d)), abs=1e-9
    )
    if 0.01 < angles.separation_deg(ra_a, dec_a, ra_b, dec_b) < 179.9 and abs(dec_a) < 89.9:
        difference = angles.position_angle_deg(ra_a, dec_a, ra_b, dec_b) - np.degrees(
            erfa.pas(a, b, c, d)
        )
        assert angles.wrap_180(float(difference)) == pytest.approx(0, abs=1e-7)


def test_separation_keeps_a_milliarcsecond_across_ra_zero():
    milliarcsec = 1e-3 / 3600
    separation = angles.separation_deg(360 - milliarcsec / 2, 0.0, milliarcsec / 2, 0.0)
    assert separation == pytest.approx(milliarcsec, rel=1e-6)


def test_separation_takes_arrays():
    separation = angles.separation_deg(10.0, 0.0, np.array([10.0, 11.0]), np.array([1.0, 0.0]))
    assert separation == pytest.approx([1.0, 1.0])


@given(ra=RA, dec=DEC)
def test_unit_vectors_come_back_as_the_direction(ra, dec):
    ra_back, dec_back = angles.unit_to_direction(7.0 * angles.direction_to_unit(ra, dec))
    assert angles.separation_deg(float(ra_back), float(dec_back), ra, dec) == pytest.approx(
        0, abs=1e-9
    )


@given(ra=RA, dec=DEC)
def test_written_angles_are_read_back_to_their_last_digit(ra, dec):
    ra_back = angles.parse_ra_deg(words.format_ra(ra, decimals=3))
    assert angles.wrap_180(ra_back - ra) == pytest.approx(0, abs=0.51 * 0.001 * 15 / 3600)
    dec_back = angles.parse_dec_deg(words.format_dec(dec, decimals=2))
    assert dec_back == pytest.approx(dec, abs=0.51 * 0.01 / 3600)


@pytest.mark.parametrize(
    ("text", "ra_deg"),
    [
        ("12 34 56.7", 188.73625),
        ("12:34:56.7", 188.73625),
        ("12h34m56.7s", 188.73625),
        ("23 59", 359.75),
        ("188.5", 188.5),
        ("12h", 180.0),
    ],
)
def test_right_ascension_is_read_as_people_write_it(text, ra_deg):
    assert angles.parse_ra_deg(text) == pytest.approx(ra_deg, abs=1e-10)


@pytest.mark.parametrize(
    ("text", "dec_deg"),
    [
        ("-00 30 00", -0.5),
        ("-0:0:36", -0.01),
        ("+46d01m08s", 46 + 68 / 3600),
        ("−5°30′", -5.5),
        ("-12.25", -12.25),
    ],
)
def test_declination_keeps_its_sign_at_zero_degrees(text, dec_deg):
    assert angles.parse_dec_deg(text) == pytest.approx(dec_deg, abs=1e-10)


@pytest.mark.parametrize("text", ["", "abc", "12:60:00", "1:2:3:4", "nan", "1.5:30", "25:00:00"])
def test_what_is_no_right_ascension_is_refused(text):
    with pytest.raises(ValueError, match=r".+"):
        angles.parse_ra_deg(text)


def test_a_declination_beyond_the_pole_is_refused():
    with pytest.raises(ValueError, match="between -90 and"):
        angles.parse_dec_deg("90 00 01")


def test_rounding_never_shows_sixty_seconds():
    assert words.format_ra(359.99999999) == "00:00:00.00"
    assert words.format_dec(-5.99999999) == "-06:00:00.0"
    assert words.format_dec(-1e-9) == "+00:00:00.0"


@given(one=ANGLE, turn=st.floats(0, 90), halves=st.integers(-3, 3))
def test_two_lines_are_apart_by_their_turn_however_they_are_written(one, turn, halves):
    assert angles.line_angle_deg(one, one + turn + 180 * halves) == pytest.approx(turn, abs=1e-8)
    assert angles.line_angle_deg(one + turn + 180 * halves, one) == pytest.approx(turn, abs=1e-8)
