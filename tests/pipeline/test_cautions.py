"""What is unusual about a camera is told once a night, by whichever way its frames come."""

import io
import subprocess
import sys
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from astropy.io import fits

from rsoconsole.config import Config
from rsoconsole.instruments.camera.camera_child import CameraChild
from rsoconsole.instruments.camera.frame_ring import FrameRing
from rsoconsole.instruments.indi.indi_child import ReplyWriter
from rsoconsole.pipeline import Cycle, FrameReducer, Reduction
from rsoconsole.pipeline.frame.frame_cautions import Caution, cautions
from rsoconsole.records import Detections, Event, Frame, Solution
from rsoconsole.session import SessionReader
from rsoconsole.vision import camera_cautions

PIXELS = np.random.default_rng(3).integers(0, 255, (480, 640), dtype=np.uint8)


def frame(**changes: Any) -> Frame:
    usual = Frame(
        frame_id=1,
        name="a",
        pixels=PIXELS.astype(np.uint16),
        exposure_s=10.0,
        scale_arcsec_px=1.26,
    )
    return replace(usual, **changes)


@pytest.mark.parametrize(
    ("changes", "about"),
    [
        ({}, []),
        ({"scale_arcsec_px": 1.0}, []),
        ({"scale_arcsec_px": 10.0}, []),
        ({"scale_arcsec_px": 0.25}, ["scale"]),
        ({"scale_arcsec_px": 249.6}, ["scale"]),
        ({"scale_arcsec_px": None, "exposure_s": None}, []),
        ({"exposure_s": 0.05}, []),
        ({"exposure_s": 60.0}, []),
        ({"exposure_s": 0.01}, ["exposure"]),
        ({"exposure_s": 120.0, "scale_arcsec_px": 12.0}, ["scale", "exposure"]),
        ({"pixels": PIXELS[:400].astype(np.uint16)}, ["size"]),
    ],
)
def test_what_leaves_the_calibrated_range_is_named(changes, about):
    told = cautions(frame(**changes), None, Config())
    assert [each.kind for each in told] == about


def test_beyond_what_can_be_used_the_words_are_plainer():
    usable = camera_cautions(12.0, None, 640, 480)["scale"]
    beyond = camera_cautions(0.25, None, 640, 480)["scale"]
    assert "calibrated" in usable
    assert "do not rely on detections" in beyond
    assert "do not rely" not in usable


class Noted:
    """A reducer whose every frame has these cautions."""

    def reduce(self, frame: Frame) -> Reduction:
        return Reduction(
            detections=Detections(
                frame_id=frame.frame_id, width_px=640, height_px=480, detections=()
            ),
            solution=None,
            measurements=(),
            star_count=0,
            fwhm_px=None,
            absence="",
            cautions=(Caution(kind="scale", words=f"scale of frame {frame.frame_id}"),),
        )


def test_a_night_is_told_once():
    cycle = Cycle(cast(FrameReducer, Noted()), Config())
    events = [
        record
        for number in (1, 2, 3)
        for record in cycle.reduce_only(frame(frame_id=number))[1]
        if isinstance(record, Event)
    ]
    assert [(event.level, event.text, event.frame_id) for event in events] == [
        ("warning", "scale of frame 1", 1)
    ]


@pytest.mark.nightly("starts the whole program")
def test_an_engine_with_a_colour_camera_and_a_wrong_focal_length_solves_and_says_so(tmp_path):
    """The simulated telescope is a tenth longer than its driver believes."""
    world = tmp_path / "world.toml"
    world.write_text("[optics]\nscale_error = 0.1\n[sensor]\nbayer = true\n", encoding="utf-8")
    arguments = ["demo", "--headless", "--frames", "2", "--world", str(world)]
    arguments += ["--session", str(tmp_path / "night")]
    run = subprocess.run(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    night = SessionReader(tmp_path / "night")
    records = [record for _, _, record in night.records(kinds=(Event, Solution))]
    solutions = [record for record in records if isinstance(record, Solution)]
    assert len(solutions) == 2
    for solution in solutions:
        assert solution.scale_arcsec_px == pytest.approx(1.2642 / 1.1, rel=1e-3)
    (warning,) = [r.text for r in records if isinstance(r, Event) and "is wrong" in r.text]
    assert warning.startswith("the configured scale 1.264 arcsec/px is wrong: the stars say 1.149")
    assert f"it should be {620 * 1.1:.0f}" in warning


class Heard(ReplyWriter):
    """Remembers what the camera's process says."""

    def __init__(self) -> None:
        self.said: list[dict[str, Any]] = []

    def send(self, message: Any) -> None:
        self.said.append(dict(message))


def test_a_camera_of_8_bits_gives_frames_over_indi_with_a_note():
    content = io.BytesIO()
    fits.PrimaryHDU(PIXELS).writeto(content)
    heard = Heard()
    child = CameraChild(heard)
    ring = FrameRing.create(PIXELS.size * 4)
    child._ring, child._frame_id = ring, 4
    child._take(4, 0, memoryview(content.getvalue()), 0.0)
    (told,) = heard.said
    assert told["event"] == "frame", told
    assert told["saturation_adu"] == 255.0
    assert any("8 bits" in note for note in told["header"]["NOTES"])
    taken = ring.lend_slot(0, told["dtype"], tuple(told["shape"]))
    assert np.array_equal(taken, PIXELS)
