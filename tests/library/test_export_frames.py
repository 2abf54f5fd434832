"""Solved frames as FITS and regions for DS9: pixels, plates, and places as they were recorded."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS

from rsoconsole.base import ExportError
from rsoconsole.instruments import read_frame
from rsoconsole.library import ExportOptions, export, parse_numbers
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.solved_fits import SIGMAS, frames_on_record, to_regions
from rsoconsole.records import Frame
from rsoconsole.sky import pixel_to_sky, wcs_from_cards, wrap_180
from rsoconsole.tracking import sky_covariance_arcsec2
from tests.nights.export_nights import HEIGHT_PX, NS, T0, WIDTH_PX, plate, taken, written_night
from tests.nights.samples import SAMPLE

KEPT = {3: np.uint16, 5: np.uint16, 6: np.float32}
WRONG_PLATE = {
    "CTYPE1": "RA---TAN",
    "CTYPE2": "DEC--TAN",
    "CRVAL1": 1.0,
    "CRVAL2": 2.0,
    "CROTA2": 30.0,
    "CRPIX1": 5.0,
    "CRPIX2": 6.0,
    "CDELT1": 0.1,
    "CDELT2": 0.1,
    "EQUINOX": 2000.0,
    "PC1_1": 1.0,
    "RADESYS": "FK5",
    "LONPOLE": 170.0,
}
A_THOUSANDTH_PX = 1e-3
# wcslib notes where it works out latitude and longitude from OBSGEO-X, Y, Z.
pytestmark = pytest.mark.filterwarnings("ignore:'obsfix' made the change")


def pixels(frame_id: int) -> Any:
    random = np.random.default_rng(frame_id)
    noise = random.normal(1000.0, 30.0, (HEIGHT_PX, WIDTH_PX))
    # 12 bits in 16: the session's files hold them without the four that are empty.
    return (noise.astype(np.uint16) << 4) if KEPT[frame_id] is np.uint16 else noise.astype("f4")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    writer = written_night(tmp_path_factory.mktemp("night") / "frames")
    for frame_id in KEPT:
        shot = taken(frame_id)
        header = {"EXPTIME": 10.0, "OBJECT": "nobody knows", **WRONG_PLATE}
        frame = Frame(
            frame_id=frame_id,
            name=shot.name,
            pixels=pixels(frame_id),
            t_start_utc_ns=shot.t_start_utc_ns,
            exposure_s=10.0,
            header=header,
        )
        assert writer.save_frame(frame)
    writer.close()
    return writer.folder


@pytest.fixture(scope="module")
def exported(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "frames"
    made = export(session, "fits", out)
    assert [path.name for path in made.files] == [f"{n:06d}.fits.fz" for n in KEPT]
    assert made.left_out == {"pixels not kept": 11}
    return out


@pytest.mark.parametrize("frame_id", KEPT)
def test_pixels_are_the_cameras_to_the_last_bit(frame_id, exported: Path):
    path = exported / f"{frame_id:06d}.fits.fz"
    with fits.open(path) as hdus:
        assert np.array_equal(hdus[1].data, pixels(frame_id))
        assert hdus[1].header["OBJECT"] == "nobody knows"
    assert np.array_equal(read_frame(path, frame_id).pixels, pixels(frame_id))


@pytest.mark.parametrize("frame_id", KEPT)
def test_astropy_finds_every_star_where_the_plate_has_it(frame_id, exported: Path):
    wcs = plate(frame_id).wcs
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, WIDTH_PX - 1, 9), np.linspace(0, 239, 7)))
    ra, dec = pixel_to_sky(wcs, x, y)
    with fits.open(exported / f"{frame_id:06d}.fits.fz") as hdus:
        header = hdus[1].header
        theirs = WCS(header)
    back = theirs.all_world2pix(np.column_stack([ra, dec]), 0, tolerance=1e-6)
    assert np.hypot(back[:, 0] - x, back[:, 1] - y).max() < A_THOUSANDTH_PX
    assert theirs.wcs.radesys == "ICRS"
    ours = wcs_from_cards(header)
    assert ours.cd == pytest.approx(wcs.cd, rel=1e-14)  # a card holds 15 digits
    assert set(ours.sip_a) == set(wcs.sip_a)
    assert set(ours.sip_b) == set(wcs.sip_b)


def test_nothing_is_left_of_the_drivers_own_plate(exported: Path):
    with fits.open(exported / "000003.fits.fz") as hdus:
        header = hdus[1].header
    left = {"CROTA2", "CDELT1", "CDELT2", "EQUINOX", "PC1_1", "LONPOLE"} & set(header)
    assert left == set()
    assert header["CTYPE1"] == "RA---TAN-SIP"
    assert list(header).count("CRVAL1") == 1


def test_times_are_the_shutters(exported: Path):
    from astropy.time import Time

    with fits.open(exported / "000005.fits.fz") as hdus:
        header = hdus[1].header
    mid = Time((T0 + 150 * NS) / 1e9, format="unix", scale="utc")
    assert header["TIMESYS"] == "UTC"
    # A double holds a day of this century to a microsecond.
    assert abs(header["MJD-AVG"] - mid.mjd) * 86_400.0 < 2e-6
    assert abs((Time(header["DATE-AVG"], scale="utc") - mid).sec) < 1e-6
    assert (Time(header["DATE-END"]) - Time(header["DATE-BEG"])).sec == pytest.approx(10.0)
    assert header["XPOSURE"] == header["EXPTIME"] == 10.0


def test_the_streaks_stand_in_a_table_behind_the_image(session: Path, exported: Path):
    rows = [row for row in read_exported_night(session).rows if row.frame_id == 5]
    with fits.open(exported / "000005.fits.fz", checksum=True) as hdus:
        table, header = hdus["STREAKS"].data, hdus["STREAKS"].header
        assert len(table) == len(rows) == 2
        for record, row in zip(table, rows, strict=True):
            assert record["RA_ICRS"] == row.ra_icrs_deg
            assert record["X_PX"] == row.x_px
            assert record["SIG_RA"] == row.sigma_ra_arcsec
            assert record["TAKEN"] == row.is_taken
            assert record["SOURCE"] == "network"
        assert header["PRED_DEC"] == rows[0].predicted_dec_icrs_deg
        assert header["TUNIT3"] == "deg"


def test_the_sample_is_exported_with_its_streak_on_its_pixels(tmp_path: Path):
    made = export(SAMPLE, "fits", tmp_path / "out")
    path, _ = made.files
    with fits.open(path) as ours, fits.open(SAMPLE / "frames" / "000009.fits.fz") as theirs:
        assert np.array_equal(ours[1].data, theirs[1].data)
        streak = ours["STREAKS"].data[0]
        x, y = WCS(ours[1].header).all_world2pix(streak["RA_ICRS"], streak["DEC_ICRS"], 0)
    assert math.hypot(float(x) - streak["X_PX"], float(y) - streak["Y_PX"]) < A_THOUSANDTH_PX


@pytest.mark.parametrize(
    ("frames", "says"),
    [((4,), "frame 4 was not kept"), ((3, 99), "no frame 99; it has 1 to 14")],
)
def test_a_frame_that_cannot_be_exported_says_why(frames, says, session: Path, tmp_path: Path):
    with pytest.raises(ExportError, match=says):
        export(session, "fits", tmp_path / "out", ExportOptions(frames=frames))


def test_a_damaged_frame_is_named_and_nothing_is_left_behind(session: Path, tmp_path: Path):
    frames = frames_on_record(session, ())
    broken = tmp_path / "000003.fits.fz"
    broken.write_bytes(frames[3].file.read_bytes()[:3000])
    from rsoconsole.config import Config
    from rsoconsole.library.formats.solved_fits import solved_fits

    with pytest.raises(ExportError, match="frame 3 cannot be read"):
        solved_fits(replace(frames[3], file=broken), Config())
    with pytest.raises(ExportError, match="no plate solution"):
        solved_fits(replace(frames[3], solution=None), Config())


@pytest.mark.parametrize(
    ("text", "numbers"), [("3", (3,)), ("3,9-12", (3, 9, 10, 11, 12)), ("9-9, 3,3", (3, 9))]
)
def test_frames_are_named_as_pages_are(text, numbers):
    assert parse_numbers(text) == numbers


@pytest.mark.parametrize("text", ["", "x", "3-", "-3", "9-3", "1.5", "1-99999999", "²"])
def test_what_is_no_range_of_frames_is_refused(text):
    with pytest.raises(ValueError, match="frame"):
        parse_numbers(text)


PLACE = r"(?P<ra>\d+\.\d+),(?P<dec>[+-]\d+\.\d+)"
TEXT = r" text=\{[^{}\n]*\}"
GRAMMAR = {
    "line": rf"line\({PLACE},(?P<ra_b>\d+\.\d+),(?P<dec_b>[+-]\d+\.\d+)\) # line=0 0"
    rf" color=\w+{TEXT}",
    "circle": rf'circle\({PLACE},(?P<radius>\d+\.\d+)"\) # color=\w+',
    "point": rf"point\({PLACE}\) # point=cross color=\w+",
    "ellipse": rf'ellipse\({PLACE},(?P<a>\d+\.\d+)",(?P<b>\d+\.\d+)",(?P<angle>\d+\.\d+)\)'
    rf" # color=\w+ dash=1{TEXT}",
}
"""Lines of a DS9 region file that are used here: shape, sizes in arcsec, properties behind #."""


