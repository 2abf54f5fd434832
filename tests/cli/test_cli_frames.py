"""The verbs over files, as a shell sees them: JSON, errors, exit codes."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from tests.pages.json_page import expect_documented
from tests.rigs.in_process import run_here

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
SATSIM = SHARED / "simulated" / "geo_single"
needs_satsim = pytest.mark.skipif(not SATSIM.exists(), reason=f"{SATSIM} is not here")
needs_real = pytest.mark.skipif(
    not (SHARED / "real").exists(), reason=f"{SHARED / 'real'} is not here"
)


def rsoconsole(
    *arguments: str | Path, timeout_s: float = 150.0
) -> subprocess.CompletedProcess[str]:
    """Run the program as a user does."""
    return subprocess.run(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def objects(run: subprocess.CompletedProcess[str]) -> list[dict]:
    """What was printed, one object a line."""
    return [json.loads(line) for line in run.stdout.splitlines()]


@pytest.fixture
def broken_files(tmp_path: Path) -> dict[str, Path]:
    """One file for each way in which a frame can be unusable, and one that is fine."""
    rng = np.random.default_rng(5)
    good = rng.normal(1000.0, 20.0, (480, 640)).astype(np.uint16)
    paths = {name: tmp_path / f"{name}.fits" for name in ("good", "truncated", "nan", "tiny")}
    fits.writeto(paths["good"], good)
    whole = paths["good"].read_bytes()
    paths["truncated"].write_bytes(whole[: len(whole) // 2])
    fits.writeto(paths["nan"], np.full((480, 640), np.nan, np.float32))
    fits.writeto(paths["tiny"], good[:8, :8])
    paths["eight_bit"] = tmp_path / "eight_bit.png"
    cv2.imwrite(str(paths["eight_bit"]), (good // 8).astype(np.uint8))
    paths["colour"] = tmp_path / "colour.fits"
    fits.writeto(paths["colour"], np.stack([good] * 3))
    paths["empty"] = tmp_path / "empty.fits"
    paths["empty"].write_bytes(b"")
    paths["directory"] = tmp_path / "directory"
    paths["directory"].mkdir()
    paths["missing"] = tmp_path / "missing.fits"
    paths["good_again"] = paths["good"]
    return paths


@pytest.mark.parametrize("verb", ["detect", "process"])
def test_every_broken_file_gets_an_error_and_the_others_go_on(broken_files, verb):
    run = run_here(verb, "--json", *broken_files.values())
    answers = dict(zip(broken_files, objects(run), strict=True))
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    for name, answer in answers.items():
        assert answer["frame"] == str(broken_files[name])
        if name.startswith(("good", "eight")):
            assert answer["detections"] == []
            assert any("8 bits" in note for note in answer["notes"]) == (name == "eight_bit")
            expect_documented(verb, answer)
            assert "error" not in answer
        else:
            assert set(answer) == {"schema", "frame", "error"}
            assert len(answer["error"]) > 20
    sentences = {a["error"] for n, a in answers.items() if not n.startswith(("good", "eight"))}
    assert len(sentences) == len(broken_files) - 3, "every fault has words of its own"


def test_an_eight_bit_picture_is_looked_at_with_one_warning(broken_files):
    picture = broken_files["eight_bit"]
    run = run_here("solve", "--json", "--scale", "1.2", "1.3", picture, picture)
    assert run.returncode == 0
    for answer in objects(run):
        assert answer["solved"] is False
        assert "stars" in answer["reason"]
        expect_documented("solve", answer)
    assert run.stderr.count("8 bits a pixel") == 1


@pytest.fixture
def mosaic(tmp_path: Path) -> Path:
    """Two chips of one exposure, the primary unit empty."""
    rng = np.random.default_rng(5)
    chips = [rng.normal(1000.0, 20.0, (480, 640)).astype(np.uint16) for _ in range(2)]
    units = [fits.PrimaryHDU(), *(fits.ImageHDU(chip, name="SCI") for chip in chips)]
    for version, unit in enumerate(units[1:], start=1):
        unit.ver = version
    fits.HDUList(units).writeto(tmp_path / "mosaic.fits")
    return tmp_path / "mosaic.fits"


def test_of_a_mosaic_the_first_chip_is_taken_and_the_others_are_named(mosaic):
    run = run_here("detect", "--json", mosaic)
    (answer,) = objects(run)
    assert (run.returncode, answer["extension"]) == (0, "SCI,1")
    assert "SCI,2" in run.stderr
    expect_documented("detect", answer)


def test_every_chip_of_a_mosaic_is_looked_at_where_that_is_asked_for(mosaic):
    run = run_here("detect", "--json", "--extension", "all", mosaic)
    assert [answer["extension"] for answer in objects(run)] == ["SCI,1", "SCI,2"]
    assert run.stderr == ""
    assert "mosaic.fits[SCI,2]: 0 streak" in run_here("detect", "--extension", "2", mosaic).stdout


def test_a_chip_that_is_not_there_is_an_error_with_the_names_of_those_that_are(mosaic):
    run = run_here("process", "--extension", "SCI,3", mosaic)
    assert run.returncode == 1
    assert "SCI,1, SCI,2" in run.stderr
    assert run_here("process", "--extension", "all", mosaic).returncode == 2


def test_a_shell_gets_the_exit_code_and_one_line(tmp_path, monkeypatch):
    """All others here run in the process of the tests."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for words, code, line in (
        (("dance",), 2, "no such command 'dance'"),
        (("status",), 1, "no engine is running"),
    ):
        run = rsoconsole(*words)
        assert (run.returncode, run.stdout) == (code, "")
        assert line in run.stderr
        assert run.stderr.count("\n") == 1
    assert (run := rsoconsole("--version")).returncode == 0
    assert run.stdout.startswith("rsoconsole ")


