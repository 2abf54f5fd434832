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


@pytest.fixture(scope="module")
def answers() -> dict[str, dict]:
    """What the program says of every file, by the file's name."""
    paths = [*SIMULATED.glob("*/*.bz2"), REAL / "astride_long.fits"]
    paths += [path for pattern in SILENT for path in REAL.glob(pattern)]
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
def test_every_satellite_is_found_within_a_pixel_of_its_middle_and_nothing_else(answers, sequence):
    truth = json.loads((SIMULATED / sequence / "truth.json").read_text())
    for frame in truth["frames"]:
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
    paths = list(REAL.glob(pattern))
    assert paths
    for path in paths:
        assert answers[path.name]["detections"] == [], path.name
