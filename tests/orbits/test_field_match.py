"""What was in my frame: candidates along the track, and one object for one streak."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from sgp4.api import SatrecArray

from rsoconsole.config import Config
from rsoconsole.orbits import (
    Candidate,
    CatalogueEntry,
    FieldCatalogue,
    FieldMatch,
    StreakLine,
    match_field,
)
from rsoconsole.orbits.elements.sky_paths import Observer
from rsoconsole.pipeline import CatalogueMatcher, FieldFrame
from rsoconsole.pipeline.field.field_points import FramePoints
from rsoconsole.records import Detection, FloatArray, Solution
from rsoconsole.sky import site_gcrs, unit_to_direction
from rsoconsole.words import NS_PER_DAY
from tests.bench.bench_field import Fields
from tests.truth.fields_of_truth import (
    DAY_UTC_NS,
    SITE,
    TLES,
    Plate,
    behind,
    line_of,
    low_entry,
    plate_at,
    replicated,
    strange_line,
)

EXPOSURE_S = 1.0


@pytest.fixture(scope="module")
def low() -> CatalogueEntry:
    """A low object more than 40 degrees high."""
    rng = np.random.default_rng(4)
    zenith = site_gcrs(SITE, np.array([DAY_UTC_NS]))[0][0]
    while True:
        found = low_entry(rng, 41, DAY_UTC_NS)
        seen = Observer(SITE, DAY_UTC_NS).places_at_leads(SatrecArray([found.record]), np.zeros(1))
        if seen.u[0, 0] @ zenith > 0.65 * np.linalg.norm(zenith):
            return found


def looking_at(true: CatalogueEntry, exposure_s: float = EXPOSURE_S) -> Plate:
    seen = Observer(SITE, DAY_UTC_NS).places_at_leads(SatrecArray([true.record]), np.zeros(1))
    ra, dec = (float(x) for x in unit_to_direction(seen.u[0, 0]))
    return plate_at(ra, dec, DAY_UTC_NS, exposure_s)


def drawn_by(plate: Plate, true: CatalogueEntry, seed: int = 1) -> StreakLine:
    line = line_of(plate, true, np.random.default_rng(seed))
    assert line is not None
    return line


def asked(
    plate: Plate, entries: list[CatalogueEntry], lines: list[StreakLine]
) -> tuple[tuple[Candidate, ...], FieldMatch]:
    candidates = FieldCatalogue(entries).candidates(plate.view)
    return candidates, match_field(plate.view, candidates, lines)


@pytest.mark.parametrize("late_s", [-35.0, -12.0, 0.0, 12.0, 35.0])
def test_a_low_object_tens_of_seconds_off_is_found_along_its_track(low, late_s):
    true = behind(low, late_s)
    plate = looking_at(true)
    candidates, found = asked(plate, [low], [drawn_by(plate, true)])
    (matched,) = found.lines
    assert matched.verdict == "identified"
    fit = matched.choices[0].fit
    assert fit is not None
    # Mean anomaly runs a two-thousandth slower than the satellite, by the Earth's flattening.
    assert fit.along_s == pytest.approx(-late_s, rel=1e-3, abs=0.01)
    ten_arcsec = math.radians(10.0 / 3600.0)
    assert abs(fit.across_rad) < ten_arcsec
    assert candidates[0].gate_s > 35.0


def test_beyond_its_gate_it_is_no_candidate(low):
    plate = looking_at(behind(low, 200.0))
    assert not FieldCatalogue([low]).candidates(plate.view)


@pytest.mark.parametrize("exposure_s", [0.05, 10.0])
def test_a_field_of_two_arcmin_is_not_stepped_over(low, exposure_s):
    true = behind(low, 3.37)
    seen = Observer(SITE, DAY_UTC_NS).places_at_leads(SatrecArray([true.record]), np.zeros(1))
    ra, dec = (float(x) for x in unit_to_direction(seen.u[0, 0]))
    plate = plate_at(ra, dec, DAY_UTC_NS, exposure_s, 0.04)
    (candidate,) = FieldCatalogue([low]).candidates(plate.view)
    assert candidate.chance > 0.0
    nearest = np.arccos(np.clip(candidate.u @ plate.view.centre, -1.0, 1.0)).min()
    assert nearest < plate.view.radius_rad


def test_the_chance_that_it_crossed_falls_with_how_far_its_elements_put_it(low):
    chances = []
    for late_s in (0.0, 4.0, 30.0):
        (candidate,) = FieldCatalogue([low]).candidates(looking_at(behind(low, late_s)).view)
        chances.append(candidate.chance)
    assert chances[0] > 0.9
    assert chances[0] > chances[1] > chances[2] > 0.0


def turned(line: StreakLine, angle_deg: float) -> StreakLine:
    """The same middle, another direction."""
    way = (line.b - line.a) / 2.0
    side = np.cross(line.middle, way)
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    new = c * way + s * side
    return replace(line, a=unit(line.middle - new), b=unit(line.middle + new))


def longer(line: StreakLine, times: float) -> StreakLine:
    way = (line.b - line.a) / 2.0
    return replace(line, a=unit(line.middle - times * way), b=unit(line.middle + times * way))


def unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


@pytest.mark.parametrize("other", [lambda x: turned(x, 6.0), lambda x: longer(x, 1.3)])
def test_a_streak_of_another_direction_or_length_is_in_no_catalogue(low, other):
    plate = looking_at(low, 0.5)
    line = drawn_by(plate, low)
    _, found = asked(plate, [low], [other(line)])
    assert found.lines[0].verdict == "unknown"
    assert found.taken == (0.0,)


def test_one_that_shines_for_a_part_of_the_exposure_is_named_with_a_wider_time(low):
    """Or whose streak the detector does not follow to its end."""
    plate = looking_at(low, 1.0)
    line = drawn_by(plate, low)
    _, found = asked(plate, [low], [longer(line, 0.25)])
    (matched,) = found.lines
    assert matched.verdict == "identified"
    part, whole = matched.choices[0].fit, asked(plate, [low], [line])[1].lines[0].choices[0].fit
    assert part is not None
    assert whole is not None
    assert part.sigma_along_s > 0.15 > whole.sigma_along_s
    assert abs(part.along_s) < 3.0 * part.sigma_along_s


def test_one_object_is_one_streak(low):
    plate = looking_at(low)
    two = [drawn_by(plate, low), strange_line(plate, np.random.default_rng(3))]
    near = drawn_by(plate, behind(low, 0.4), seed=2)
    _, found = asked(plate, [low], [two[0], near, two[1]])
    names = [each.choices[0].candidate for each in found.lines]
    assert names.count(0) == 1
    assert found.lines[2].verdict == "unknown"


def test_two_within_each_others_errors_are_ambiguous_and_both_are_named(low):
    twin = behind(low, 0.3, number=42)
    plate = looking_at(low)
    candidates, found = asked(plate, [low, twin], [drawn_by(plate, behind(low, 0.15))])
    (matched,) = found.lines
    assert matched.verdict == "ambiguous"
    named = {
        candidates[c.candidate].entry.norad_id for c in matched.choices if c.candidate is not None
    }
    assert named == {41, 42}
    _, both = asked(plate, [low, twin], [drawn_by(plate, low), drawn_by(plate, twin, seed=5)])
    assert {each.choices[0].candidate for each in both.lines} == {0, 1}


def test_a_crossing_is_matched_by_its_line_alone_and_a_cut_streak_by_its_end(low):
    kinds = Counter()
    for exposure_s in (10.0, 2.0):
        for seed in range(6):
            plate = looking_at(behind(low, 0.3 * seed), exposure_s)
            line = drawn_by(plate, low, seed)
            kinds[line.is_end_a + line.is_end_b] += 1
            _, found = asked(plate, [low], [line])
            assert found.lines[0].verdict == "identified", (exposure_s, seed)
    assert kinds[0] >= 3
    assert kinds[1] >= 1


def test_elements_of_another_season_are_not_used(low):
    old = replace(low, epoch_utc_ns=low.epoch_utc_ns - 90 * NS_PER_DAY)
    catalogue = FieldCatalogue([old])
    assert catalogue.candidates(looking_at(low).view) == ()
    assert (catalogue.compared_count, catalogue.too_old_count) == (0, 1)


def test_a_frame_that_nothing_crossed_names_nothing(low):
    plate = looking_at(low)
    away = plate_at(200.0, -60.0, DAY_UTC_NS, EXPOSURE_S)
    candidates, found = asked(away, [low], [strange_line(away, np.random.default_rng(1))])
    assert candidates == ()
    assert found.lines[0].verdict == "unknown"
    assert found.lines[0].choices[0].probability == 1.0
    assert asked(plate, [low], [])[1].lines == ()


def test_what_is_below_tau_counts_where_an_object_explains_it(low):
    plate = looking_at(low)
    detection = Detection(
        frame_id=1,
        confidence=0.05,
        x_px=750.0,
        y_px=750.0,
        x_a_px=700.0,
        y_a_px=750.0,
        x_b_px=800.0,
        y_b_px=750.0,
        box_px=(700.0, 740.0, 800.0, 760.0),
        length_px=100.0,
        width_px=2.0,
        snr=20.0,
        sigma_along_px=0.5,
        sigma_across_px=0.2,
        is_clipped=False,
        method="line",
    )
    of_low = replace(drawn_by(plate, low), strangers=5.0)
    other = replace(strange_line(plate, np.random.default_rng(8)), strangers=5.0)
    empty = np.empty(0)
    frame = FieldFrame(
        t_mid_utc_ns=DAY_UTC_NS,
        exposure_s=EXPOSURE_S,
        width_px=plate.side_px,
        height_px=plate.side_px,
        solution=Solution(
            frame_id=1,
            wcs=plate.wcs,
            ra_icrs_deg=plate.wcs.crval_ra_deg,
            dec_icrs_deg=plate.wcs.crval_dec_deg,
            scale_arcsec_px=3.6,
            rotation_deg=20.0,
            is_flipped=False,
            matched=30,
            rms_arcsec=0.5,
            path="full",
            ms=0.0,
        ),
        plate_from="solved",
        detections=(detection, replace(detection, confidence=0.04)),
        taken=0,
        lines=(of_low, other),
        points=FramePoints(
            u=np.empty((0, 3)),
            t_utc_ns=np.empty(0, np.int64),
            x_px=empty,
            y_px=empty,
            snr=empty,
            sigma_arcsec=1.0,
            fwhm_arcsec=5.0,
            exposure_s=EXPOSURE_S,
            centre=plate.view.centre,
            area_arcsec2=1e6,
        ),
        notes=(),
    )
    config = Config.model_validate(
        {
            "site": {
                "latitude_deg": SITE.latitude_deg,
                "longitude_deg": SITE.longitude_deg,
                "elevation_m": SITE.elevation_m,
            }
        }
    )
    found = CatalogueMatcher(config, [low]).match_frame(frame)
    assert [each.confidence for each in found.detections] == [0.05]
    assert found.match.lines[0].verdict == "identified"
    assert found.match.taken[0] > 0.95
    nothing = CatalogueMatcher(config, [low]).match_frame(replace(frame, lines=(other, other)))
    assert nothing.detections == ()
    assert nothing.match.taken == (0.0,)


@pytest.mark.nightly("statistics over many fields")
@pytest.mark.shared_data
@pytest.mark.timeout(300)
@pytest.mark.skipif(not TLES.is_dir(), reason=f"{TLES} is not here")
def test_over_random_fields_the_right_name_is_given():
    """Of the large sample in ``bench_field``; objects are off within the model."""
    many = Fields(replicated(4000, 11), 12)
    total: Counter[str] = Counter()
    for _ in range(25):
        total += many.run()
    words: Counter[str] = Counter()
    for key, count in total.items():
        if ": " in key:
            words[key.split(": ")[1].split(",")[0]] += count
    assert total["lines"] >= 20
    assert words["right"] >= 0.93 * total["lines"], total
    assert words["wrong"] <= 1, total