def shapes(text: str) -> list[tuple[str, dict[str, float]]]:
    """Strictly by the grammar; whatever else is there fails."""
    head, settings, frame, *lines = text.splitlines()
    assert head == "# Region file format: DS9 version 4.1"
    assert re.fullmatch(r'global(?: \w+=(?:\w+|"[^"]*"))+', settings)
    assert frame == "icrs"
    assert text.isascii()
    found = []
    for line in lines:
        matches = {name: re.fullmatch(pattern, line) for name, pattern in GRAMMAR.items()}
        (name, match) = next((n, m) for n, m in matches.items() if m)
        values = {key: float(value) for key, value in match.groupdict().items()}
        assert 0.0 <= values["ra"] < 360.0
        assert -90.0 <= values["dec"] <= 90.0
        found.append((name, values))
    return found


def test_regions_stand_where_the_night_has_them(session: Path, tmp_path: Path):
    made = export(session, "regions", tmp_path, ExportOptions(frames=(5,)))
    found = shapes(made.files[0].read_text())
    rows = [row for row in read_exported_night(session).rows if row.frame_id == 5]
    assert [name for name, _ in found] == 2 * ["line", "circle", "circle", "point"] + ["ellipse"]
    for row, values in zip(rows, [v for n, v in found if n == "point"], strict=True):
        assert values["ra"] == pytest.approx(row.ra_icrs_deg, abs=1e-8)
        assert values["dec"] == pytest.approx(row.dec_icrs_deg, abs=1e-8)
    ends = next(v for n, v in found if n == "line")
    assert ends["ra"] == pytest.approx(rows[0].ra_a_icrs_deg, abs=1e-8)
    assert ends["dec_b"] == pytest.approx(rows[0].dec_b_icrs_deg, abs=1e-8)
    assert "color=red text={0.85 taken}" in made.files[0].read_text()
    assert "color=yellow" in made.files[0].read_text()


