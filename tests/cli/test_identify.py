"""Names for what was seen: right ones, doubtful ones, and none where nothing fits."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sgp4.api import Satrec
from sgp4.exporter import export_omm

from rsoconsole.base import OrbitError
from rsoconsole.orbits import (
    CatalogueEntry,
    ElementSet,
    Identification,
    Satellite,
    covariance_rtn,
    manoeuvred_probability,
    nearest_epoch_entries,
    parse_element_sets,
    parse_elements,
    states_gcrs,
)
from rsoconsole.orbits.elements.elements import checksum
from rsoconsole.orbits.identification.element_errors import MANOEUVRED, UNDISTURBED
from rsoconsole.pipeline import read_observed_tracks
from rsoconsole.records import Site
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.makers import identify
from tests.truth.seen_satellites import DAYTONA, SHARED, T0_UTC_NS, geostationary, instants, seen

needs_shared = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here"),
]
# Public catalogue, 2023-06-22.
ISS = """\
ISS (ZARYA)
1 25544U 98067A   23173.35687861  .00014974  00000-0  26726-3 0  9991
2 25544  51.6437 302.9025 0004670  68.4285  27.3619 15.50268647402591
"""
TENTH_ARCSEC = 0.1


def catalogue(*elements: ElementSet) -> tuple[CatalogueEntry, ...]:
    lines = [f"{each.name or each.norad_id}\n{each.line_1}\n{each.line_2}" for each in elements]
    return parse_element_sets("\n".join(lines)).entries


def later(elements: ElementSet, by_s: float) -> ElementSet:
    """The same orbit, everything on it so much later."""
    days = float(elements.line_1[20:32]) + by_s / 86_400.0
    line_1 = f"{elements.line_1[:20]}{days:012.8f}{elements.line_1[32:68]}"
    text = f"{line_1}{checksum(line_1)}\n{elements.line_2}"
    return parse_elements(text)[0]


def below(elements: ElementSet, t_utc_ns: int) -> Site:
    """A site near which it passes overhead."""
    from tests.truth.sidereal import gmst_deg

    ((x, y, z),), _ = Satellite(elements).position_gcrs(np.array([t_utc_ns]))
    longitude = np.degrees(np.arctan2(y, x)) - float(gmst_deg(t_utc_ns)) + 2.0
    latitude = np.degrees(np.arctan2(z, np.hypot(x, y))) + 1.0
    return Site(
        latitude_deg=float(latitude),
        longitude_deg=float((longitude + 180.0) % 360.0 - 180.0),
        elevation_m=100.0,
    )


@pytest.mark.parametrize(
    ("observation", "elements", "norad_id", "off_arcsec"),
    [
        ("kazsat2_37749.json", "geo_all_20230622.tle", 37749, 93.0),
        ("navstar77_43873.json", "meo_20200908.tle", 43873, 37.0),
    ],
)
class TestRealObservations:
    pytestmark = needs_shared

    def read(self, observation: str, elements: str) -> tuple[tuple[CatalogueEntry, ...], ...]:
        text = (SHARED / "tles" / elements).read_text(encoding="ascii")
        return (parse_element_sets(text, elements).entries,)

    def test_the_object_is_named_and_the_runner_up_shown(
        self, observation: str, elements: str, norad_id: int, off_arcsec: float
    ) -> None:
        (entries,) = self.read(observation, elements)
        (observed,) = read_observed_tracks(SHARED / "observations" / observation)
        found = identify(observed.seen, observed.site, entries)
        assert found.verdict == "identified"
        assert found.matches[0].norad_id == norad_id
        assert found.matches[0].separation_arcsec == pytest.approx(off_arcsec, abs=1.0)
        assert found.matches[0].probability > 0.99
        assert len(found.matches) > 1
        assert not found.matches[1].is_within_gate

    def test_without_it_nothing_is_named(
        self, observation: str, elements: str, norad_id: int, off_arcsec: float
    ) -> None:
        (entries,) = self.read(observation, elements)
        (observed,) = read_observed_tracks(SHARED / "observations" / observation)
        others = [each for each in entries if each.norad_id != norad_id]
        found = identify(observed.seen, observed.site, others)
        assert found.verdict == "unknown"
        assert len(found.matches) > 1


@pytest.mark.parametrize("kind", ["LEO", "GEO"])
def test_an_object_on_its_elements_is_nowhere_else(kind: str) -> None:
    elements = parse_elements(ISS)[0] if kind == "LEO" else geostationary(90001, -60.0)
    start_ns = elements.epoch_utc_ns + round(0.7 * NS_PER_DAY)
    site = below(elements, start_ns + 60 * NS_PER_S) if kind == "LEO" else DAYTONA
    t = start_ns + np.arange(9) * 15 * NS_PER_S
    found = identify(seen(elements, t, site=site), site, catalogue(elements))
    assert found.verdict == "identified"
    (match,) = found.matches
    assert match.separation_arcsec < TENTH_ARCSEC
    assert match.rate_difference_percent == pytest.approx(0.0, abs=0.01)
    assert match.tle_age_days == pytest.approx(0.7, abs=0.01)


def test_an_object_that_is_late_is_late_by_the_same_time_all_through_its_pass() -> None:
    elements = parse_elements(ISS)[0]
    start_ns = elements.epoch_utc_ns + round(0.7 * NS_PER_DAY)
    site = below(elements, start_ns + 60 * NS_PER_S)
    t = start_ns + np.arange(9) * 15 * NS_PER_S
    observed = seen(later(elements, 0.25), t, site=site)
    (match,) = identify(observed, site, catalogue(elements)).matches
    assert match.along_track_s == pytest.approx(-0.25, abs=0.01)
    assert abs(match.cross_track_arcsec) < 0.05 * abs(match.along_track_arcsec)


def test_one_direction_alone_tells_a_place_and_no_rate() -> None:
    elements = geostationary(90001, -60.0)
    found = identify(seen(elements, instants(0.0, 1)), DAYTONA, catalogue(elements))
    assert found.verdict == "identified"
    assert found.matches[0].rate_difference_percent is None


def test_neighbours_in_one_slot_are_told_apart_while_elements_are_fresh() -> None:
    ours = geostationary(90001, -60.0, name="OURS")
    near = geostationary(90002, -60.05, i_deg=0.03, name="NEIGHBOUR")
    found = identify(seen(ours, instants(3600.0)), DAYTONA, catalogue(near, ours))
    assert found.verdict == "identified"
    assert [each.name for each in found.matches] == ["OURS", "NEIGHBOUR"]


def test_neighbours_in_one_slot_are_ambiguous_once_elements_are_old() -> None:
    ours = geostationary(90001, -60.0, name="OURS")
    near = geostationary(90002, -60.02, name="NEIGHBOUR")
    found = identify(seen(ours, instants(9 * 86_400.0)), DAYTONA, catalogue(near, ours))
    assert found.verdict == "ambiguous"
    assert {each.name for each in found.matches} == {"OURS", "NEIGHBOUR"}
    assert "OURS" in found.reason
    assert "NEIGHBOUR" in found.reason


def moved(by_deg: float, days: float) -> Identification:
    at_home = geostationary(90001, -60.0, name="OURS")
    far = geostationary(90002, -40.0, name="FAR")
    away = geostationary(90001, -60.0 + by_deg)
    return identify(seen(away, instants(days * 86_400.0)), DAYTONA, catalogue(at_home, far))


def test_a_lone_object_off_its_elements_is_said_to_have_been_moved() -> None:
    found = moved(0.1, days=6.0)
    assert found.verdict == "identified"
    assert found.matches[0].along_track_arcsec == pytest.approx(400.0, abs=40.0)
    assert "manoeuvred since their epoch 2023-06-22 02:13" in found.hint
    assert "ahead" in found.hint


def test_beyond_the_gate_it_is_unknown_but_suspected() -> None:
    found = moved(-0.6, days=18.0)
    assert found.verdict == "unknown"
    assert found.hint.startswith("perhaps OURS")
    assert "behind" in found.hint


def test_a_manoeuvre_larger_than_its_time_allows_is_not_suspected() -> None:
    found = moved(1.0, days=1.0)
    assert (found.verdict, found.hint) == ("unknown", "")


def test_another_motion_at_the_same_place_is_another_object() -> None:
    ours = geostationary(90001, -60.0)
    inclined = (
        geostationary(90002, -60.0 + x, i_deg=8.0, node_deg=node)
        for node in range(0, 360, 5)
        for x in (-0.1, 0.0, 0.1)
    )
    crossing = [each for each in inclined if _apart_deg(ours, each) < 0.18]
    assert crossing
    for other in crossing:
        found = identify(seen(ours, instants(0.0)), DAYTONA, catalogue(other))
        assert found.verdict == "unknown"


def _apart_deg(one: ElementSet, other: ElementSet) -> float:
    t = instants(300.0, 1)
    a, b = (Satellite(each).astrometric_place(DAYTONA, t) for each in (one, other))
    return float(
        np.hypot(a.ra_icrs_deg[0] - b.ra_icrs_deg[0], a.dec_icrs_deg[0] - b.dec_icrs_deg[0])
    )


def test_a_catalogue_whose_objects_have_all_come_down_names_nothing() -> None:
    elements = parse_elements(ISS)[0]
    years_later = instants(0.0) + 8000 * NS_PER_DAY
    observed = seen(geostationary(90001, -60.0, epoch_utc_ns=int(years_later[0])), years_later)
    found = identify(observed, DAYTONA, catalogue(elements))
    assert (found.verdict, found.failed, found.matches) == ("unknown", 1, ())


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_of_forty_satellites_of_the_belt_a_day_after_their_elements_none_is_misnamed() -> None:
    from tests.bench.bench_identify import trial

    whole, _ = trial(1.0, 40, None, np.random.default_rng(11))
    assert whole["right"] >= 38
    assert whole["wrong"] == 0


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_measured_errors_of_satellites_kept_in_slots_are_as_large_as_is_assumed() -> None:
    from tests.bench.bench_element_errors import MEAN_MOTION_RAD_S, measured_errors

    errors = measured_errors()
    errors = errors[errors[:, 0] < 35.0]
    squared = []
    for age, *error in errors:
        spread = covariance_rtn(MANOEUVRED["GEO"], age, MEAN_MOTION_RAD_S)[:3, :3]
        place = np.array(error[:3])
        squared.append(float(place @ np.linalg.solve(spread, place)))
    # Of chi squared with 3 degrees of freedom 68 % lie below 3.5 and 99.9 % below 16.3.
    assert np.mean(np.array(squared) < 3.5) > 0.6
    assert np.mean(np.array(squared) < 16.3) > 0.98
    assert np.median(squared) > 0.5


@given(st.sampled_from(sorted(UNDISTURBED)), st.floats(-400.0, 400.0))
def test_assumed_errors_are_a_covariance_at_any_age(regime: str, age_days: float) -> None:
    for table in (UNDISTURBED, MANOEUVRED):
        spread = covariance_rtn(table[regime], age_days, 1e-4)  # type: ignore[index]
        scale = 1.0 / np.sqrt(np.diag(spread))
        assert np.linalg.eigvalsh(spread * np.outer(scale, scale)).min() > -1e-9
    assert 0.0 <= manoeuvred_probability(regime, age_days) < 0.5  # type: ignore[arg-type]


def omm(elements: ElementSet, **other: object) -> dict[str, object]:
    """As Space-Track writes it; by the package sgp4."""
    record = Satrec.twoline2rv(elements.line_1, elements.line_2)
    return {**export_omm(record, elements.name or "UNNAMED"), **other}


def as_xml(messages: list[dict[str, object]]) -> str:
    """The skeleton of CCSDS 502.0."""

    def block(name: str, keys: tuple[str, ...], message: dict[str, object]) -> str:
        inner = "".join(f"<{key}>{message[key]}</{key}>" for key in keys if key in message)
        return f"<{name}>{inner}</{name}>"

    metadata = ("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "TIME_SYSTEM", "MEAN_ELEMENT_THEORY")
    mean = (
        *("EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION"),
        *("RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY"),
    )
    segments = "".join(
        "<segment>"
        + block("metadata", metadata, each)
        + "<data>"
        + block("meanElements", mean, each)
        + block("tleParameters", tuple(k for k in each if k not in {*metadata, *mean}), each)
        + "</data></segment>"
        for each in messages
    )
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<ndm><omm><body>{segments}</body></omm></ndm>'


def as_csv(messages: list[dict[str, object]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, messages[0])
    writer.writeheader()
    writer.writerows(messages)
    return text.getvalue()


@pytest.mark.parametrize("write", [json.dumps, as_xml, as_csv])
def test_two_lines_and_omm_in_any_dress_put_the_object_at_one_place(write: object) -> None:
    sets = [parse_elements(ISS)[0], geostationary(90001, -60.0, name="OURS")]
    read = parse_element_sets(write([omm(each) for each in sets])).entries  # type: ignore[operator]
    lines = catalogue(*sets)
    assert [each.norad_id for each in read] == [25544, 90001]
    assert [each.name for each in read] == ["ISS (ZARYA)", "OURS"]
    t = instants(43_200.0, 3)
    two_metres_km = 2e-3
    assert np.abs(states_gcrs(read, t)[0] - states_gcrs(lines, t)[0]).max() < two_metres_km


def test_omm_carries_numbers_for_which_two_lines_have_no_room() -> None:
    message = omm(geostationary(90001, -60.0), NORAD_CAT_ID=799_501_234)
    (entry,) = parse_element_sets(json.dumps(message)).entries
    assert entry.norad_id == 799_501_234
    assert np.all(np.isfinite(states_gcrs([entry], instants(0.0, 1))[0]))


def test_of_a_history_the_set_nearest_in_epoch_counts() -> None:
    old = geostationary(90001, -60.0, epoch_utc_ns=T0_UTC_NS - 30 * NS_PER_DAY)
    new = geostationary(90001, -60.0)
    (chosen,) = nearest_epoch_entries(catalogue(old, new, old), T0_UTC_NS + NS_PER_DAY)
    assert abs(chosen.epoch_utc_ns - T0_UTC_NS) < NS_PER_S


GOOD = omm(geostationary(90001, -60.0))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds no element set"),
        ("<html><body>Too many requests</body></html>", "holds no element set"),
        ("No GP data found", "holds no element set"),
        ("[]", "holds no element set"),
        ("[{", "no OMM in JSON"),
        ("[1, 2]", "holds no element set"),
        ("<ndm><omm>", "no OMM in XML"),
        (json.dumps([1, {**GOOD, "EPOCH": "soon"}]), "object 2: 'soon' is not a time"),
        (
            json.dumps({**GOOD, "MEAN_MOTION": "fast"}),
            "object 1: MEAN_MOTION is 'fast', not a number",
        ),
        (json.dumps({k: v for k, v in GOOD.items() if k != "BSTAR"}), "BSTAR is missing"),
        (json.dumps({**GOOD, "TIME_SYSTEM": "TAI"}), "TIME_SYSTEM is TAI"),
        (json.dumps({**GOOD, "MEAN_ELEMENT_THEORY": "SGP4-XP"}), "MEAN_ELEMENT_THEORY is SGP4-XP"),
        (ISS.replace("302.9025", "302.9026"), "line 3: checksum"),
    ],
)
def test_what_is_no_catalogue_is_refused_by_name(text: str, complaint: str) -> None:
    with pytest.raises(OrbitError, match=complaint) as refused:
        parse_element_sets(text, "night.tle")
    assert "night.tle" in str(refused.value)


def test_a_mark_of_byte_order_and_blank_lines_do_no_harm(tmp_path: Path) -> None:
    assert parse_element_sets("\ufeff\n\n" + ISS).entries[0].norad_id == 25544
