"""Stars are taken where they are on the day of the frame: by astropy, by frames of 2017."""

import numpy as np
import pytest

from models.star_catalogue import Rows, catalogue_of, matched, read_rows
from rsoconsole.base import SolverError
from rsoconsole.records import FloatArray
from rsoconsole.simulator.sky.star_background import star_positions_at
from rsoconsole.sky import (
    StarCatalogue,
    Stars,
    apply_proper_motion,
    describe_field,
    iso_to_utc_ns,
    julian_year,
    separation_deg,
    wcs_from_cards,
)
from rsoconsole.vision import PlateFit, field_radius_deg, refit
from tests.drawn.plate_fields import SHARED, star_rows

MAS_DEG = 1 / 3.6e6
NOW_NS = iso_to_utc_ns("2026-09-12T04:05:05Z")
MODRA = SHARED / "field" / "modra"


def test_a_utc_instant_is_the_julian_year_that_astropy_makes_of_it():
    from astropy.time import Time

    one_minute_years = 60 / (365.25 * 86400)
    for text in ("1991-04-02T13:30:00", "2000-01-01T12:00:00", "2026-09-12T04:05:05"):
        theirs = Time(text, scale="utc").tt.jyear
        assert julian_year(iso_to_utc_ns(text)) == pytest.approx(theirs, abs=1.2 * one_minute_years)


@pytest.mark.parametrize("years", [-8.75, 26.7])
def test_motion_is_that_of_astropy_to_a_hundredth_of_a_milliarcsecond(years):
    import astropy.units as u
    from astropy.coordinates import Distance, SkyCoord
    from astropy.time import Time

    rng = np.random.default_rng(2)
    ra = rng.uniform(0, 360, 200)
    dec = np.concatenate([rng.uniform(-88, 88, 198), [89.9, -89.9]])
    pm_ra, pm_dec = rng.normal(0, 1000.0, (2, 200))
    ours = apply_proper_motion(ra, dec, pm_ra, pm_dec, years)
    epoch = Time(2000.0, format="jyear", scale="tt")
    theirs = SkyCoord(
        ra * u.deg,
        dec * u.deg,
        pm_ra_cosdec=pm_ra * u.mas / u.yr,
        pm_dec=pm_dec * u.mas / u.yr,
        distance=Distance(100 * u.pc),
        obstime=epoch,
    ).apply_space_motion(new_obstime=epoch + years * 365.25 * u.day)
    off = separation_deg(*ours, theirs.ra.deg, theirs.dec.deg)
    assert np.max(off) < 0.01 * MAS_DEG
    assert np.median(separation_deg(ra, dec, *ours)) > 5000 * MAS_DEG


def test_the_fastest_star_of_the_sky_moves_along_the_belt():
    """Barnard's star: 10.4 arcsec a year; Gaia DR3 has its place at J2016.0."""
    ra_2016, dec_2016 = 269.448502525, 4.739420051
    stars = StarCatalogue.load()
    there = stars.cone(ra_2016, dec_2016, 3 / 3600, epoch_jyear=2016.0)
    assert len(there) == 1
    assert there.pm_dec_mas_yr[0] == pytest.approx(10362, rel=0.01)
    assert len(stars.cone(ra_2016, dec_2016, 100 / 3600)) == 0


def test_a_cone_at_an_epoch_finds_what_moves_into_it_and_leaves_out_what_moves_away():
    stars = StarCatalogue.load()
    years = 26.7
    every = apply_proper_motion(
        stars.ra_icrs_deg,
        stars.dec_icrs_deg,
        stars.pm_ra_mas_yr.astype(float),
        stars.pm_dec_mas_yr.astype(float),
        years,
    )
    exchanged = 0
    for ra, dec in ((0.05, -5.0), (269.45, 5.03), (180.0, 10.5), (40.0, 2.0)):
        found = stars.cone(ra, dec, 0.3, epoch_jyear=2000.0 + years)
        is_inside = np.asarray(separation_deg(ra, dec, *every)) <= 0.3
        assert np.array_equal(np.sort(found.dec_icrs_deg), np.sort(every[1][is_inside]))
        before = separation_deg(ra, dec, stars.ra_icrs_deg, stars.dec_icrs_deg) <= 0.3
        exchanged += int(np.sum(before != is_inside))
    assert exchanged > 0


