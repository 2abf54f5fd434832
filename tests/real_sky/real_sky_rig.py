"""Debian's indiserver and simulators under a sky of ours, and an engine that looks at it.

    python -m tests.real_sky.real_sky_rig FOLDER

Run by real_sky_night.py inside a network namespace of its own, because indiserver listens on
every interface. The folder holds ``night.json`` (what is wanted) and gets the sky, the truth, the
session and the logs.
"""

import dataclasses
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from models.star_catalogue import catalogue_of, save
from rsoconsole.base import InstrumentError
from rsoconsole.config import Config, config_to_toml
from rsoconsole.instruments import IndiWire
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.orbits import ElementSet, MeanElements, Satellite
from rsoconsole.orbits.elements.sgp4_fit import TLE_STEP_NS
from rsoconsole.records import Site
from rsoconsole.simulator.sky.star_background import faint_stars
from rsoconsole.sky import StarCatalogue, Stars, hour_angle_icrs_deg, icrs_of_hour_angle, sun_icrs
from tests.real_sky.gsc_sky import Sky, serving
from tests.rigs.whole_engine import COMMAND
from tests.truth.ccd_law import CcdLaw
from tests.truth.sidereal import gmst_deg

PORT = 7624
MOUNT, CAMERA = "Telescope Simulator", "CCD Simulator"
HOUR_ANGLE_DEG = -35.0
"""Of the satellite followed: high, outside the Earth's shadow, and hours from the meridian."""
LATITUDE_DEG = 29.19
OFF_DEG = 0.2
"""The telescope's first field is beside the satellite, which still lies in it."""
NEIGHBOUR_DEG = 1.5
STANDARD_MAG = 11.6
"""Gives an integrated signal to noise near 110 in 10 s with the simulator's own settings."""
FAINTEST_MAG = 15.0
NUMBERS = {80001: "NIGHT ONE", 80002: "NIGHT TWO"}
LIFTED = ("clock", "disk")
"""Of the arming list: a machine in a container keeps no clock of its own, and the disk has room."""


def site_at_midnight(t_utc_ns: int) -> Site:
    """A site at the paper's latitude where the Sun stands lowest now."""
    ra_deg, dec_deg = sun_icrs(t_utc_ns)
    here = Site(latitude_deg=LATITUDE_DEG, longitude_deg=0.0, elevation_m=10.0)
    sun_deg = hour_angle_icrs_deg(here, ra_deg, dec_deg, t_utc_ns)
    longitude_deg = (180.0 - sun_deg + 180.0) % 360.0 - 180.0
    return Site(latitude_deg=LATITUDE_DEG, longitude_deg=longitude_deg, elevation_m=10.0)


def geostationary(site: Site, t_utc_ns: int, west_deg: float, norad_id: int) -> ElementSet:
    """Elements of now for a slot that far west of a site's meridian."""
    epoch_ns = t_utc_ns // TLE_STEP_NS * TLE_STEP_NS
    raan_deg, argp_deg = 330.0, 126.0
    along_deg = float(np.squeeze(gmst_deg(epoch_ns))) + site.longitude_deg - west_deg
    return MeanElements(
        name=NUMBERS[norad_id],
        norad_id=norad_id,
        epoch_utc_ns=epoch_ns,
        revolutions_a_day=1.00271,
        e=0.00023,
        i_deg=0.04,
        raan_deg=raan_deg,
        argp_deg=argp_deg,
        m_deg=(along_deg - raan_deg - argp_deg) % 360.0,
        bstar=0.0,
        rms_arcsec=0.0,
    ).element_set()


