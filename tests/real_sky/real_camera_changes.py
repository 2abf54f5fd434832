"""Frames of Debian's CCD simulator while another client changes one of its settings at random.

Run in a network namespace of its own: ``python -m tests.real_sky.real_camera_changes FOLDER
FRAMES``. Prints what became of each change as a JSON list.
"""

import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import IndiConfig, OpticsConfig
from rsoconsole.instruments.camera.camera import IndiCamera
from rsoconsole.instruments.indi.indi_wire import IndiVector, IndiWire

PORT, CAMERA, SIZE_PX = 7624, "CCD Simulator", (1280, 1024)
EXPOSURE_S, ANSWER_S = 0.4, 0.3
CHANGES: dict[str, tuple[str, str, dict[str, str]]] = {
    "LOCAL": ("Switch", "UPLOAD_MODE", {"UPLOAD_LOCAL": "On"}),
    "BOTH": ("Switch", "UPLOAD_MODE", {"UPLOAD_BOTH": "On"}),
    "compressed frames": ("Switch", "CCD_COMPRESSION", {"INDI_ENABLED": "On"}),
    "NATIVE": ("Switch", "CCD_TRANSFER_FORMAT", {"FORMAT_NATIVE": "On"}),
    "dark frames": ("Switch", "CCD_FRAME_TYPE", {"FRAME_DARK": "On"}),
    "flat frames": ("Switch", "CCD_FRAME_TYPE", {"FRAME_FLAT": "On"}),
    "2 x 2 binning": ("Number", "CCD_BINNING", {"HOR_BIN": "2", "VER_BIN": "2"}),
    "400 x 300 pixels": (
        "Number",
        "CCD_FRAME",
        {"X": "100", "Y": "100", "WIDTH": "400", "HEIGHT": "300"},
    ),
    "fast exposures": ("Switch", "CCD_FAST_TOGGLE", {"INDI_ENABLED": "On"}),
    "a video stream": ("Switch", "CCD_VIDEO_STREAM", {"STREAM_ON": "On"}),
}


def main(folder: Path, frames: int, seed: int) -> None:
    """Take the frames, print what became of each."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    with (folder / "indiserver.log").open("wb") as log:
        # The simulator dies of some changes; after ten deaths the server would end with it.
        command = ["indiserver", "-r", "1000", "-p", str(PORT), "-u", str(folder / "indi.sock")]
        server = subprocess.Popen(
            [*command, "indi_simulator_ccd"],
            stderr=log,
            stdout=log,
            env={**os.environ, "HOME": str(folder)},
        )
    try:
        time.sleep(1.0)
        optics = OpticsConfig(width_px=SIZE_PX[0], height_px=SIZE_PX[1], pixel_um=5.2)
        config = IndiConfig(port=PORT, camera=CAMERA)
        camera = IndiCamera(config, optics, folder / "camera.log")
        try:
            camera.start()
            print(json.dumps(night(camera, frames, random.Random(seed))))
        finally:
            camera.close()
    finally:
        server.terminate()
        server.wait()


def night(camera: IndiCamera, frames: int, chance: random.Random) -> list[dict[str, Any]]:
    """Take each frame with one change before it, or while its shutter is open."""
    other = IndiWire("127.0.0.1", PORT)
    other.ask(CAMERA)
    facts = []
    for frame_id in range(1, frames + 1):
        change = chance.choice(list(CHANGES))
        is_during = chance.random() < 0.5
        facts.append(taken(camera, other, frame_id, change, is_during=is_during))
    other.close()
    return facts


def taken(
    camera: IndiCamera, other: IndiWire, frame_id: int, change: str, *, is_during: bool
) -> dict[str, Any]:
    """One frame: what was changed and when, what came of it, and what was said."""
    camera.take_messages()
    fact: dict[str, Any] = {"change": change, "is_during": is_during, "fault": ""}
    if not is_during:
        fact["is_taken"] = is_changed(other, change)
    try:
        camera.start_exposure(EXPOSURE_S, frame_id)
        if is_during:
            time.sleep(EXPOSURE_S / 2)
            fact["is_taken"] = is_changed(other, change)
        frame = camera.wait_frame(15.0)
        header = frame.header
        fact |= {
            "size": [frame.width_px, frame.height_px],
            "kind": str(header.get("FRAME", "")),
            "binning": header.get("XBINNING"),
            "exposure_s": frame.exposure_s,
        }
    except InstrumentError as error:
        fact["fault"] = str(error)
    # What was changed while the shutter was open is set back, and said, before the next one.
    try:
        camera.start_exposure(EXPOSURE_S, 100_000 + frame_id)
        camera.wait_frame(15.0)
    except InstrumentError as error:
        fact["next"] = str(error)
    fact["said"] = [text for text in camera.take_messages() if "another program" in text]
    return fact


def is_changed(other: IndiWire, change: str) -> bool:
    """Order it as any client does; whether the driver says that it is so."""
    kind, name, values = CHANGES[change]

    def is_answer(vector: IndiVector) -> bool:
        return vector.name == name and all(
            vector.values.get(key) == value or _number(vector.values.get(key)) == _number(value)
            for key, value in values.items()
        )

    other.new(kind, CAMERA, name, values)
    return other.wait(is_answer, ANSWER_S) is not None


def _number(text: str | None) -> float | str | None:
    try:
        return float(text or "")
    except ValueError:
        return text


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
