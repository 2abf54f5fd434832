"""``rso.detect`` and ``rso.solve``: frames of every make give what the verbs say, with units."""

import copy
import gzip
import inspect
import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.nddata import CCDData
from astropy.table import QTable
from typer.testing import CliRunner

import rsoconsole as rso
from rsoconsole.base import ConfigError, FrameError, InputError, NotSolvedError
from rsoconsole.cli.app import app
from tests.drawn.plate_fields import SHARED
from tests.nights.samples import SAMPLE

FRAME = SAMPLE / "frames" / "000009.fits.fz"
"""1760 x 2328, 2.5 arcsec/px: one streak."""
HALF_AN_ARCSEC = 0.5
needs_shared = pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    with fits.open(FRAME) as hdus:
        return hdus[1].data.astype(np.uint16)


@pytest.fixture(scope="module")
def header() -> fits.Header:
    return fits.getheader(FRAME, 1)


@pytest.fixture(scope="module")
def found() -> QTable:
    return rso.detect(FRAME)


def test_the_table_is_what_the_verb_says(found):
    run = CliRunner().invoke(app, ["detect", str(FRAME), "--json"])
    said = json.loads(run.stdout)
    assert len(found) == len(said["detections"]) == 1
    for column, key in (
        *(("x_px", "x"), ("y_px", "y"), ("x_a_px", "x_a"), ("y_b_px", "y_b"), ("snr", "snr")),
        *(("length_px", "length"), ("width_px", "width"), ("confidence", "confidence")),
    ):
        assert float(u.Quantity(found[column][0]).value) == said["detections"][0][key]
    assert found["object_class"][0] == said["detections"][0]["class"]
    assert found["kind"][0] == said["detections"][0]["kind"]
    assert found["frame"][0] == FRAME.name
    assert found.meta["frames"] == [FRAME.name]


def test_columns_have_units_and_survive_ecsv(found, tmp_path):
    assert found["x_px"].unit == u.pix
    assert found["sigma_angle_deg"].unit == u.deg
    found.write(tmp_path / "found.ecsv")
    again = QTable.read(tmp_path / "found.ecsv")
    assert again.colnames == found.colnames
    assert again["x_px"][0] == found["x_px"][0]
    assert again.meta == found.meta


@pytest.mark.nightly("whole frames")
def test_frames_of_every_make_give_the_same_streak(found, pixels, header, tmp_path):
    zipped = tmp_path / "frame.fits.gz"
    some = fits.Header({key: header[key] for key in ("EXPTIME", "FOCALLEN", "XPIXSZ")})
    hdu = fits.PrimaryHDU(pixels, header=some)
    hdu.writeto(tmp_path / "plain.fits")
    zipped.write_bytes(gzip.compress((tmp_path / "plain.fits").read_bytes(), 1))
    cv2.imwrite(str(tmp_path / "frame.png"), pixels)
    cv2.imwrite(str(tmp_path / "frame.tiff"), pixels)
    before = pixels.copy()
    ccd = CCDData(pixels.astype(np.float64), unit="adu", header=header)
    made = [
        *(str(zipped), tmp_path / "frame.png", tmp_path / "frame.tiff"),
        *(pixels, pixels.astype(np.float32), pixels.astype(">u2"), pixels.astype(np.int32)),
        *(hdu, fits.ImageHDU(pixels), fits.CompImageHDU(pixels), fits.HDUList([hdu]), ccd),
    ]
    table = rso.detect(made)
    assert list(table["frame_id"]) == list(range(1, len(made) + 1))
    for name in ("x_px", "y_px", "length_px"):
        assert np.ptp(table[name].value) < 0.02, name
        assert abs(table[name][0] - found[name][0]) < 0.02 * u.pix
    assert np.array_equal(pixels, before)  # what was given stays as it is


def test_frames_without_a_streak_are_named_all_the_same(pixels):
    rng = np.random.default_rng(1)
    empty = rng.normal(1000.0, 10.0, (480, 640)).astype(np.float32)
    table = rso.detect([empty, pixels])
    assert list(table["frame_id"]) == [2]
    assert table.meta["frames"] == ["array 1", "array 2"]
    nothing = rso.detect(empty)
    assert len(nothing) == 0
    assert nothing["x_px"].unit == u.pix