def test_wrong_usage_is_exit_2_and_help_teaches():
    assert run_here("detect").returncode == 2
    assert run_here("dance").returncode == 2
    for verb in ("demo", "engine", "status", "stop", "process", "detect", "solve", "doctor"):
        run = run_here(verb, "--help")
        assert run.returncode == 0
        assert "Example" in run.stdout


def test_no_engine_is_said_plainly(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    run = run_here("status", "--json")
    assert run.returncode == 1
    assert "no engine is running" in run.stderr
    assert run.stdout == ""


@needs_satsim
@pytest.mark.shared_data
@pytest.mark.nightly("unpacks three whole frames")
def test_the_satellite_of_an_independent_simulator_is_measured_within_two_arcseconds():
    """SatSim's frames and truth: another renderer, another reduction of the same sky."""
    truth = json.loads((SATSIM / "truth.json").read_text())
    run = run_here("process", "--json", *sorted(SATSIM.glob("*.bz2")))
    assert run.returncode == 0, run.stderr
    answers = objects(run)
    assert [a["state"] for a in answers] == ["ACQUIRE", "TRACK", "TRACK"]
    for answer, frame in zip(answers, truth["frames"], strict=True):
        (target,) = frame["objects"]
        measured = answer["measurement"]
        dra = (measured["ra"] - target["ra"]) * np.cos(np.radians(target["dec"]))
        assert np.hypot(dra, measured["dec"] - target["dec"]) * 3600.0 <= 2.0


@needs_real
@pytest.mark.shared_data
def test_the_real_streak_of_another_observatory_is_found():
    """ASTRiDE's example: ends by eye at (22, 338) and (340, 308)."""
    run = run_here("detect", "--json", SHARED / "real" / "astride_long.fits")
    (answer,) = objects(run)
    best = answer["detections"][0]
    ends = sorted([(best["x_a"], best["y_a"]), (best["x_b"], best["y_b"])])
    six_pixels = 6.0
    assert np.hypot(ends[0][0] - 22, ends[0][1] - 338) < six_pixels
    assert np.hypot(ends[1][0] - 340, ends[1][1] - 308) < six_pixels
