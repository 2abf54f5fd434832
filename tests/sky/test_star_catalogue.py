"""The shipped stars are those of Tycho-2, and a query gives exactly those asked for."""

from pathlib import Path

import numpy as np
import pytest

from models.star_catalogue import catalogue_of, read_index, save
from rsoconsole.base import SolverError, resource_path
from rsoconsole.sky import (
    StarCatalogue,
    Stars,
    separation_deg,
)

INDEX_08 = Path("/usr/share/astrometry/index-tycho2-08.littleendian.fits")


@pytest.fixture(scope="module")
def catalogue():
    return StarCatalogue.load()


# SIMBAD, ICRS epoch 2000.
@pytest.mark.parametrize(
    ("name", "ra_deg", "dec_deg", "v_mag"),
    [
        ("Rigel", 78.634467, -8.201638, 0.13),
        ("Bellatrix", 81.282764, 6.349703, 1.64),
        ("Alnilam", 84.053389, -1.201919, 1.69),
        ("Spica", 201.298247, -11.161319, 0.97),
        ("Sadalmelik", 331.445983, -0.319849, 2.94),
    ],
)
def test_bright_stars_are_where_the_sky_has_them(catalogue, name, ra_deg, dec_deg, v_mag):
    fifty_mas_deg = 0.05 / 3600
    found = catalogue.cone(ra_deg, dec_deg, 10 / 3600)
    assert len(found) >= 1, name
    off = separation_deg(ra_deg, dec_deg, found.ra_icrs_deg[0], found.dec_icrs_deg[0])
    assert off < fifty_mas_deg
    assert found.magnitude[0] == pytest.approx(v_mag, abs=0.2)


def test_the_cut_holds_the_belt_and_says_where_it_ends(catalogue):
    assert len(catalogue) == 325_094
    assert np.abs(catalogue.dec_icrs_deg).max() <= 12.0
    assert catalogue.covers(-4.9, 1.1)
    assert not catalogue.covers(40.0)
    assert not catalogue.covers(11.5, 1.1)


def test_declinations_are_in_order(catalogue):
    assert np.all(np.diff(catalogue.dec_icrs_deg) >= 0)


@pytest.mark.parametrize(("ra", "dec"), [(0.05, -5.0), (359.9, 3.0), (180.0, 11.9), (280.0, -4.8)])
def test_a_cone_finds_what_a_scan_of_every_star_finds(catalogue, ra, dec):
    radius = 1.1
    found = catalogue.cone(ra, dec, radius)
    distance = separation_deg(ra, dec, catalogue.ra_icrs_deg, catalogue.dec_icrs_deg)
    scanned = np.sum(distance <= radius)
    assert len(found) == scanned > 10
    assert np.all(np.diff(found.magnitude) >= 0)


def test_a_cone_crosses_zero_hours(catalogue):
    found = catalogue.cone(0.0, 0.0, 0.5)
    assert np.any(found.ra_icrs_deg > 359.0)
    assert np.any(found.ra_icrs_deg < 1.0)


def test_outside_the_cut_there_is_nothing(catalogue):
    assert len(catalogue.cone(100.0, 60.0, 5.0)) == 0


def test_a_pole_can_be_asked_for():
    ra = np.arange(0.0, 360.0, 30.0)
    polar = catalogue_of(Stars.without_proper_motion(ra, np.full(12, 89.5), np.full(12, 8.0)))
    assert len(polar.cone(15.0, 89.9, 1.0)) == 12


def test_saving_keeps_positions_to_a_milliarcsecond(tmp_path):
    rng = np.random.default_rng(4)
    dec = np.sort(rng.uniform(-90, 90, 500))
    ra = np.append(rng.uniform(0, 360, 499), 360.0 - 1e-9)
    pm_ra, pm_dec = rng.uniform(-10_400, 10_400, (2, 500))
    magnitude = rng.uniform(0, 13, 500)
    colour, sigma = rng.uniform(-1, 4, 500), rng.uniform(0, 2, 500)
    colour[:40], sigma[20:60] = np.nan, np.nan
    original = catalogue_of(Stars(ra, dec, magnitude, pm_ra, pm_dec, colour, sigma))
    save(original, tmp_path / "stars.npz")
    again = StarCatalogue.load(tmp_path / "stars.npz")
    off = separation_deg(ra, dec, again.ra_icrs_deg, again.dec_icrs_deg)
    milliarcsec_deg = 1 / 3.6e6
    assert np.max(off) < milliarcsec_deg
    assert again.magnitude == pytest.approx(magnitude, abs=0.001)
    assert again.pm_ra_mas_yr == pytest.approx(pm_ra, abs=0.501)
    assert again.pm_dec_mas_yr == pytest.approx(pm_dec, abs=0.501)
    assert again.ra_icrs_deg.max() < 360.0
    assert again.colour_mag == pytest.approx(colour, abs=0.000_501, nan_ok=True)
    assert again.sigma_mag == pytest.approx(sigma, abs=0.005_01, nan_ok=True)


