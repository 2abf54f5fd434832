"""``rsoconsole detect`` on frames that this project did not make, nor train or calibrate on."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SIMULATED, REAL = DATA / "simulated", DATA / "real"
SILENT = ("pocs_*", "tetra3_*", "cutouts/*")
pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.shared_data,
    pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not here"),
]


def some(folder: Path, pattern: str, is_all: bool) -> list[Path]:
    """All files of a pattern, or the first."""
    paths = sorted(folder.glob(pattern))
    return paths if is_all else paths[:1]


@pytest.fixture(
    scope="module",
    params=[False, pytest.param(True, marks=pytest.mark.nightly("looks at every frame"))],
    ids=["the first", "all"],
)
def answers(request: pytest.FixtureRequest) -> dict[str, dict]:
    """What the program says of a file of each kind, or of all, by the file's name."""
    paths = [REAL / "astride_long.fits"]
    for sequence in ("geo_single", "geo_pair_dim", "empty"):
        paths += some(SIMULATED, f"{sequence}/*.bz2", request.param)
    paths += [path for pattern in SILENT for path in some(REAL, pattern, request.param)]
    run = subprocess.run(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", "detect", "--json"]
        + [str(path) for path in sorted(paths)],
        capture_output=True,
        text=True,
        timeout=590,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    told = [json.loads(line) for line in run.stdout.splitlines()]
    assert len(told) == len(paths)
    return {Path(each["frame"]).name: each for each in told}


@pytest.mark.parametrize("sequence", ["geo_single", "geo_pair_dim", "empty"])
@pytest.mark.slow("detects in whole frames")
def test_every_satellite_is_found_within_a_pixel_of_its_middle_and_nothing_else(answers, sequence):
    truth = json.loads((SIMULATED / sequence / "truth.json").read_text())
    frames = [each for each in truth["frames"] if each["file"] in answers]
    assert frames
    for frame in frames:
        found = answers[frame["file"]]["detections"]
        asked = [each for each in frame["objects"] if each["snr_peak_pixel"] >= 3.0]
        assert len(found) == len(asked) == len(frame["objects"])
        for true in asked:
            one_pixel = 1.0
            off = [math.hypot(d["x"] - true["x"], d["y"] - true["y"]) for d in found]
            assert min(off) <= one_pixel


def test_the_streak_of_another_observatory_is_found_with_both_ends(answers):
    """ASTRiDE's example frame: ends by eye at (22, 338) and (340, 308)."""
    (found,) = answers["astride_long.fits"]["detections"]
    ends = sorted([(found["x_a"], found["y_a"]), (found["x_b"], found["y_b"])])
    five_pixels = 5.0
    assert math.dist(ends[0], (22, 338)) <= five_pixels
    assert math.dist(ends[1], (340, 308)) <= five_pixels


@pytest.mark.parametrize("pattern", SILENT)
def test_nothing_is_found_where_there_is_no_satellite(answers, pattern):
    paths = [path for path in REAL.glob(pattern) if path.name in answers]
    assert paths
    for path in paths:
        assert answers[path.name]["detections"] == [], path.name
