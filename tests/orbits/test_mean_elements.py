"""SGP4 elements of what was seen, as two lines and as messages other programs read."""

import io
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.base import OrbitError
from rsoconsole.orbits import (
    ANALYST_NUMBERS,
    MeanElements,
    MeasuredDirections,
    Orbit,
    Satellite,
    determine_orbit,
    fit_mean_elements,
    omm_message,
    parse_elements,
)
from rsoconsole.orbits.elements.elements import checksum
from rsoconsole.orbits.elements.sgp4_fit import TLE_STEP_NS
from rsoconsole.sky import SkyPlaces, iso_to_utc_ns
from rsoconsole.words import NS_PER_S
from tests.truth.orbit_truth import DAYTONA, off_arcsec, seen_with_noise
from tests.truth.orekit import ask

# Public catalogue, 2023-06-22.
INTELSAT_14 = """\
INTELSAT 14
1 36097U 09064A   23173.08337341 -.00000267  00000-0  00000+0 0  9994
2 36097   0.0135 330.4592 0002329 126.2276 158.3314  1.00271284 49759
"""
INTELSAT_21 = """\
INTELSAT 21
1 38749U 12045A   23173.08335996 -.00000209  00000-0  00000+0 0  9999
2 38749   0.0261 328.6586 0003260 147.3837 126.0563  1.00269844 39613
"""
T0 = iso_to_utc_ns("2023-06-22T02:00:00Z")
CREATED = iso_to_utc_ns("2023-06-24T12:00:00Z")
TWO_NIGHTS_S = np.concatenate([np.arange(0.0, 14_400.0, 120.0)] * 2) + np.repeat([0, 86_400], 120)


def satellite(text: str) -> Satellite:
    lines = [
        line[:68] + str(checksum(line)) if line[:2] in ("1 ", "2 ") else line
        for line in text.splitlines()
    ]
    return Satellite(parse_elements("\n".join(lines))[0])


def observed(published: Satellite, sigma: float) -> tuple[MeasuredDirections, Orbit]:
    t = T0 + (TWO_NIGHTS_S * NS_PER_S).astype(np.int64)
    places = published.astrometric_place(DAYTONA, t)
    seen = seen_with_noise(np.random.default_rng(4), DAYTONA, places, sigma)
    orbit = determine_orbit(seen)
    assert orbit is not None
    return seen, orbit


def worst(one: SkyPlaces, other: SkyPlaces) -> float:
    return float(np.max(np.linalg.norm(off_arcsec(one, other), axis=1)))


@pytest.mark.parametrize(
    ("published", "sigma", "in_span", "a_day_later"),
    [
        (INTELSAT_14, 0.05, 1.0, 5.0),
        (INTELSAT_21, 0.05, 1.0, 5.0),
        # With noise what the nights do not show is told less well.
        (INTELSAT_14, 1.0, 2.0, 20.0),
    ],
)
def test_elements_of_two_nights_are_those_that_made_them(
    published, sigma, in_span, a_day_later
) -> None:
    truth = satellite(published)
    seen, orbit = observed(truth, sigma)
    fitted = Satellite(fit_mean_elements(orbit, seen).element_set())
    during, later = seen.t_utc_ns, seen.t_utc_ns[-1] + np.arange(0, 86_401, 3600) * NS_PER_S
    for instants, bound in ((during, in_span), (later, a_day_later)):
        ours = fitted.astrometric_place(DAYTONA, instants)
        assert worst(ours, truth.astrometric_place(DAYTONA, instants)) < bound


@pytest.fixture(scope="module")
def fitted() -> MeanElements:
    seen, orbit = observed(satellite(INTELSAT_14), 1.0)
    return fit_mean_elements(orbit, seen, norad_id=80_042, name="UNKNOWN 42")


def test_two_lines_are_well_formed_and_named_as_an_analysts(fitted) -> None:
    element_set = fitted.element_set()
    for line in (element_set.line_1, element_set.line_2):
        assert len(line) == 69
        assert line[-1] == str(checksum(line))
        assert line[2:7] == "80042"
    assert element_set.name == "UNKNOWN 42"
    assert element_set.norad_id in ANALYST_NUMBERS
    assert abs(element_set.epoch_utc_ns - fitted.epoch_utc_ns) < TLE_STEP_NS
    assert 0.8 < fitted.rms_arcsec < 1.2
    assert fitted.bstar == 0.0