def test_eight_bits_are_noted(pixels):
    small = np.clip((pixels.astype(int) - 100) // 16, 0, 255).astype(np.uint8)
    assert any("8 bits a pixel" in note for note in rso.detect(small).meta["notes"])


def test_what_a_ccddatas_mask_covers_is_filled(found, pixels, header):
    mask = np.zeros(pixels.shape, bool)
    mask[100:140, 200:260] = True
    spoilt = pixels.astype(np.float32)
    spoilt[mask] = 60_000.0
    masked = np.ma.MaskedArray(spoilt, mask)
    table = rso.detect([CCDData(spoilt, unit="adu", header=header, mask=mask), masked])
    assert len(table) == 2
    assert np.all(abs(table["x_px"] - found["x_px"][0]) < 0.05 * u.pix)
    assert sum(f"{mask.sum()} of" in note for note in table.meta["notes"]) == 2


@pytest.mark.parametrize(
    ("frames", "error", "words"),
    [
        ([], InputError, "no frames: the list is empty"),
        (np.zeros((3, 100, 100)), FrameError, r"has 3 axes \(3 x 100 x 100\): a frame is"),
        (np.zeros(100), FrameError, "has 1 axes"),
        (np.zeros((100, 100), complex), FrameError, "holds complex128 pixels"),
        (np.zeros((100, 100), "M8[s]"), FrameError, r"holds datetime64\[s\] pixels"),
        (np.zeros((100, 100), bool), FrameError, "holds bool pixels"),
        (np.full((100, 100), np.nan), FrameError, "NaN or infinite values in 10000 of 10000"),
        (np.zeros((20, 100)), FrameError, "at least 64 x 64"),
        ("nowhere.fits", FrameError, "nowhere.fits does not exist"),
        (3, InputError, "int is no frame: give a path"),
        ([FRAME, 3], InputError, "frame 2 is a int"),
        (None, InputError, "NoneType is no frame"),
        (fits.PrimaryHDU(), FrameError, "holds no image"),
        (fits.ImageHDU(np.zeros((4, 80, 90), np.float32)), FrameError, "4 planes of 90 x 80"),
    ],
)
def test_what_is_no_frame_is_refused_in_one_line(frames, error, words):
    with pytest.raises(error, match=words) as caught:
        rso.detect(frames)
    assert "\n" not in str(caught.value)


def test_settings_that_cannot_be_are_refused(pixels):
    with pytest.raises(ConfigError, match=r"detector\.tau"):
        rso.detect(pixels, tau=3.0)
    with pytest.raises(InputError, match="exposure is in km: give it in s"):
        rso.detect(pixels, exposure=3 * u.km)
    with pytest.raises(InputError, match="exposure: -1 s must be above 0"):
        rso.detect(pixels, exposure=-1)
    with pytest.raises(InputError, match="only FITS files and HDU lists have several images"):
        rso.detect(pixels, extension="SCI")


# -- plates ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plate() -> "rso.PlateWCS":
    return rso.solve(FRAME)


def test_a_plate_is_the_one_on_record_and_that_of_the_verb(plate):
    run = CliRunner().invoke(app, ["solve", str(FRAME), "--json"])
    said = json.loads(run.stdout)
    assert plate.matched == said["matched"]
    assert plate.rms == said["rms_arcsec"] * u.arcsec
    # The engine solved this very frame in the night, from the frame before.
    night = rso.open_session(SAMPLE).solutions
    then = night[night["frame_id"] == 9]["direction"][0]
    assert plate.center.separation(then).arcsec < HALF_AN_ARCSEC
    assert plate.frame == FRAME.name
    assert plate.summary["scale_arcsec_px"] == plate.scale.to_value("arcsec/pix")


def test_a_plate_works_as_astropys(plate, pixels):
    height, width = pixels.shape
    assert plate.array_shape == (height, width)
    middle = plate.pixel_to_world((width - 1) / 2, (height - 1) / 2)
    assert middle.frame.name == "icrs"
    assert middle.separation(plate.center).arcsec < 1e-3
    scales = [each.to_value("arcsec") for each in plate.proj_plane_pixel_scales()]
    assert scales == pytest.approx([plate.scale.to_value("arcsec/pix")] * 2, rel=1e-3)
    for same in (copy.deepcopy(plate), pickle.loads(pickle.dumps(plate)), plate[10:, 20:]):
        assert same.matched == plate.matched
        assert same.rms == plate.rms


def test_pixels_alone_are_solved_with_hints_of_every_make(plate, pixels):
    near = SkyCoord(plate.center.ra + 0.2 * u.deg, plate.center.dec, frame="icrs")
    wide = {"radius": 1.5 * u.deg, "scale": (2.4, 2.6 * u.arcsec)}
    by_center = rso.solve(pixels, center=near.galactic, **wide)
    by_numbers = rso.solve(pixels, ra=near.ra.deg, dec=near.dec, **wide)
    for each in (by_center, by_numbers):
        assert each.center.separation(plate.center).arcsec < HALF_AN_ARCSEC
    listed = rso.solve([pixels], center=near, scale=2.5 * u.arcsec / u.pix)
    assert isinstance(listed, list)
    assert listed[0].center.separation(plate.center).arcsec < HALF_AN_ARCSEC


def test_a_wrong_hint_is_named(plate, pixels):
    found = rso.solve(pixels, center=plate.center, scale=(5.0, 5.2))
    assert any("scale" in words for words in found.wrong_hints)


def test_what_has_no_solution_says_why():
    empty = np.random.default_rng(2).normal(1000.0, 10.0, (480, 640))
    with pytest.raises(NotSolvedError, match=r"the array is not solved: .* stars") as caught:
        rso.solve(empty)
    assert caught.value.frame == "the array"
    assert "stars" in caught.value.reason


@pytest.mark.parametrize(
    ("hints", "words"),
    [
        ({"ra": 10.0}, "ra and dec go together"),
        ({"ra": 10 * u.km, "dec": 3.0}, "ra is in km: give it in deg"),
        ({"ra": 10.0, "dec": 100.0}, "no direction in degrees"),
        ({"center": SkyCoord(1 * u.deg, 1 * u.deg), "ra": 1, "dec": 1}, "not both"),
        ({"center": "m31"}, "center: 'm31' is no SkyCoord"),
        ({"radius": 0.0}, "radius: 0 deg must be above 0"),
        ({"scale": (2.6, 2.4)}, "the lowest, 2.6, is above the highest"),
        ({"scale": 2 * u.s}, "scale is in s: give it in arcsec"),
        ({"scale": -1}, "must be above 0"),
    ],
)
def test_hints_that_cannot_be_are_refused(hints, words, pixels):
    with pytest.raises(InputError, match=words):
        rso.solve(pixels, **hints)


@needs_shared
@pytest.mark.shared_data
def test_a_streak_of_a_real_frame_ends_where_the_eye_sees_its_ends():
    """ASTRiDE's long streak: (22, 338) to (340, 308), by eye."""
    table = rso.detect(SHARED / "real" / "astride_long.fits")
    assert len(table) == 1
    ends = sorted(
        (table[f"x_{end}_px"][0].value, table[f"y_{end}_px"][0].value) for end in ("a", "b")
    )
    three_px = 3.0
    assert np.hypot(*np.subtract(ends[0], (22, 338))) < three_px
    assert np.hypot(*np.subtract(ends[1], (340, 308))) < three_px


@needs_shared
@pytest.mark.shared_data
def test_real_frames_of_others_show_no_streak_and_stop_nothing():
    folder = SHARED / "real" / "cutouts"
    files = sorted(path for path in folder.iterdir() if ".fits" in path.name)
    assert files
    assert len(rso.detect(files)) == 0


# -- the front door ----------------------------------------------------------------------------


def test_the_package_lists_its_functions_and_each_says_what_it_takes():
    names = dir(rso)
    for name in ("detect", "solve", "measure", "track", "open_session", "PlateWCS"):
        assert name in names
        assert len(inspect.getdoc(getattr(rso, name)) or "") > 20
    for name in ("detect", "solve", "measure", "track"):
        function = getattr(rso, name)
        words = inspect.getdoc(function)
        assert "Returns" in words
        assert "Raises" in words
        assert ">>>" in words
        for parameter in inspect.signature(function).parameters:
            assert f"``{parameter}``" in words, f"{name} does not describe {parameter}"


def test_the_frame_is_in_the_repository():
    assert Path(FRAME).stat().st_size < 2_000_000
