"""Frames from disk: every kind that is promised, and a plain sentence for every broken one."""

import bz2
import contextlib
import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from rsoconsole.base import FrameError
from rsoconsole.instruments import frame_from_bytes, read_frame, read_frames
from rsoconsole.records import Frame
from rsoconsole.session import compress_frame

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def sky_pixels(height: int = 96, width: int = 128) -> np.ndarray:
    return np.random.default_rng(1).integers(700, 60000, (height, width)).astype(np.uint16)


def write_fits(path: Path, pixels: np.ndarray, **cards: object) -> Path:
    hdu = fits.PrimaryHDU(pixels)
    for key, value in cards.items():
        hdu.header[key.replace("_", "-")] = value
    hdu.writeto(path)
    return path


def test_unsigned_16_bit_fits_comes_back_bit_by_bit(tmp_path: Path) -> None:
    pixels = sky_pixels()
    frame = read_frame(write_fits(tmp_path / "a.fits", pixels), 7)
    assert frame.frame_id == 7
    assert frame.name == "a.fits"
    assert frame.pixels.dtype == np.uint16
    assert frame.pixels.dtype.isnative
    assert np.array_equal(frame.pixels, pixels)


@pytest.mark.parametrize("suffix", [".gz", ".bz2"])
def test_a_compressed_file_holds_the_same_frame(tmp_path: Path, suffix: str) -> None:
    plain = write_fits(tmp_path / "a.fits", sky_pixels()).read_bytes()
    packed = tmp_path / f"a.fits{suffix}"
    packed.write_bytes(gzip.compress(plain) if suffix == ".gz" else bz2.compress(plain))
    assert np.array_equal(read_frame(packed, 1).pixels, sky_pixels())


def test_fpack_holds_the_same_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.fits.fz"
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(sky_pixels())]).writeto(path)
    assert np.array_equal(read_frame(path, 1).pixels, sky_pixels())


def test_first_two_dimensional_image_is_taken_and_inherits_the_primary_header(
    tmp_path: Path,
) -> None:
    primary = fits.PrimaryHDU()
    primary.header["EXPTIME"] = 12.5
    table = fits.BinTableHDU.from_columns([fits.Column(name="q", format="J", array=[1, 2])])
    images = [fits.ImageHDU(sky_pixels()), fits.ImageHDU(sky_pixels(70, 70))]
    path = tmp_path / "multi.fits"
    fits.HDUList([primary, table, *images]).writeto(path)
    frame = read_frame(path, 1)
    assert (frame.width_px, frame.height_px) == (128, 96)
    assert frame.exposure_s == 12.5


def test_a_cube_of_one_plane_is_a_frame_and_of_three_is_not(tmp_path: Path) -> None:
    one = write_fits(tmp_path / "one.fits", sky_pixels()[None])
    assert read_frame(one, 1).pixels.shape == (96, 128)
    with pytest.raises(FrameError, match="3 planes"):
        read_frame(write_fits(tmp_path / "three.fits", np.stack([sky_pixels()] * 3)), 1)


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32, np.float64])
def test_negative_and_real_pixels_become_float32(tmp_path: Path, dtype: type) -> None:
    pixels = (sky_pixels().astype(np.int32) % 30000 - 400).astype(dtype)
    frame = read_frame(write_fits(tmp_path / "a.fits", pixels), 1)
    assert frame.pixels.dtype == np.float32
    assert np.array_equal(frame.pixels, pixels.astype(np.float32))


def test_header_gives_times_scale_and_pointing_in_our_units(tmp_path: Path) -> None:
    path = write_fits(
        tmp_path / "a.fits",
        sky_pixels(),
        DATE_OBS="2026-09-12T04:05:00.250",
        EXPTIME=10.0,
        FOCALLEN=620.0,
        XPIXSZ=3.8,
        OBJCTRA="21 22 20.68",
        OBJCTDEC="-00 49 56.6",
    )
    frame = read_frame(path, 1)
    assert frame.t_start_utc_ns == 1789185900_250_000_000
    assert frame.t_mid_utc_ns == 1789185905_250_000_000
    assert frame.scale_arcsec_px == pytest.approx(1.2642036)
    assert frame.pointing_ra_icrs_deg == pytest.approx((21 + 22 / 60 + 20.68 / 3600) * 15)
    assert frame.pointing_dec_icrs_deg == pytest.approx(-(49 / 60 + 56.6 / 3600))


def test_ra_and_dec_as_numbers_are_degrees(tmp_path: Path) -> None:
    frame = read_frame(write_fits(tmp_path / "a.fits", sky_pixels(), RA=320.5, DEC=-4.5), 1)
    assert (frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg) == (320.5, -4.5)