# Bright Star Catalogue, 5th ed. (Hoffleit and Warren 1991): V and B - V.
@pytest.mark.parametrize(
    ("name", "place_deg", "v_mag", "b_minus_v_mag"),
    [
        ("Sadalmelik", (331.445983, -0.319849), 2.96, 0.98),
        ("epsilon Eridani", (53.232685, -9.458263), 3.73, 0.88),
        ("Alphard", (141.896847, -8.658602), 1.98, 1.44),
        ("iota Piscium", (354.987672, 5.626291), 4.13, 0.51),
    ],
)
def test_johnson_magnitudes_are_those_of_the_bright_star_catalogue(
    catalogue, name, place_deg, v_mag, b_minus_v_mag
):
    of_linear_relations = 0.06
    star = catalogue.cone(*place_deg, 20 / 3600)
    # Hog et al. 2000: V = VT - 0.090 (BT - VT), B - V = 0.850 (BT - VT).
    v = star.magnitude - 0.090 * star.colour_mag
    assert v[0] == pytest.approx(v_mag, abs=of_linear_relations), name
    assert 0.850 * star.colour_mag[0] == pytest.approx(b_minus_v_mag, abs=of_linear_relations)


def test_colours_are_known_but_for_one_star_in_five_hundred(catalogue):
    assert np.mean(np.isnan(catalogue.colour_mag)) < 0.002
    bright = catalogue.magnitude < 9.0
    assert np.nanmedian(catalogue.sigma_mag[bright]) < 0.02
    assert 0.1 < np.nanmedian(catalogue.sigma_mag[catalogue.magnitude > 11.0]) < 0.2
    colours = catalogue.colour_mag[~np.isnan(catalogue.colour_mag)]
    assert 0.6 < np.median(colours) < 0.9


def test_stars_without_a_colour_say_that_it_is_unknown(catalogue):
    procyon = catalogue.cone(114.8255, 5.225, 20 / 3600)
    assert np.isnan(procyon.colour_mag[0])
    made_up = Stars.without_proper_motion(np.ones(2), np.ones(2), np.ones(2))
    assert np.all(np.isnan(made_up.colour_mag))
    assert np.all(np.isnan(catalogue_of(made_up).cone(1.0, 1.0, 1.0).sigma_mag))


def test_an_error_beyond_the_scale_stands_at_its_end():
    one = np.ones(1)
    kept = catalogue_of(Stars(one, one, one, one, one, one, 4.2 * one))
    assert kept.sigma_mag.tolist() == [pytest.approx(2.54)]


def test_the_notice_travels_with_the_stars():
    notice = resource_path("sky", "data", "COPYRIGHT.tycho2").read_text(encoding="utf-8")
    assert "Redistribution and use in source and binary forms" in notice
    assert "Hog" in notice


def test_a_file_that_is_no_catalogue_is_refused_with_its_name(tmp_path):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"not a catalogue")
    with pytest.raises(SolverError, match="broken"):
        StarCatalogue.load(broken)
    with pytest.raises(SolverError, match="no-index"):
        read_index(tmp_path / "no-index.fits")


@pytest.mark.skipif(not INDEX_08.exists(), reason=f"{INDEX_08} is not installed")
def test_another_index_of_the_series_gives_the_same_stars(catalogue):
    ra, dec, _ = read_index(INDEX_08)
    near = (np.abs(ra - 120.0) < 3.0) & (np.abs(dec) < 1.0)
    ours = catalogue.cone(120.0, 0.0, 3.3)
    shared = 0
    single_precision_deg = 0.06 / 3600
    for each_ra, each_dec in zip(ra[near], dec[near], strict=True):
        off = separation_deg(each_ra, each_dec, ours.ra_icrs_deg, ours.dec_icrs_deg)
        shared += bool(np.min(off) < single_precision_deg)
    # Each index thins crowded cells on a grid of its own.
    one_percent = 0.01
    assert shared >= (1 - one_percent) * np.sum(near) > 100
