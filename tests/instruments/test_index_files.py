"""Index files: found, judged, chosen and installed."""

import shutil
from pathlib import Path

import pytest

from models.star_catalogue import read_index
from rsoconsole.base import SolverError
from rsoconsole.instruments import (
    IndexFile,
    install_index_files,
    list_index_files,
    needed_tycho_numbers,
)
from rsoconsole.instruments.solver import index_files
from rsoconsole.instruments.solver import index_files as index_install
from rsoconsole.instruments.solver.index_files import (
    choose_index_files,
    folders_to_search,
    shipped_index_dir,
)
from rsoconsole.sky import separation_deg

SMALLEST = "index-tycho2-belt-10.fits"


def shipped(name: str = SMALLEST) -> Path:
    return shipped_index_dir() / name


def listed(folder: Path) -> IndexFile:
    (file,) = list_index_files([folder])
    return file


def whole(scale: int, name: str, dec_deg: tuple[float, float] = (-90.0, 90.0)) -> IndexFile:
    quad = tuple(index_files.QUAD_ARCMIN[scale + i] / 60 for i in (0, 1))
    return IndexFile(
        path=Path(name), scale=scale, quad_deg=(quad[0], quad[1]), dec_deg=dec_deg, size_bytes=1
    )


def test_shipped_files_are_whole_and_hold_the_belt():
    files = list_index_files([shipped_index_dir()])
    assert [file.scale for file in files] == [8, 9, 10]
    assert all(file.is_healthy for file in files)
    assert all(file.covers(0.0) and file.covers(11.9) and not file.covers(14.0) for file in files)
    assert all(file.size_bytes < 20e6 for file in files)
    assert (shipped_index_dir() / "COPYRIGHT.tycho2").exists()


def test_stars_inside_an_index_file_are_where_the_catalogue_has_them():
    ra, dec, mag = read_index(shipped())
    # Procyon and Altair: Hipparcos positions at J1991.25, Johnson V within 0.3 mag of VT.
    for ra_deg, dec_deg, v in ((114.827242, 5.227508, 0.37), (297.694509, 8.867385, 0.76)):
        away = separation_deg(ra_deg, dec_deg, ra, dec)
        nearest = int(away.argmin())
        assert 3600 * away[nearest] < 1.0
        assert mag[nearest] == pytest.approx(v, abs=0.3)


def test_a_truncated_file_is_called_truncated(tmp_path):
    with shipped().open("rb") as whole_file:
        (tmp_path / SMALLEST).write_bytes(whole_file.read(1_000_000))
    assert "truncated" in listed(tmp_path).fault


@pytest.mark.parametrize("content", [b"", b"not FITS at all", b"SIMPLE  =  T".ljust(2880)])
def test_a_file_that_is_no_index_is_named_as_faulty(tmp_path, content):
    (tmp_path / "index-4108.fits").write_bytes(content)
    assert not listed(tmp_path).is_healthy


def test_a_file_of_the_other_byte_order_is_named_as_faulty(tmp_path):
    content = shipped().read_bytes().replace(b"'04:03:02:01'", b"'01:02:03:04'", 1)
    (tmp_path / SMALLEST).write_bytes(content)
    assert "byte order" in listed(tmp_path).fault


def test_a_missing_folder_is_merely_empty(tmp_path):
    assert list_index_files([tmp_path / "none"]) == ()


def test_search_goes_from_the_configured_folder_to_the_shipped_one(tmp_path):
    dirs = folders_to_search((tmp_path,))
    assert dirs[0] == tmp_path
    assert dirs[-1] == shipped_index_dir()


@pytest.mark.parametrize(
    ("field_deg", "scales"),
    [
        ((1.63, 1.24), (8, 9, 10)),  # the paper's telescope
        ((2.0, 2.0), (9, 10, 11)),
        ((11.42, 8.56), (14, 15, 16)),
        ((0.5, 0.4), (7,)),
        ((60.0, 50.0), (19,)),
    ],
)
def test_needed_scales_follow_the_field(field_deg, scales):
    assert needed_tycho_numbers(field_deg) == scales


def test_a_field_too_small_for_tycho_is_refused_with_a_remedy():
    with pytest.raises(SolverError, match="5200"):
        needed_tycho_numbers((0.15, 0.1))


