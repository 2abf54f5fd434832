"""Points that move through several frames and are no star."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.instruments import read_frame
from rsoconsole.pipeline.field.field_frame import FieldPlateFinder
from rsoconsole.pipeline.field.field_points import FramePoints, find_movers, frame_points
from rsoconsole.records import Solution
from rsoconsole.sky import (
    direction_to_unit,
    parse_dec_deg,
    parse_ra_deg,
    separation_deg,
    unit_to_direction,
)
from rsoconsole.vision import find_stars
from rsoconsole.words import NS_PER_S
from tests.truth.seen_satellites import SHARED

MODRA = SHARED / "field" / "modra"
T0 = 1_700_000_000 * NS_PER_S
CENTRE = (120.0, 20.0)


def frame(k: int, places: np.ndarray, cadence_s: float = 5.0) -> FramePoints:
    """Points at offsets (n, 2) in arcsec east and north."""
    ra = CENTRE[0] + places[:, 0] / 3600.0 / math.cos(math.radians(CENTRE[1]))
    count = len(places)
    return FramePoints(
        u=direction_to_unit(ra, CENTRE[1] + places[:, 1] / 3600.0),
        t_utc_ns=np.full(count, T0 + round(k * cadence_s * NS_PER_S)),
        x_px=places[:, 0],
        y_px=places[:, 1],
        snr=np.full(count, 20.0),
        sigma_arcsec=0.7,
        fwhm_arcsec=4.0,
        exposure_s=0.1,
        centre=direction_to_unit(*CENTRE),
        area_arcsec2=1700.0**2,
    )


def field(
    frames: int, movers: list[tuple[float, float, float, float]], seed: int, seen: float = 1.0
) -> list[FramePoints]:
    """Sixty stars, some of which flicker; movers by place and rate; two strangers a frame."""
    rng = np.random.default_rng(seed)
    stars = rng.uniform(-800.0, 800.0, (60, 2))
    found = []
    for k in range(frames):
        there = stars[rng.random(60) < 0.85]
        moving = [
            [x + vx * 5.0 * k, y + vy * 5.0 * k] for x, y, vx, vy in movers if rng.random() < seen
        ]
        strange = rng.uniform(-800.0, 800.0, (2, 2))
        places = np.concatenate([np.reshape(moving, (-1, 2)), there, strange])
        found.append(frame(k, places + rng.normal(0.0, 0.5, places.shape)))
    return found


def test_what_moves_is_found_with_its_rate_and_angle_and_stars_are_not():
    (mover,) = find_movers(field(7, [(-400.0, -300.0, 20.0, 10.0)], 1))
    assert len(mover.points) == 7
    assert mover.rate_arcsec_s == pytest.approx(math.hypot(20.0, 10.0), abs=0.05)
    assert mover.position_angle_deg == pytest.approx(math.degrees(math.atan2(20.0, 10.0)), abs=0.2)
    assert mover.span_s == pytest.approx(30.0)


def test_two_that_cross_are_two_and_a_point_belongs_to_one():
    movers = find_movers(field(7, [(-400.0, 0.0, 25.0, 0.0), (0.0, -380.0, 0.0, 24.0)], 2))
    assert len(movers) == 2
    points = [point for each in movers for point in each.points]
    assert len(points) == len(set(points))


def test_one_that_two_frames_miss_is_found_in_the_others():
    found = field(7, [(-400.0, -300.0, 20.0, 10.0)], 3)
    for k in (2, 4):
        found[k] = replace(
            found[k], u=found[k].u[1:], t_utc_ns=found[k].t_utc_ns[1:], snr=found[k].snr[1:]
        )
    (mover,) = find_movers(found)
    assert [n for n, _ in mover.points] == [0, 1, 3, 5, 6]


@pytest.mark.parametrize("seed", range(8))
def test_chance_makes_none(seed):
    assert find_movers(field(5, [], 20 + seed)) == ()


def test_two_frames_have_no_movers():
    assert find_movers(field(2, [(-400.0, -300.0, 20.0, 10.0)], 1)) == ()
    assert find_movers([]) == ()


def test_a_long_series_is_linked_in_windows():
    movers = find_movers(field(12, [(-700.0, -500.0, 18.0, 9.0)], 4))
    assert sum(len(each.points) for each in movers) >= 11


@pytest.mark.shared_data
@pytest.mark.skipif(not MODRA.is_dir(), reason=f"{MODRA} is not here")
def test_navstar_48_is_found_as_what_moves_and_is_no_star():
    """Real frames of 0.1 s; places as the observatory published them."""
    published = [
        (parse_ra_deg(" ".join(words[4:7])), parse_dec_deg(" ".join(words[7:10])))
        for line in (MODRA / "00040A_R_4.mpec").read_text().splitlines()
        if line.startswith("     00040A") and (words := line.split())
    ]
    frames = []
    for number, path in enumerate(sorted(Path(MODRA).glob("00040A_R_4-00?.fit")), start=1):
        taken = read_frame(path, number)
        stars = find_stars(taken.pixels, max_stars=1500, saturation_adu=taken.saturation_adu)
        plate = FieldPlateFinder(None, "", "header").solve(taken, stars)
        assert isinstance(plate, Solution)
        assert taken.t_mid_utc_ns is not None
        frames.append(frame_points(stars, plate, taken.t_mid_utc_ns, taken, (), Config()))
    assert len(frames) == len(published) == 7
    (mover,) = find_movers(frames)
    assert len(mover.points) >= 6
    two_arcsec = 2.0 / 3600.0
    for place, n in mover.points:
        ra, dec = (float(x) for x in unit_to_direction(frames[place].u[n]))
        assert separation_deg(ra, dec, *published[place]) < two_arcsec
    assert mover.rate_arcsec_s == pytest.approx(36.0, abs=0.3)
