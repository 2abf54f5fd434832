"""Element sets as people publish them, eclipses and brightness."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.base import OrbitError
from rsoconsole.orbits import Satellite, nearest_epoch_entries, parse_element_sets, parse_elements
from rsoconsole.orbits.elements.catalogue import magnitude
from rsoconsole.orbits.elements.elements import checksum
from rsoconsole.records import Site
from rsoconsole.sky import bodies as sun
from rsoconsole.sky import frames, times
from rsoconsole.words import utc_ns_to_iso

TLES = Path(__file__).parents[3] / "shared" / "data" / "tles"
DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
# Public catalogue, 2023-06-22.
INTELSAT_14 = """\
INTELSAT 14
1 36097U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2 36097   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
"""
# The orbit of SGP4's own test case (Spacetrack Report 3), its number padded with blanks.
PADDED = """\
1   862U 64038A   88275.98708465  .00073094  13844-3  66816-4 0     7
2   862  72.8435 115.9689 0086731  52.6988 110.5714 16.05824518  1054
"""


def with_checksums(text: str) -> str:
    return "\n".join(
        line[:68] + str(checksum(line)) if line[:2] in ("1 ", "2 ") else line
        for line in text.splitlines()
    )


GOOD = with_checksums(INTELSAT_14)
LINE_1, LINE_2 = GOOD.splitlines()[1:]


def test_three_lines_and_two_lines_mean_the_same_satellite():
    (named,) = parse_elements(GOOD)
    (bare,) = parse_elements(f"{LINE_1}\n{LINE_2}\n")
    assert (named.name, bare.name) == ("INTELSAT 14", "")
    assert named.norad_id == bare.norad_id == 36097
    assert utc_ns_to_iso(named.epoch_utc_ns) == "2023-06-22T02:00:03.463Z"


def test_numbers_padded_with_blanks_are_read_and_propagated():
    (padded,) = parse_elements(with_checksums(PADDED))
    zeros = PADDED.replace("   862", " 00862")
    (filled,) = parse_elements(with_checksums(zeros))
    assert padded.norad_id == filled.norad_id == 862
    assert utc_ns_to_iso(padded.epoch_utc_ns).startswith("1988-10-01T23:41:24")
    t = np.array([padded.epoch_utc_ns])
    assert np.array_equal(
        Satellite(padded).position_gcrs(t)[0], Satellite(filled).position_gcrs(t)[0]
    )


def test_alpha_5_numbers_are_read():
    text = with_checksums(GOOD.replace("36097", "T0001"))
    (one,) = parse_elements(text)
    assert one.norad_id == 270001


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (GOOD.replace("126.2276", "126.2277"), "line 3: checksum"),
        (LINE_1, "no line 2"),
        (LINE_2, "without its line 1"),
        (f"{LINE_1}\n{LINE_2[:60]}", "line 2: 69 columns needed, 60 found"),
        (with_checksums(f"{LINE_1}\n{LINE_2.replace('36097', '36098')}"), "different satellites"),
        (with_checksums(GOOD.replace("23173.0", "23x73.0")), "not an epoch"),
        (with_checksums(GOOD.replace("330.4592", "33E.4592")), "not a number"),
        (with_checksums(GOOD.replace("36097", "3K097")), "not a catalogue number"),
    ],
)
def test_a_damaged_set_is_refused_by_line(text, complaint):
    with pytest.raises(OrbitError, match=complaint):
        parse_elements(text, "some.tle")


@settings(max_examples=200, deadline=None)
@given(
    position=st.integers(0, len(GOOD) - 1),
    character=st.characters(),
    is_checked=st.booleans(),
)
def test_no_single_wrong_character_crashes(position, character, is_checked):
    text = GOOD[:position] + character + GOOD[position + 1 :]
    text = with_checksums(text) if is_checked else text
    with suppress(OrbitError):
        for one in parse_elements(text):
            Satellite(one).position_gcrs(np.array([one.epoch_utc_ns]))


def test_the_set_nearest_in_epoch_is_chosen():
    old = GOOD.replace("23173.0", "23163.0").replace("INTELSAT 14", "OLD")
    entries = parse_element_sets(with_checksums(old) + "\n" + GOOD).entries
    first, second = (one.epoch_utc_ns for one in entries)
    for t_utc_ns, name in ((first + 1, "OLD"), (second - 1, "INTELSAT 14")):
        assert [one.name for one in nearest_epoch_entries(entries, t_utc_ns)] == [name]


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "count"),
    [("mix_20230622.tle", 112), ("geo_all_20230622.tle", 1665), ("meo_20200908.tle", 994)],
)
def test_whole_catalogues_are_read(name, count):
    if not (TLES / name).exists():
        pytest.skip(f"independent test data not found: {TLES / name}")
    sets = parse_elements((TLES / name).read_text(), name)
    assert len(sets) == len({one.norad_id for one in sets}) == count


def test_intelsat_14_stands_where_the_paper_saw_it():
    """The paper's example: azimuth 124, altitude 38, hour angle -2.7 h from Daytona Beach."""
    (elements,) = parse_elements(GOOD)
    t = elements.epoch_utc_ns + np.arange(0, 86400, 7200) * times.NS_PER_S
    place = Satellite(elements).astrometric_place(DAYTONA, t)
    altitude, azimuth = frames.icrs_to_altaz(DAYTONA, place.ra_icrs_deg, place.dec_icrs_deg, t)
    assert altitude == pytest.approx(np.full(t.size, 38.0), abs=1.0)
    assert azimuth == pytest.approx(np.full(t.size, 124.0), abs=1.0)
    ha = frames.hour_angle_icrs_deg(DAYTONA, place.ra_icrs_deg, place.dec_icrs_deg, t)
    assert ha / 15 == pytest.approx(np.full(t.size, -2.7), abs=0.1)