def test_whole_sky_files_displace_the_belt_and_the_first_found_wins():
    belt = whole(8, "index-belt-08.fits", (-12.0, 12.0))
    first, second = whole(8, "a/index-08.fits"), whole(8, "b/index-08.fits")
    ask = {"quad_deg": (0.1, 2.0), "dec_icrs_deg": 0.0, "radius_deg": 3.0}
    assert choose_index_files([belt, first, second], **ask) == (first,)
    assert choose_index_files([belt], **ask) == (belt,)
    assert choose_index_files([belt], **{**ask, "dec_icrs_deg": 40.0}) == ()
    assert choose_index_files([first], **{**ask, "quad_deg": (5.0, 9.0)}) == ()


def test_install_from_an_unpacked_package_finds_nested_files(tmp_path):
    nested = tmp_path / "deb" / "usr" / "share" / "astrometry"
    nested.mkdir(parents=True)
    shutil.copy(shipped(), nested / "index-tycho2-10.littleendian.fits")
    seen = []
    installed = install_index_files(
        [10], from_dir=tmp_path / "deb", into=tmp_path / "into", progress=lambda *a: seen.append(a)
    )
    assert [file.path.name for file in installed] == ["index-tycho2-10.littleendian.fits"]
    assert installed[0].is_healthy
    assert seen[-1][1] == seen[-1][2] == shipped().stat().st_size
    assert [p.name for p in (tmp_path / "into").iterdir()] == ["index-tycho2-10.littleendian.fits"]


def test_install_refuses_a_truncated_file_and_leaves_nothing(tmp_path):
    source = tmp_path / "from"
    source.mkdir()
    (source / "index-4110.fits").write_bytes(shipped().read_bytes()[:100_000])
    with pytest.raises(SolverError, match="truncated"):
        install_index_files([10], from_dir=source, into=tmp_path / "into")
    assert list((tmp_path / "into").iterdir()) == []


def test_install_names_what_the_folder_lacks(tmp_path):
    shutil.copy(shipped(), tmp_path)
    with pytest.raises(SolverError, match="number 8, 9"):
        install_index_files([8, 9, 10], from_dir=tmp_path, into=tmp_path / "into")


def test_install_refuses_numbers_that_do_not_exist(tmp_path):
    with pytest.raises(SolverError, match="7 to 19"):
        install_index_files([3], into=tmp_path)


def fake_download(content: bytes):
    def index_files_of_series(cache_directory: Path, scales: set[int]) -> list[Path]:
        (scale,) = scales
        path = cache_directory / "4100" / f"index-41{scale:02d}.fits"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        return [path]

    return index_files_of_series


def test_download_is_checked_and_moved_into_place(tmp_path, monkeypatch):
    import astrometry

    content = shipped().read_bytes()
    series = astrometry.series_4100
    monkeypatch.setattr(series, "index_files", fake_download(content), raising=False)
    monkeypatch.setitem(series.scale_to_sizes, 10, (len(content),))
    (installed,) = install_index_files([10], into=tmp_path)
    assert installed.path == tmp_path / "index-4110.fits"
    assert [p.name for p in tmp_path.iterdir()] == ["index-4110.fits"]


def test_a_download_cut_short_is_refused(tmp_path, monkeypatch):
    import astrometry

    series = astrometry.series_4100
    monkeypatch.setattr(series, "index_files", fake_download(shipped().read_bytes()[:50_000]))
    with pytest.raises(SolverError, match="broken"):
        install_index_files([10], into=tmp_path)
    assert list_index_files([tmp_path]) == ()


def test_a_machine_without_internet_is_told_the_other_way(tmp_path, monkeypatch):
    import requests

    def no_network(*_args, **_kwargs):
        raise requests.ConnectionError("no route")

    monkeypatch.setattr("astrometry.series_4100.index_files", no_network)
    with pytest.raises(SolverError, match="--from DIR"):
        install_index_files([10], into=tmp_path)


def test_install_keeps_what_is_already_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(index_install, "_download", lambda *_: pytest.fail("nothing was missing"))
    monkeypatch.setattr(
        index_install, "list_index_files", lambda _dirs: (whole(10, "index-4110.fits"),)
    )
    assert install_index_files([10], into=tmp_path)[0].scale == 10