def test_the_whole_sky_holds_the_belt_and_the_rest_in_order():
    belt, sky = StarCatalogue.load(), StarCatalogue.load_whole_sky()
    assert len(sky) == 1_871_010
    assert np.all(np.diff(sky.dec_counts) >= 0)
    assert sky.covers(89.0, 2.0)
    ours, theirs = (each.cone(150.0, 5.0, 1.0, epoch_jyear=2026.0) for each in (belt, sky))
    assert np.array_equal(ours.ra_icrs_deg, theirs.ra_icrs_deg)


def test_the_simulated_sky_and_the_reduction_agree_where_a_star_is():
    """The simulator moves stars by SOFA; the reduction by its own vectors."""
    at_j2000 = StarCatalogue.load().cone(269.45, 4.7, 2.0)
    now = apply_proper_motion(
        at_j2000.ra_icrs_deg,
        at_j2000.dec_icrs_deg,
        at_j2000.pm_ra_mas_yr,
        at_j2000.pm_dec_mas_yr,
        julian_year(NOW_NS) - 2000.0,
    )
    off = separation_deg(*star_positions_at(at_j2000, NOW_NS), *now)
    assert np.max(off) < 0.1 * MAS_DEG
    # Barnard's star is among them.
    assert np.max(separation_deg(*now, at_j2000.ra_icrs_deg, at_j2000.dec_icrs_deg)) > 200 / 3600


def modra_fit(name: str, epoch_jyear: float) -> tuple[PlateFit, float]:
    """The plate of a real frame against the stars of one epoch; the epoch of the frame."""
    if not MODRA.is_dir():
        pytest.skip(f"{MODRA} is absent: the independent test data are not beside the project")
    from astropy.io import fits

    with fits.open(MODRA / name) as hdus:
        pixels, header = np.asarray(hdus[0].data), dict(hdus[0].header)
    height, width = pixels.shape
    start = wcs_from_cards(header)
    field = describe_field(start, width, height)
    stars = StarCatalogue.load_whole_sky().cone(
        field.ra_icrs_deg,
        field.dec_icrs_deg,
        field_radius_deg(start, width, height),
        epoch_jyear=epoch_jyear,
    )
    places = np.stack([stars.ra_icrs_deg, stars.dec_icrs_deg], axis=1)
    fit = refit(star_rows(pixels)[:, :2], places, start, width_px=width, height_px=height)
    assert fit is not None
    return fit, julian_year(iso_to_utc_ns(header["DATE-OBS"]))


@pytest.mark.shared_data
@pytest.mark.parametrize("name", [f"PR25_R_7s-{n}.fit" for n in ("009", "022", "034", "053")])
def test_the_stars_of_a_frame_of_2017_stand_where_2017_has_them(name):
    """Modra, seven seconds, 16 stars: the residuals themselves tell the year."""
    _, taken = modra_fit(name, 2000.0)
    years = np.arange(taken - 20.0, taken + 16.0, 4.0)
    rms = np.array([modra_fit(name, each)[0].rms_arcsec for each in years])
    at_j2000, at_frame = (modra_fit(name, each)[0] for each in (2000.0, taken))
    assert at_frame.matched == at_j2000.matched == 16
    assert at_frame.rms_arcsec < 0.82 * at_j2000.rms_arcsec
    curve = np.polynomial.Polynomial.fit(years - taken, rms**2, 2).convert().coef
    six_years = 6.0
    assert abs(-curve[1] / (2 * curve[2])) < six_years


def row_of(start: str, width: int, at_byte: int, photometry: str) -> bytes:
    """A row with its photometry from a byte (1-based) on."""
    return (start.ljust(at_byte - 1) + photometry).ljust(width).encode("ascii")


FIRST_LINES = (
    "0001 00008 1| |  2.31750494|  2.23184345|  -16.3|   -9.0| 68| 73| 1.7| 1.8|1958.89|1951.94",
    "0001 00016 1|X|            |            |       |       |   |   |    |    |       |       ",
)
"""How rows of tyc2.dat begin; the second star has no mean place."""
PHOTOMETRY = ("12.146|0.158|12.146|0.223|", "12.528|0.262|      |     |")


