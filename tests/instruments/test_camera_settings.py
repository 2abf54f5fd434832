"""A camera that another client sets otherwise: Debian's CCD simulator, and the words for it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.instruments.camera._capture_settings import sensor_caution
from rsoconsole.instruments.indi.indi_client import Vector
from tests.rigs.network_namespace import namespace_for
from tests.tiers import plain_first

ROOT = Path(__file__).resolve().parents[2]
WHOLE = {"size": [1280, 1024], "kind": "Light", "binning": 1, "exposure_s": 0.4}


@pytest.mark.indi_bin
@pytest.mark.timeout(1500)
@pytest.mark.parametrize(("frames", "seed"), plain_first(1, [(12, 1), (200, 2)]))
def test_no_frame_is_used_that_another_program_has_made_another_one(
    tmp_path: Path, frames: int, seed: int
):
    """Before each frame, or while its shutter is open, another client changes one setting."""
    facts = night_of(tmp_path, frames, seed)
    assert len(facts) == frames
    changed = [fact for fact in facts if fact["is_taken"]]
    assert len(changed) >= 0.8 * frames
    for fact in changed:
        said = [*fact["said"], fact["fault"], fact.get("next", "")]
        assert any(fact["change"] in text for text in said), fact
        if not fact["fault"]:
            assert {key: fact[key] for key in WHOLE} == WHOLE
    restored = [fact for fact in changed if not fact["is_during"] and not fact["fault"]]
    assert len(restored) >= 0.05 * frames
    for fact in restored:
        wanted = f"the camera was set to {fact['change']}"
        assert any(t.startswith(wanted) and t.endswith(": set back") for t in fact["said"]), fact


def night_of(folder: Path, frames: int, seed: int) -> list[dict[str, Any]]:
    namespace = namespace_for(("indiserver", "indi_simulator_ccd"), "indi-bin")
    module = "tests.real_sky.real_camera_changes"
    done = subprocess.run(
        [*namespace, sys.executable, "-m", module, str(folder), str(frames), str(seed)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60 + 5 * frames,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    facts: list[dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
    return facts


def info(**values: float) -> Vector:
    return Vector(
        name="CCD_INFO",
        state="Ok",
        values=values,
        serial=1,
        is_definition=True,
        arrived_monotonic_s=0.0,
    )


SENSOR = {
    "CCD_MAX_X": 1280,
    "CCD_MAX_Y": 1024,
    "CCD_PIXEL_SIZE_X": 5.2,
    "CCD_PIXEL_SIZE_Y": 5.2,
}


@pytest.mark.parametrize(
    ("values", "pixel_um", "size_px", "said"),
    [
        ({}, 3.8, (4144, 2822), ""),
        ({"CCD_MAX_X": 0.0, "CCD_PIXEL_SIZE_X": 0.0, "CCD_PIXEL_SIZE_Y": 0.0}, 3.8, (10, 10), ""),
        (
            SENSOR,
            5.2,
            (1280, 1024),
            "",
        ),
        (
            SENSOR,
            10.4,
            (640, 512),
            "",
        ),
        (
            {"CCD_MAX_X": 800, "CCD_MAX_Y": 600, "CCD_PIXEL_SIZE_X": 9, "CCD_PIXEL_SIZE_Y": 6},
            5.2,
            (1280, 1024),
            "the camera's pixels are 9 x 6 µm: frames need square ones",
        ),
        (
            {"CCD_PIXEL_SIZE_X": 3.76, "CCD_PIXEL_SIZE_Y": 3.76},
            5.2,
            (1280, 1024),
            "the camera says that its pixels are 3.76 µm, optics.pixel_um is 5.2: correct it",
        ),
        (
            {**SENSOR, "CCD_MAX_X": 800, "CCD_MAX_Y": 600},
            5.2,
            (1280, 1024),
            "the camera's sensor has 800 x 600 pixels, fewer than optics.width_px x"
            " optics.height_px = 1280 x 1024: correct them",
        ),
    ],
)
def test_the_sensor_is_held_against_the_configuration(
    values: dict[str, float], pixel_um: float, size_px: tuple[int, int], said: str
):
    assert sensor_caution(info(**values), pixel_um, size_px) == said