def make_sky(folder: Path, t_utc_ns: int, wanted: dict[str, Any]) -> Sky:
    """Two geostationary satellites of today before the stars of the catalogue and fainter ones."""
    site = site_at_midnight(t_utc_ns)
    slots = {80001: HOUR_ANGLE_DEG, 80002: HOUR_ANGLE_DEG - NEIGHBOUR_DEG}
    sets = [geostationary(site, t_utc_ns, west, number) for number, west in slots.items()]
    elements = folder / "elements.tle"
    text = "".join(f"{each.name}\n{each.line_1}\n{each.line_2}\n" for each in sets)
    elements.write_text(text, encoding="ascii")
    stars = folder / "stars.npz"
    at = Satellite(sets[0]).astrometric_place(site, np.array([t_utc_ns], np.int64))
    save(_stars(float(at.ra_icrs_deg[0]) + 5.0, float(at.dec_icrs_deg[0])), stars)
    return Sky(
        site=site,
        elements=elements,
        magnitudes=dict.fromkeys(slots, wanted.get("standard_mag", STANDARD_MAG)),
        truth=folder / "truth.jsonl",
        law=CcdLaw(),
        stars=stars,
        exposure_s=wanted["exposure_s"],
        seed=wanted["seed"],
        scatter_s=wanted["scatter_s"],
    )


def _stars(ra_deg: float, dec_deg: float) -> StarCatalogue:
    """The catalogue's, and as many fainter ones around the belt as the real sky has."""
    known = StarCatalogue.load()
    bright = known.cone(ra_deg, dec_deg, 12.0)
    pieces = [faint_stars(ra_deg + off, dec_deg, 3.0, FAINTEST_MAG) for off in range(-10, 11, 5)]
    columns = [
        np.concatenate([getattr(each, name) for each in (bright, *pieces)])
        for name in ("ra_icrs_deg", "dec_icrs_deg", "magnitude", "pm_ra_mas_yr", "pm_dec_mas_yr")
    ]
    # The pieces overlap in whole cells: a star is one row, however often it is told.
    rows = np.unique(np.stack(columns, -1), axis=0)
    return catalogue_of(Stars.without_colour(*rows.T), known.dec_min_deg, known.dec_max_deg)


def config_of(sky: Sky, wanted: dict[str, Any], folder: Path) -> Config:
    """What an operator of this telescope would write."""
    law = sky.law
    sections: dict[str, dict[str, Any]] = {
        "site": {"name": "under a sky of ours", **dataclasses.asdict(sky.site)},
        "optics": {
            "focal_length_mm": law.focal_length_mm,
            "pixel_um": law.pixel_um,
            "width_px": law.width_px,
            "height_px": law.height_px,
        },
        "indi": {"port": PORT, "mount": MOUNT, "camera": CAMERA},
        "exposure": {"exposure_s": wanted["exposure_s"], "cadence_s": wanted["cadence_s"]},
        "catalogue": {"tle_files": [str(sky.elements)]},
        "session": {"root": str(folder / "sessions"), "keep_frames": wanted["keep_frames"]},
    }
    for name, table in wanted["settings"].items():
        sections[name] = {**sections.get(name, {}), **table}
    return Config.model_validate(sections)


@contextmanager
def indiserver(folder: Path) -> Iterator[None]:
    """Both simulators, with the folder's commands before any others of their names."""
    environment = {
        **os.environ,
        "HOME": str(folder),
        "PATH": f"{folder}:{os.environ['PATH']}",
    }
    command = ["indiserver", "-p", str(PORT), "-u", str(folder / "indi.sock")]
    command += ["indi_simulator_telescope", "indi_simulator_ccd"]
    with (folder / "indiserver.log").open("wb") as log:
        server = subprocess.Popen(command, stderr=log, stdout=log, env=environment)
    try:
        yield
    finally:
        server.terminate()
        server.wait()


def set_camera(law: CcdLaw) -> None:
    """Size, pixels and telescope; all else as the simulator comes."""
    wire = _wire()
    wire.ask(CAMERA)
    _await(wire, CAMERA, "CONNECTION")
    wire.new("Switch", CAMERA, "CONNECTION", {"CONNECT": "On"})
    _await(wire, CAMERA, "SCOPE_INFO")
    wire.new("Number", CAMERA, "SCOPE_INFO", {"FOCAL_LENGTH": str(law.focal_length_mm)})
    size = {"SIM_XRES": law.width_px, "SIM_YRES": law.height_px}
    size |= {"SIM_XSIZE": law.pixel_um, "SIM_YSIZE": law.pixel_um}
    wire.new("Number", CAMERA, "SIMULATOR_SETTINGS", {k: str(v) for k, v in size.items()})
    while float(_await(wire, CAMERA, "SIMULATOR_SETTINGS")["SIM_XRES"]) != law.width_px:
        pass
    wire.close()