def test_rows_of_the_catalogue_are_read_and_blanks_stay_blank(tmp_path):
    path = tmp_path / "tyc2.dat.00"
    lines = zip(FIRST_LINES, PHOTOMETRY, strict=True)
    path.write_bytes(b"".join(row_of(start, 207, 111, light) for start, light in lines))
    rows = read_rows(path, 207)
    assert [each[0] for each in rows[:4]] == [2.31750494, 2.23184345, -16.3, -9.0]
    assert [each[0] for each in rows[4:]] == [12.146, 12.146, 0.223]
    assert rows.bt_mag[1] == 12.528
    assert all(np.isnan(column[1]) for column in (*rows[:4], *rows[5:]))
    with pytest.raises(SolverError, match="rows have 123 bytes"):
        read_rows(path, 123)


def test_rows_of_the_supplement_have_their_magnitudes_elsewhere(tmp_path):
    path = tmp_path / "suppl_1.dat"
    start = "0002 01107 1|T|  1.50000000|  2.50000000|  -16.3|   -9.0"
    path.write_bytes(row_of(start, 123, 84, "12.360|0.291|11.502|0.277|"))
    rows = read_rows(path, 123)
    assert [each[0] for each in rows[:2]] == [1.5, 2.5]
    assert [each[0] for each in rows[4:]] == [12.360, 11.502, 0.277]


def rows_of(ra: FloatArray, vt_mag: FloatArray, colour_mag: FloatArray) -> Rows:
    motions = (np.array([5.0, np.nan]), np.array([-7.0, np.nan]))
    return Rows(ra, np.zeros(2), *motions, vt_mag + colour_mag, vt_mag, np.array([0.1, 0.2]))


def test_an_index_entry_that_is_no_star_is_left_out():
    rows = rows_of(np.array([10.0, 20.0]), np.array([9.0, 11.0]), np.array([0.5, np.nan]))
    in_single_precision = np.array([10.00001, 0.0, 20.0])
    chosen = (in_single_precision, np.zeros(3), np.array([9.0, 10.0, 11.0]))
    stars = matched(chosen, (rows, rows))
    assert stars.ra_icrs_deg.tolist() == [10.0, 20.0]
    assert stars.magnitude.tolist() == [9.0, 11.0]
    assert stars.pm_ra_mas_yr.tolist() == [5.0, 0.0]
    assert stars.colour_mag == pytest.approx([0.5, np.nan], nan_ok=True)
    assert stars.sigma_mag.tolist() == [0.1, 0.2]


def test_components_at_one_place_have_their_own_colours():
    rows = rows_of(np.array([10.0, 10.0]), np.array([9.0, 11.0]), np.array([0.5, 1.5]))
    chosen = (np.full(3, 10.0), np.zeros(3), np.array([11.0, 9.0, 10.0]))
    stars = matched(chosen, (rows, rows))
    assert stars.colour_mag == pytest.approx([1.5, 0.5, np.nan], nan_ok=True)
    assert stars.sigma_mag == pytest.approx([0.2, 0.1, np.nan], nan_ok=True)


def test_a_plate_refers_to_the_day_of_its_frame():
    """A field whose stars all move alike: its plate follows them by the frame's date alone."""
    from tests.drawn.plate_fields import SIZE, belt_plate, belt_stars

    wcs = belt_plate(40.0, 2.0)
    rows = belt_stars(wcs, false_stars=0)
    real = StarCatalogue.load().cone(40.0, 2.0, 1.1)
    drift = np.full(len(real), 1000.0)
    drifting = Stars.without_colour(
        real.ra_icrs_deg, real.dec_icrs_deg, real.magnitude, drift, -drift
    )
    then = catalogue_of(drifting).cone(40.0, 2.0, 1.2, epoch_jyear=julian_year(NOW_NS))
    places = np.stack([then.ra_icrs_deg, then.dec_icrs_deg], axis=1)
    fit = refit(rows[:, :2], places, wcs, **SIZE)
    assert fit is not None
    years = julian_year(NOW_NS) - 2000.0
    half_arcsec = 0.5 / 3600
    assert fit.wcs.crval_dec_deg - 2.0 == pytest.approx(-years / 3600, abs=half_arcsec)
    assert (fit.wcs.crval_ra_deg - 40.0) * np.cos(np.radians(2.0)) == pytest.approx(
        years / 3600, abs=half_arcsec
    )