def equator_lit(day: str) -> np.ndarray:
    """Lit fraction of a satellite on the belt through one day, each half minute."""
    (elements,) = parse_elements(GOOD)
    t = times.iso_to_utc_ns(f"{day}T00:00:00Z") + np.arange(2880) * 30 * times.NS_PER_S
    position, _ = Satellite(elements).position_gcrs(t)
    return sun.lit_fraction(position, t)


def test_eclipse_at_the_equinox_lasts_about_seventy_minutes_and_none_at_the_solstice():
    lit = equator_lit("2023-09-23")
    umbra_min, shadow_min = np.sum(lit == 0) / 2, np.sum(lit < 1) / 2
    assert umbra_min == pytest.approx(67.5, abs=2)
    assert shadow_min == pytest.approx(72, abs=2)
    assert np.all(equator_lit("2023-06-22") == 1.0)


def test_penumbra_falls_steadily():
    lit = equator_lit("2023-09-23")
    entry = int(np.argmax(lit < 1))
    fall = lit[entry - 1 : entry + 8]
    assert np.all(np.diff(fall) <= 0)
    assert 0.0 < fall[2] < 1.0


def test_shadow_agrees_with_skyfields_sunlit_outside_the_penumbra():
    import skyfield_data
    from skyfield.api import EarthSatellite, load, load_file

    (elements,) = parse_elements(with_checksums(PADDED.replace("88275", "23265")))
    t = elements.epoch_utc_ns + np.arange(0, 6000, 20) * times.NS_PER_S
    position, _ = Satellite(elements).position_gcrs(t)
    lit = sun.lit_fraction(position, t)
    timescale = load.timescale(builtin=True)
    theirs = EarthSatellite(elements.line_1, elements.line_2, "", timescale)
    instants = timescale.tt_jd(*times.jd_tt(t))
    ephemeris = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    is_sunlit = theirs.at(instants).is_sunlit(ephemeris)
    ephemeris.close()
    is_sure = (lit == 0.0) | (lit == 1.0)
    assert np.mean(is_sure) > 0.95
    assert np.array_equal(lit[is_sure] == 1.0, is_sunlit[is_sure])
    assert 0.2 < np.mean(is_sunlit) < 0.9


def test_magnitude_of_a_diffuse_sphere():
    one, far = np.array([36_000.0]), np.array([72_000.0])
    full = magnitude(11.0, one, np.array([0.0]), np.array([1.0]))
    assert full == pytest.approx([11.0])
    assert magnitude(11.0, far, np.array([0.0]), np.array([1.0])) == pytest.approx(
        [12.505], abs=1e-3
    )
    # Half phase of a Lambert sphere gives 1/pi of its full light.
    half = magnitude(11.0, one, np.array([90.0]), np.array([1.0]))
    assert half == pytest.approx([11.0 + 2.5 * np.log10(np.pi)])
    assert np.isinf(magnitude(11.0, one, np.array([0.0]), np.array([0.0])))


def test_a_satellite_goes_dark_in_the_umbra_and_shines_outside():
    (elements,) = parse_elements(GOOD)
    t = times.iso_to_utc_ns("2023-09-23T00:00:00Z") + np.arange(288) * 300 * times.NS_PER_S
    satellite = Satellite(elements, standard_magnitude=11.5)
    brightness = satellite.magnitude(satellite.astrometric_place(DAYTONA, t))
    assert 11 <= np.sum(np.isinf(brightness)) <= 16
    assert np.min(brightness) == pytest.approx(11.6, abs=0.3)


def test_a_decayed_satellite_has_no_place():
    (elements,) = parse_elements(with_checksums(PADDED))
    years_later = elements.epoch_utc_ns + 40 * 365 * times.NS_PER_DAY
    place = Satellite(elements).astrometric_place(DAYTONA, np.array([years_later]))
    assert np.isnan(place.ra_icrs_deg[0])