def test_the_ellipse_is_three_sigma_of_the_prediction(session: Path):
    night = read_exported_night(session)
    frame = frames_on_record(session, night.rows)[5]
    tilted = list(map(list, frame.predicted.P))
    tilted[0][0], tilted[2][2] = (4 / 3600) ** 2, (2 / 3600) ** 2
    tilted[0][2] = tilted[2][0] = 0.7 * (4 / 3600) * (2 / 3600)
    state = replace(frame.predicted, P=tuple(map(tuple, tilted)))
    (_, values) = shapes(to_regions(replace(frame, predicted=state)))[-1]
    assert values["a"] > values["b"]
    inverse = np.linalg.inv(sky_covariance_arcsec2(state))
    for turn in np.linspace(0.0, 2 * math.pi, 24):
        along, across = values["a"] * math.cos(turn), values["b"] * math.sin(turn)
        angle = math.radians(values["angle"])
        # With north up and east left, x to the right is west; the angle turns x towards north.
        west = along * math.cos(angle) - across * math.sin(angle)
        north = along * math.sin(angle) + across * math.cos(angle)
        point = np.array([-west, north])
        assert point @ inverse @ point == pytest.approx(SIGMAS**2, rel=1e-2)
    assert abs(wrap_180(values["ra"] - state.x[0])) < 1e-8


def test_the_package_regions_reads_what_is_written(session: Path, tmp_path: Path):
    from regions import Regions

    made = export(session, "regions", tmp_path)
    read = [Regions.read(path, format="ds9") for path in made.files]
    assert sum(len(each) for each in read) >= made.measurements > 0


def test_every_frame_has_its_regions_and_braces_in_words_break_nothing(session: Path, tmp_path):
    made = export(session, "regions", tmp_path)
    assert len(made.files) == 14
    for path in made.files:
        shapes(path.read_text())
    night = read_exported_night(session)
    frame = frames_on_record(session, night.rows)[5]
    frame.rows[1] = replace(frame.rows[1], not_taken_because="a {b}\n} # c é")
    shapes(to_regions(frame))