def test_a_time_that_cannot_be_understood_is_unknown_and_noted(tmp_path: Path) -> None:
    frame = read_frame(write_fits(tmp_path / "a.fits", sky_pixels(), DATE_OBS="26/07/102"), 1)
    assert frame.t_start_utc_ns is None
    assert any("26/07/102" in note for note in frame.header["NOTES"])


def test_tiff_and_png_of_16_bits_are_read(tmp_path: Path) -> None:
    import cv2

    for suffix in (".tiff", ".png"):
        path = tmp_path / f"a{suffix}"
        cv2.imwrite(str(path), sky_pixels())
        assert np.array_equal(read_frame(path, 1).pixels, sky_pixels())


def test_twelve_bits_in_sixteen_saturate_at_65520(tmp_path: Path) -> None:
    pixels = (sky_pixels() >> 4) << 4
    assert read_frame(write_fits(tmp_path / "a.fits", pixels), 1).saturation_adu == 65520.0


@pytest.mark.parametrize("shift_bits", [0, 1, 4])
def test_a_frame_kept_by_a_session_is_the_cameras_again(tmp_path: Path, shift_bits: int) -> None:
    """Values, type and saturation: a replay must take the same way as the night did."""
    top = (0xFFFF >> shift_bits) << shift_bits
    rng = np.random.default_rng(3)
    pixels = (rng.integers(0, 4096, (96, 128)).astype(np.uint16)) << np.uint16(shift_bits)
    pixels[5, 5] = top
    live = Frame(frame_id=1, name="live", pixels=pixels, exposure_s=10.0)
    kept = tmp_path / "kept.fits.fz"
    kept.write_bytes(compress_frame(live))
    again = read_frame(kept, 1)
    assert again.pixels.dtype == np.uint16
    assert np.array_equal(again.pixels, pixels)


def test_few_masked_pixels_are_filled_and_reported(tmp_path: Path) -> None:
    pixels = np.full((128, 128), 50.0, dtype=np.float32)
    pixels[:, 64:] = 90.0
    pixels[10, 70], pixels[100, 3], pixels[64:, 64:] = np.nan, np.inf, np.nan
    with pytest.raises(FrameError, match="in 4098 of 16384 pixels"):
        read_frame(write_fits(tmp_path / "most.fits", pixels), 1, max_nonfinite_fraction=0.2)
    pixels[64:, 64:] = 90.0
    few = write_fits(tmp_path / "few.fits", pixels)
    with pytest.raises(FrameError, match="in 2 of 16384 pixels"):
        read_frame(few, 1)
    frame = read_frame(few, 1, max_nonfinite_fraction=0.2)
    assert frame.pixels[10, 70] == 90.0
    assert frame.pixels[100, 3] == 50.0
    assert frame.header["NOTES"] == ("2 of 16384 pixels were NaN or infinite and were filled",)


def colour_png(folder: Path) -> Path:
    import cv2

    cv2.imwrite(str(folder / "c.png"), np.stack([sky_pixels()] * 3, axis=-1))
    return folder / "c.png"


def damaged(folder: Path, name: str, source: bytes) -> Path:
    (folder / name).write_bytes(source)
    return folder / name


