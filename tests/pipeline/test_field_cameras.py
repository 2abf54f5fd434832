"""Cameras unlike the paper's: fine and coarse, short and long, of 8 bits, in extensions."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.config import Config
from rsoconsole.instruments import PlateSolver, SolveHint, list_index_files, read_frame
from rsoconsole.instruments.solver.index_files import SYSTEM_DIR
from rsoconsole.pipeline.frame.hints import header_hint, hint_with_overrides, wrong_hints
from rsoconsole.pipeline.frame.plate import PlateFinder
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.sky import pixel_to_sky, separation_deg, wcs_from_cards
from rsoconsole.vision import find_stars
from tests.drawn.plate_fields import CACHE, SHARED, whole_sky_index_dir

FIELD, REAL = SHARED / "field", SHARED / "real"
NAVSTAR = sorted((FIELD / "modra").glob("00040A_R_4-*.fit"))
ASTEROID = sorted((FIELD / "modra").glob("PR25_R_7s-*.fit"))
VIDEO = sorted((FIELD / "gmn").glob("*.fits"))
pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not FIELD.is_dir(), reason=f"{FIELD} is not here"),
]
MODRA_ARCSEC_PX = (1.6, 1.75)
CONFIG = Config.model_validate({"solver": {"deadline_s": 40.0}})


@pytest.fixture(scope="module")
def solver() -> Iterator[PlateSolver]:
    with PlateSolver([whole_sky_index_dir()]) as plate_solver:
        yield plate_solver


def solved(solver: PlateSolver, frame: Frame, hint: SolveHint) -> Solution | NotSolved:
    stars = find_stars(frame.pixels, saturation_adu=frame.saturation_adu)
    return PlateFinder(solver, CONFIG).solve_in_full(frame, stars, hint)


def test_a_field_of_two_degrees_solves_with_a_scale_half_as_large_and_names_it(solver):
    frame = read_frame(REAL / "pocs_unsolved.fits", 1)
    hint = hint_with_overrides(header_hint(frame, CONFIG), None, None, None, (5.0, 5.4))
    found = solved(solver, frame, hint)
    assert isinstance(found, Solution), found
    # Centre of their plate two minutes later; the mount drifted meanwhile.
    off_deg = separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, 303.208, 46.019)
    one_arcmin = 1.0 / 60.0
    assert off_deg < one_arcmin
    (wrong,) = wrong_hints(hint, found, frame, CONFIG)
    assert wrong.words == "the given scale of 5 to 5.4 arcsec/px is wrong: the stars say 10.31"


def test_a_wrong_position_of_a_wide_field_is_named(solver):
    frame = read_frame(REAL / "tetra3_alt40_azi45.tiff", 1)
    hint = hint_with_overrides(header_hint(frame, CONFIG), 10.0, -20.0, 3.0, (36.0, 44.0))
    found = solved(solver, frame, hint)
    assert isinstance(found, Solution), found
    two_arcmin = 2.0 / 60.0
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, 355.205, 58.152) < two_arcmin
    assert [each.hint for each in wrong_hints(hint, found, frame, CONFIG)] == ["position"]


@pytest.mark.parametrize("path", [NAVSTAR[0], ASTEROID[0]] if NAVSTAR else [])
def test_a_field_of_28_arcmin_is_told_which_index_files_it_wants(solver, path):
    frame = read_frame(path, 1)
    hint = hint_with_overrides(header_hint(frame, CONFIG), None, None, None, MODRA_ARCSEC_PX)
    missing = solver.missing_numbers_for_field(hint, frame.width_px, frame.height_px)
    assert {5, 6} <= set(missing) <= {5, 6, 7}
    found = solved(solver, frame, hint)
    if isinstance(found, NotSolved):
        assert "5205, 5206" in found.reason


def dirs_with_07() -> list[Path]:
    named = os.environ.get("RSOCONSOLE_TEST_INDEX")
    roots = [Path(named)] if named else [SYSTEM_DIR, CACHE]
    folders = {path.parent for root in roots for path in root.rglob("index-*07*.fits")}
    return [
        folder
        for folder in sorted(folders)
        if any(file.is_healthy and file.scale == 7 for file in list_index_files([folder]))
    ]


@pytest.mark.skipif(
    not dirs_with_07(), reason="no index file 4107: tests/fetch_debian_index.sh gets Debian's"
)
def test_with_the_index_file_that_was_named_the_field_solves_where_the_observatory_says():
    with PlateSolver(dirs_with_07()) as finer:
        for path in NAVSTAR:
            frame = read_frame(path, 1)
            hint = hint_with_overrides(
                header_hint(frame, CONFIG), None, None, None, MODRA_ARCSEC_PX
            )
            found = solved(finer, frame, hint)
            assert isinstance(found, Solution), (path.name, found)
            theirs = pixel_to_sky(wcs_from_cards(frame.header), 511.5, 511.5)
            off_deg = separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *map(float, theirs))
            # Ten stars of Tycho-2, each good to 0.3 arcsec.
            assert 3600.0 * off_deg < 1.0, path.name


def test_a_view_of_88_degrees_is_said_to_be_too_wide(solver):
    frame = read_frame(VIDEO[0], 1, extension="AVEPIXEL")
    hint = SolveHint(scale_low_arcsec_px=235.0, scale_high_arcsec_px=265.0)
    stars = find_stars(frame.pixels, saturation_adu=frame.saturation_adu)
    found = solver.solve(
        stars, frame_id=1, width_px=1280, height_px=720, hint=hint, deadline_s=20.0
    )
    assert isinstance(found, NotSolved)
    assert "89 deg long is wider than the 60 deg" in found.reason


@pytest.mark.slow("looks at real frames of many cameras")
def test_every_frame_is_looked_at_and_what_is_unusual_is_said():
    stars = sorted((FIELD / "stars").iterdir())
    run = subprocess.run(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", "detect", "--json"]
        + [str(path) for path in (*stars, *NAVSTAR[:2], *ASTEROID[:1], *VIDEO[:1])],
        capture_output=True,
        text=True,
        timeout=590,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    answers = [json.loads(line) for line in run.stdout.splitlines()]
    told = {Path(answer["frame"]).name: answer for answer in answers}
    # Two of these fields have a galaxy seen from its edge.
    assert [path.name for path in stars if told[path.name]["detections"]] == []
    mosaic = told["lco_mef_raw_test_frame.fits"]
    assert (mosaic["extension"], mosaic["width"], mosaic["height"]) == ("SCI,1", 544, 522)
    assert any("SCI,2, SCI,3, SCI,4" in note for note in mosaic["notes"])
    picture = told["oresat_capture-2022-09-25.png"]
    assert any("colour" in note for note in picture["notes"])
    video = told[VIDEO[0].name]
    assert video["extension"] == "MAXPIXEL"
    assert any("8 bits" in note for note in video["notes"])
    assert any("AVEPIXEL" in note for note in video["notes"])
    for name in ("lco_mef_raw_test_frame.fits", "saao_a8280271.fits"):
        assert any("made for 0.05 to 60 s" in note for note in told[name]["notes"])
    assert told[NAVSTAR[0].name]["notes"] == []
