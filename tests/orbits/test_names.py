"""Objects of a catalogue by number and by name, as people write them."""

import pytest

from rsoconsole.base import OrbitError
from rsoconsole.orbits import find_object, parse_element_sets
from tests.orbits.test_satellite import with_checksums

LINES = """\
INTELSAT 14
1 36097U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2 36097   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
INTELSAT 14
1 36097U 09064A   23170.08337341 -.00000267  00000-0  00000+0 0  9994
2 36097   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
INTELSAT 1
1 36098U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2 36098   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
GPS BIIR-2  (PRN 13)
1   862U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2   862   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
"""
CATALOGUE = parse_element_sets(with_checksums(LINES)).entries


@pytest.mark.parametrize(
    ("wanted", "number", "sets"),
    [
        ("36097", 36097, 2),
        ("00862", 862, 1),
        ("INTELSAT 14", 36097, 2),
        ("intelsat-14", 36097, 2),
        ("Intelsat 1", 36098, 1),
        ("prn 13", 862, 1),
        ("biir", 862, 1),
    ],
)
def test_one_object_is_found_by_its_number_its_name_or_a_clear_part_of_it(wanted, number, sets):
    found = find_object(CATALOGUE, wanted)
    assert {each.norad_id for each in found} == {number}
    assert len(found) == sets


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ("intelsat", r"2 objects: INTELSAT 14 \(36097\), INTELSAT 1 \(36098\)"),
        ("intelsta 14", r"near it: INTELSAT 14 \(36097\)"),
        ("99999", "no object is called '99999' among 3 objects"),
        ("", "no object is called ''"),
    ],
)
def test_what_is_not_clear_is_refused_with_the_candidates(wanted, words):
    with pytest.raises(OrbitError, match=words):
        find_object(CATALOGUE, wanted)


def test_no_elements_at_all_are_said_to_be_missing():
    with pytest.raises(OrbitError, match="no element sets"):
        find_object((), "ISS")