def broken_files(folder: Path) -> dict[str, tuple[Path, str]]:
    plain = write_fits(folder / "good.fits", sky_pixels()).read_bytes()
    fz = folder / "good.fits.fz"
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(sky_pixels(400, 400))]).writeto(fz)
    all_nan = np.full((96, 96), np.nan, dtype=np.float32)
    return {
        "missing": (folder / "nowhere.fits", "does not exist"),
        "directory": (folder, "is a directory"),
        "empty": (damaged(folder, "empty.fits", b""), "is empty"),
        "truncated": (damaged(folder, "cut.fits", plain[: len(plain) // 2]), "truncated"),
        "truncated header": (damaged(folder, "head.fits", plain[:1000]), "truncated"),
        "truncated gz": (damaged(folder, "cut.gz", gzip.compress(plain)[:9000]), "truncated"),
        "truncated bz2": (damaged(folder, "cut.bz2", bz2.compress(plain)[:9000]), "truncated"),
        "truncated fz": (damaged(folder, "cut.fz", fz.read_bytes()[:9000]), "truncated"),
        "truncated png": (damaged(folder, "cut.png", b"\x89PNG\r\n\x1a\n1234"), "truncated"),
        "text": (damaged(folder, "notes.fits", b"hello"), "neither FITS, TIFF nor PNG"),
        "NaN": (write_fits(folder / "nan.fits", all_nan), "NaN or infinite values in 9216 of 9216"),
        "too small": (write_fits(folder / "small.fits", sky_pixels(40, 128)), "128 x 40 px"),
        "a table": (damaged_table(folder), "no two-dimensional image"),
    }


def damaged_table(folder: Path) -> Path:
    table = fits.BinTableHDU.from_columns([fits.Column(name="q", format="J", array=[1, 2])])
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(folder / "table.fits")
    return folder / "table.fits"


def test_each_broken_file_gets_one_clear_sentence(tmp_path: Path) -> None:
    for what, (path, expected) in broken_files(tmp_path).items():
        with pytest.raises(FrameError) as caught:
            read_frame(path, 1)
        assert expected in str(caught.value), what
        assert "\n" not in str(caught.value), what


@pytest.mark.skipif(os.geteuid() == 0, reason="root can read every file")
def test_an_unreadable_file_says_why(tmp_path: Path) -> None:
    path = write_fits(tmp_path / "a.fits", sky_pixels())
    path.chmod(0)
    with pytest.raises(FrameError, match="Permission denied"):
        read_frame(path, 1)


def test_8_bit_is_read_with_a_warning(tmp_path: Path) -> None:
    pixels = sky_pixels().astype(np.uint8)
    path = write_fits(tmp_path / "a.fits", pixels)
    frame = read_frame(path, 1)
    assert np.array_equal(frame.pixels, pixels)
    assert frame.pixels.dtype == np.uint16
    assert frame.saturation_adu == 255.0
    (note,) = frame.header["NOTES"]
    assert "8 bits" in note


def test_a_session_gives_a_frame_of_8_bits_back_as_it_was(tmp_path: Path) -> None:
    frame = read_frame(write_fits(tmp_path / "a.fits", sky_pixels().astype(np.uint8)), 1)
    (tmp_path / "kept.fits").write_bytes(compress_frame(frame))
    again = read_frame(tmp_path / "kept.fits", 1)
    assert np.array_equal(again.pixels, frame.pixels)
    assert again.saturation_adu == frame.saturation_adu


@pytest.mark.parametrize(("bits", "full_adu"), [(10, 1023), (12, 4095), (14, 16383)])
def test_a_converter_of_fewer_bits_shows_where_it_is_full(tmp_path, bits, full_adu) -> None:
    pixels = np.minimum(sky_pixels() % 1000, full_adu)
    assert read_frame(write_fits(tmp_path / "dark.fits", pixels), 1).saturation_adu == 65535.0
    pixels[40:42, 50:52] = full_adu
    path = write_fits(tmp_path / "bright.fits", pixels.astype(np.uint16))
    assert read_frame(path, 1).saturation_adu == full_adu


def test_the_colours_of_a_picture_are_added_up_with_a_warning(tmp_path: Path) -> None:
    import cv2

    colours = np.random.default_rng(2).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "c.png"), colours)
    frame = read_frame(tmp_path / "c.png", 1)
    assert np.array_equal(frame.pixels, colours.sum(axis=2))
    assert frame.saturation_adu == 3 * 255
    assert any("colour" in note for note in frame.header["NOTES"])


def test_grey_saved_as_colours_keeps_its_values(tmp_path: Path) -> None:
    frame = read_frame(colour_png(tmp_path), 1)
    assert np.array_equal(frame.pixels, sky_pixels())
    assert frame.header["NOTES"] == ()


def several_images(folder: Path) -> Path:
    """An empty primary unit, two parts of a mosaic, a table, a mask and a thumbnail."""
    table = fits.BinTableHDU.from_columns([fits.Column(name="q", format="J", array=[1, 2])])
    units = [
        fits.PrimaryHDU(),
        fits.ImageHDU(sky_pixels(), name="SCI", ver=1),
        fits.ImageHDU(sky_pixels() + np.uint16(1), name="SCI", ver=2),
        table,
        fits.ImageHDU(sky_pixels() + np.uint16(2), name="MASK"),
        fits.ImageHDU(sky_pixels(20, 20), name="THUMB"),
    ]
    units[2].header["EXPTIME"] = 7.0
    fits.HDUList(units).writeto(folder / "several.fits")
    return folder / "several.fits"


def test_of_several_images_the_first_is_read_and_the_others_are_named(tmp_path: Path) -> None:
    frame = read_frame(several_images(tmp_path), 1)
    assert np.array_equal(frame.pixels, sky_pixels())
    assert frame.name == "several.fits[SCI,1]"
    (note,) = frame.header["NOTES"]
    assert "image SCI,1 of 3" in note
    assert "SCI,2, MASK" in note
    assert "--extension" in note


@pytest.mark.parametrize(
    ("extension", "added"),
    [("SCI", 0), ("sci, 2", 1), ("SCI,2", 1), ("2", 1), ("mask", 2), ("4", 2), ("1", 0)],
)
def test_an_image_is_had_by_name_version_or_number(tmp_path, extension, added) -> None:
    frame = read_frame(several_images(tmp_path), 1, extension=extension)
    assert np.array_equal(frame.pixels, sky_pixels() + np.uint16(added))
    assert frame.exposure_s == (7.0 if added == 1 else None)


@pytest.mark.parametrize("extension", ["0", "3", "THUMB", "SCI,3", "", "9"])
def test_what_is_no_image_of_the_file_is_refused_with_the_names_of_those_there_are(
    tmp_path, extension
) -> None:
    with pytest.raises(FrameError, match="SCI,1, SCI,2, MASK"):
        read_frame(several_images(tmp_path), 1, extension=extension)


def test_all_images_of_a_file_come_one_after_another(tmp_path: Path) -> None:
    frames = list(read_frames(several_images(tmp_path), 5, extension="all"))
    assert [frame.header["EXTENSION"] for frame in frames] == ["SCI,1", "SCI,2", "MASK"]
    assert all(frame.header["NOTES"] == () for frame in frames)
    one = write_fits(tmp_path / "one.fits", sky_pixels())
    assert [frame.name for frame in read_frames(one, 1, extension="all")] == ["one.fits"]


def test_an_image_before_others_in_the_first_unit_is_not_the_only_one(tmp_path: Path) -> None:
    units = [fits.PrimaryHDU(sky_pixels()), fits.ImageHDU(sky_pixels(), name="MASK")]
    fits.HDUList(units).writeto(tmp_path / "a.fits")
    (note,) = read_frame(tmp_path / "a.fits", 1).header["NOTES"]
    assert "MASK" in note


def test_damage_behind_the_first_image_does_not_cost_it(tmp_path: Path) -> None:
    content = several_images(tmp_path).read_bytes()
    (tmp_path / "cut.fits").write_bytes(content[:40_000])
    assert np.array_equal(read_frame(tmp_path / "cut.fits", 1).pixels, sky_pixels())
    with pytest.raises(FrameError, match=r"truncated|no image"):
        read_frame(tmp_path / "cut.fits", 1, extension="SCI,2")


def test_a_compressed_image_with_wrong_bytes_is_read_or_an_error_in_words(tmp_path: Path) -> None:
    fz = tmp_path / "good.fits.fz"
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(sky_pixels(400, 400))]).writeto(fz)
    content = bytearray(fz.read_bytes())
    for seed in range(5):
        rng = np.random.default_rng(seed)
        wrong = bytearray(content)
        for place in rng.integers(9000, len(content), 40):
            wrong[place] = int(rng.integers(256))
        # Any other exception would be a traceback for the user.
        with contextlib.suppress(FrameError):
            read_frame(damaged(tmp_path, "wrong.fits.fz", bytes(wrong)), 1)


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
def test_files_of_other_observatories_with_several_images() -> None:
    chip = read_frame(SHARED / "field" / "stars" / "lco_mef_raw_test_frame.fits", 1)
    assert (chip.width_px, chip.height_px) == (544, 522)
    assert chip.exposure_s == 94.975
    for path in (SHARED / "field" / "gmn").glob("*.fits"):
        brightest = read_frame(path, 1, extension="MAXPIXEL").pixels
        mean = read_frame(path, 1, extension="AVEPIXEL").pixels
        assert (brightest >= mean).all()
        assert brightest.shape == (720, 1280)