def settings_of_camera() -> dict[str, dict[str, float]]:
    """What the simulator says of itself, to be held against ``CcdLaw``."""
    wire = _wire()
    names = ("SIMULATOR_SETTINGS", "SCOPE_INFO", "SIM_FOCUSING", "CCD_GAIN", "CCD_OFFSET")
    found = {}
    for name in names:
        wire.ask(CAMERA, name)
        values = _await(wire, CAMERA, name)
        found[name] = {key: float(value) for key, value in values.items()}
    wire.close()
    return found


def point(sky: Sky, config: Config, folder: Path) -> None:
    """The mount unparked, at its site, tracking beside the satellite."""
    mount = IndiMount(config.indi, folder / "pointing.log", config.mount)
    mount.start()
    try:
        mount.set_site(sky.site)
        mount.unpark()
        now_utc_ns = time.time_ns()
        satellite = sky.satellites()[0]
        at = satellite.astrometric_place(sky.site, np.array([now_utc_ns], np.int64))
        ra_deg, dec_deg = float(at.ra_icrs_deg[0]), float(at.dec_icrs_deg[0])
        hour_angle_deg = hour_angle_icrs_deg(sky.site, ra_deg, dec_deg, now_utc_ns)
        # The simulator loses the sky's motion during a long slew; a short one makes it good.
        for _ in range(2):
            now_utc_ns = time.time_ns()
            aim_deg = icrs_of_hour_angle(sky.site, hour_angle_deg + OFF_DEG, dec_deg, now_utc_ns)
            mount.slew(aim_deg[0], aim_deg[1], now_utc_ns)
            while mount.report().is_slewing:
                time.sleep(0.2)
    finally:
        mount.close()


def run_engine(config: Config, wanted: dict[str, Any], folder: Path) -> int:
    """``rsoconsole engine``, armed, until it has taken its frames; its exit status."""
    file = folder / "config.toml"
    file.write_text(config_to_toml(config), encoding="utf-8")
    run = folder / "run"
    run.mkdir(mode=0o700)
    homes = {f"XDG_{name}_HOME": str(folder / name) for name in ("DATA", "STATE", "CACHE")}
    environment = {**os.environ, **homes, "XDG_RUNTIME_DIR": str(run)}
    command = [*COMMAND, "engine", "--config", str(file), "--session", str(folder / "session")]
    command += ["--arm", "--frames", str(wanted["frames"])]
    command += [word for name in LIFTED for word in ("--override", name)]
    with (folder / "engine.log").open("wb") as log:
        return subprocess.run(
            command, env=environment, stdout=log, stderr=log, check=False
        ).returncode


def main(folder: Path) -> None:
    """One night, as ``night.json`` wants it."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    wanted = json.loads((folder / "night.json").read_text(encoding="utf-8"))
    sky = make_sky(folder, time.time_ns(), wanted)
    sky.save(folder / "sky.json")
    config = config_of(sky, wanted, folder)
    with serving(sky, folder), indiserver(folder):
        set_camera(sky.law)
        (folder / "camera.json").write_text(json.dumps(settings_of_camera()), encoding="utf-8")
        point(sky, config, folder)
        status = run_engine(config, wanted, folder)
    (folder / "engine_status").write_text(str(status), encoding="ascii")


def _wire() -> IndiWire:
    for _ in range(100):
        try:
            return IndiWire("127.0.0.1", PORT)
        except InstrumentError:
            time.sleep(0.1)
    raise AssertionError("indiserver does not listen")


def _await(wire: IndiWire, device: str, name: str) -> dict[str, Any]:
    vector = wire.wait(lambda each: each.device == device and each.name == name, 10.0)
    assert vector is not None, f"{device} does not tell {name}"
    return dict(vector.values)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