def test_sgp4s_own_readers_find_the_same_satellite_in_every_form(fitted) -> None:
    from sgp4 import omm as reader
    from sgp4.api import Satrec

    xml = next(
        reader.parse_xml(io.StringIO(omm_message(fitted, created_utc_ns=CREATED, form="xml")))
    )
    (flat,) = json.loads(omm_message(fitted, created_utc_ns=CREATED, form="json"))
    kvn = dict(
        line.split(" = ", 1)
        for line in omm_message(fitted, created_utc_ns=CREATED).splitlines()
        if " = " in line
    )
    own = fitted.sgp4_record()
    a_day_on = (own.jdsatepoch + 1.0, own.jdsatepochF)
    for fields in (xml, {key: str(value) for key, value in flat.items()}, kvn):
        record = Satrec()
        reader.initialize(record, fields)
        assert record.satnum == 80_042
        ours, theirs = (each.sgp4(*a_day_on)[1] for each in (own, record))
        one_metre_km = 1e-3
        np.testing.assert_allclose(theirs, ours, atol=one_metre_km)


def test_orekit_reads_the_message(fitted) -> None:
    forms = ("kvn", "xml")
    asked = [{"text": omm_message(fitted, created_utc_ns=CREATED, form=form)} for form in forms]
    for found in ask("omm", asked):
        assert found["name"] == "UNKNOWN 42"
        assert found["norad_id"] == 80_042
        assert found["frame"] == "TEME"
        assert found["theory"] == "SGP4"
        assert found["epoch"].rstrip("Z") in omm_message(fitted, created_utc_ns=CREATED)
        assert found["revolutions_a_day"] == pytest.approx(fitted.revolutions_a_day, abs=1e-11)
        assert found["e"] == pytest.approx(fitted.e, abs=1e-11)
        for key in ("i_deg", "raan_deg", "argp_deg", "m_deg"):
            assert found[key] == pytest.approx(getattr(fitted, key), abs=1e-9)


def test_names_from_elsewhere_do_no_harm_to_a_message(fitted) -> None:
    from dataclasses import replace

    named = replace(fitted, name="<&>\nCOMMENT = 1")
    text = omm_message(named, created_utc_ns=CREATED)
    assert "OBJECT_NAME = <&> COMMENT = 1" in text.splitlines()
    assert "&lt;&amp;&gt; COMMENT = 1" in omm_message(named, created_utc_ns=CREATED, form="xml")
    json.loads(omm_message(named, created_utc_ns=CREATED, form="json"))


@settings(max_examples=60, deadline=None)
@given(
    raan_deg=st.floats(0.0, 359.99999),
    argp_deg=st.floats(0.0, 359.99999),
    m_deg=st.floats(0.0, 359.99999),
    i_deg=st.floats(0.0, 179.9),
    e=st.floats(0.0, 0.59),  # above the ground at four revolutions a day
    revolutions_a_day=st.floats(0.9, 4.0),
    bstar=st.one_of(st.just(0.0), st.floats(-0.1, 0.1)),
    norad_id=st.integers(1, 339_999),
)
def test_what_two_lines_say_is_what_was_meant(**drawn) -> None:
    meant = MeanElements(
        name="A NAME", epoch_utc_ns=T0 // TLE_STEP_NS * TLE_STEP_NS, rms_arcsec=1.0, **drawn
    )
    read = meant.element_set()
    assert read.norad_id == meant.norad_id
    assert abs(read.epoch_utc_ns - meant.epoch_utc_ns) <= TLE_STEP_NS
    line = read.line_2
    longitude = sum(float(line[a:b]) for a, b in ((17, 25), (34, 42), (43, 51)))
    true = meant.raan_deg + meant.argp_deg + meant.m_deg
    last_digit_deg = 1e-4
    assert abs((longitude - true + 180.0) % 360.0 - 180.0) < last_digit_deg
    assert float(line[8:16]) == pytest.approx(meant.i_deg, abs=last_digit_deg)
    assert float("0." + line[26:33]) == pytest.approx(meant.e, abs=1e-7)
    assert float(line[52:63]) == pytest.approx(meant.revolutions_a_day, abs=1e-8)


def test_an_orbit_that_has_come_down_has_no_elements() -> None:
    from dataclasses import replace

    seen, orbit = observed(satellite(INTELSAT_14), 1.0)
    with pytest.raises(OrbitError, match="elements"):
        fit_mean_elements(replace(orbit, v_km_s=orbit.v_km_s * 0.01), seen)
    with pytest.raises(OrbitError, match="elements"):
        fit_mean_elements(replace(orbit, v_km_s=orbit.v_km_s * 2.0), seen)


def test_a_number_that_two_lines_cannot_hold_is_refused_and_an_omm_holds_it(fitted) -> None:
    from dataclasses import replace

    large = replace(fitted, norad_id=799_999_999)
    with pytest.raises(OrbitError, match="write an OMM"):
        large.element_set()
    assert "NORAD_CAT_ID = 799999999" in omm_message(large, created_utc_ns=CREATED)