def test_a_focal_length_that_cannot_be_is_no_hint_and_is_told(tmp_path: Path) -> None:
    path = write_fits(tmp_path / "a.fits", sky_pixels(), FOCALLEN=0.1, XPIXSZ=3.8)
    frame = read_frame(path, 1)
    assert frame.scale_arcsec_px is None
    assert "FOCALLEN 0.1 mm" in frame.header["NOTES"][0]


def test_a_blob_in_memory_reads_like_a_file(tmp_path: Path) -> None:
    content = write_fits(tmp_path / "a.fits", sky_pixels()).read_bytes()
    assert np.array_equal(frame_from_bytes(content, 3, "blob").pixels, sky_pixels())


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
def test_frames_of_other_observatories_are_read() -> None:
    frames: dict[str, Frame] = {}
    paths = [p for p in (SHARED / "real").rglob("*") if p.is_file()]
    for number, path in enumerate(sorted(paths)):
        frames[path.name] = read_frame(path, number)
        assert np.isfinite(frames[path.name].pixels).all()
    assert len(frames) == 11
    assert frames["astride_long.fits"].pixels.min() == -401
    solved = frames["pocs_solved.fits.fz"]
    assert solved.t_start_utc_ns == 1473408874_000_000_000
    assert solved.pixels.max() == 13863
    assert frames["tetra3_alt40_azi45.tiff"].pixels.shape == (768, 1024)
