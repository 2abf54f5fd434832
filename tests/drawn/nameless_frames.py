"""Frames of the shipped scenarios as they were before worlds could be named, and how to make them.

``python -m tests.drawn.nameless_frames`` writes the file again: only where the sky itself is to
change.
"""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator import Scene, scenario_named
from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.sky import icrs_of_hour_angle

NS = 1_000_000_000
FILE = Path(__file__).parents[1] / "data" / "nameless_frames.json"
SAMPLE_EVERY = 97
HOUR_ANGLE_DEG = {
    "intelsat-14": -41.0,
    "ses-10": -16.17,
    "intelsat-21": -26.4,
    "cloud-bank": -26.4,
    "empty": -36.0,
}
SMALL = OpticsConfig(width_px=320, height_px=240)
CASES = [(name, second, "small") for name in HOUR_ANGLE_DEG for second in (60.0, 430.0)]
WHOLE = ("intelsat-14", 330.0, "whole")
"""The telescope's full frame, in a fade of the satellite."""
TRUTH_KEYS = (
    *("t_start_utc_ns", "boresight_ra_icrs_deg", "fwhm_px", "sky_electrons_px", "stars"),
    *("cloud_transmission",),
)
SATELLITE_KEYS = (
    *("norad_id", "ra_icrs_deg", "dec_icrs_deg", "x_px", "y_px", "x_start_px", "y_end_px"),
    *("electrons", "snr_peak_pixel", "snr_matched"),
)

MakeScene = Callable[..., Scene]


def frame_facts(name: str, second: float, size: str, make: MakeScene = Scene) -> dict[str, Any]:
    """Digest, some pixels and the truth of one frame."""
    scenario = scenario_named(name)
    t = scenario.t_start_utc_ns + round(second * NS)
    ra, dec = icrs_of_hour_angle(
        scenario.site, HOUR_ANGLE_DEG[name], scenario.start_declination_deg, t
    )
    scene = make(scenario, 1, optics=SMALL if size == "small" else OpticsConfig())
    pixels, truth = scene.expose(float(ra), float(dec), 1.7, False, t, 10.0)
    table = json.loads(truth.to_json())
    every = SAMPLE_EVERY if size == "small" else 200 * SAMPLE_EVERY
    return {
        "case": [name, second, size],
        "sha256": hashlib.sha256(pixels.tobytes()).hexdigest(),
        "pixels": pixels.ravel()[::every].astype(">u2").tobytes().hex(),
        "truth": {key: table[key] for key in TRUTH_KEYS},
        "satellites": [{key: each[key] for key in SATELLITE_KEYS} for each in table["satellites"]],
    }


def mount_facts(make: Callable[..., MountModel] = MountModel) -> list[float]:
    """Where the mount truly looks, before, during and after two slews."""
    t = scenario_named("intelsat-14").t_start_utc_ns
    mount = make(
        latitude_deg=29.19,
        longitude_deg=-81.05,
        seed=1,
        t_utc_ns=t,
        ra_date_deg=200.0,
        dec_date_deg=-5.0,
    )
    mount.slew(215.0, -4.0, t + 5 * NS)
    mount.slew(216.0, -4.5, t + 60 * NS)
    seconds = np.array([1.0, 7.0, 11.0, 12.5, 30.0, 61.0, 63.0, 90.0])
    return [angle for s in seconds for angle in mount.boresight_date_deg(t + round(s * NS))]


def main() -> None:
    """Write the file."""
    frames = [frame_facts(*case) for case in (*CASES, WHOLE)]
    table = {"numpy": np.__version__, "mount": mount_facts(), "frames": frames}
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
