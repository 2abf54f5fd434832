"""A short night with Debian's indiserver and simulators; prints what happened as JSON.

Run by test_real_indi.py inside a network namespace of its own, because indiserver listens on
every interface.
"""

import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import IndiWire, Instruments, MountReport, connect_instruments
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.sky import icrs_of_hour_angle

PORT = 7624
MOUNT = "Telescope Simulator"


def main(folder: Path, client: str) -> None:
    """Slews, a frame, stops, parking, weather and dome, the deaths of drivers and of the server."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    command = ["indiserver", "-p", str(PORT), "-u", str(folder / "indi.sock")]
    command += ["indi_simulator_telescope", "indi_simulator_ccd"]
    command += ["indi_simulator_weather", "indi_simulator_dome"]
    with (folder / "indiserver.log").open("wb") as log:
        server = subprocess.Popen(
            command, stderr=log, stdout=log, env={**os.environ, "HOME": str(folder)}
        )
    try:
        wait_for_server()
        indi = {
            "port": PORT,
            "client": client,
            "weather": "Weather Simulator",
            "dome": "Dome Simulator",
        }
        optics = {"width_px": 1280, "height_px": 1024}
        config = Config.model_validate({"indi": indi, "optics": optics})
        with connect_instruments(config, log_dir=folder) as instruments:
            facts = night(instruments, config)
            facts["sky"] = weather_and_dome(instruments)
            facts["lease"] = unwatched_slew(instruments, config)
            facts["driver_dies"] = drivers_die(server.pid, instruments, config)
            still = config.mount.model_copy(update={"after_stop": "stand still"})
            mount = IndiMount(config.indi, folder / "still.log", still)
            mount.start()
            facts["stop_by_still_mount"] = stop_by("mount", mount, config, "stand still")
            facts["stop_by_still_indi"] = stop_by("indi", mount, config, "stand still")
            mount.close()
            server.terminate()
            server.wait()
            facts["after_death"] = what_happens(lambda: report_until_it_fails(instruments))
    finally:
        server.terminate()
        server.wait()
    print(json.dumps(facts))


def night(instruments: Instruments, config: Config) -> dict[str, Any]:
    """What a good night shows."""
    mount, camera, clock = instruments.mount, instruments.camera, instruments.clock
    site = config.site.to_site()
    mount.set_site(site)
    mount.unpark()
    facts: dict[str, Any] = {"site_ok": mount.check_site(site).is_consistent}

    now_utc_ns = clock.now_utc_ns()
    ra_deg, dec_deg = (float(a) for a in icrs_of_hour_angle(site, -30.0, 55.0, now_utc_ns))
    # The simulator loses the sky's motion during a long slew; a second, short one makes it good.
    for _ in range(2):
        mount.slew(ra_deg, dec_deg, clock.now_utc_ns())
        arrived = wait_for_arrival(instruments)
    facts["t_utc_ns"] = now_utc_ns
    facts["target"] = [ra_deg, dec_deg]
    facts["arrived"] = [arrived.ra_icrs_deg, arrived.dec_icrs_deg]
    facts["is_tracking"] = arrived.is_tracking
    facts["on_the_wire"] = coordinates_on_the_wire()

    camera.start_exposure(1.0, 7)
    frame = camera.wait_frame(30.0)
    facts["frame"] = {
        "id": frame.frame_id,
        "shape": frame.pixels.shape,
        "dtype": str(frame.pixels.dtype),
        "exposure_s": frame.exposure_s,
        "age_s": (clock.now_utc_ns() - (frame.t_start_utc_ns or 0)) / 1e9,
        "pointing": [frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg],
    }

    facts["parts"] = parts_of_the_sensor(camera)
    for path in ("mount", "indi"):
        facts[f"stop_by_{path}"] = stop_by(path, mount, config, "track")
    facts["utc_offset_s"] = mount.utc_offset_s()

    mount.park()
    facts["is_parked"] = wait_for_arrival(instruments).is_parked
    facts["slew_while_parked"] = what_happens(
        lambda: mount.slew(ra_deg, dec_deg, clock.now_utc_ns())
    )
    mount.unpark()
    facts["is_parked_after_unpark"] = mount.report().is_parked
    return facts


def parts_of_the_sensor(camera: Any) -> list[list[Any]]:
    """Half of each side, plain and joined, and all of it again: size, binning and corner."""
    found = []
    modes = ((1, 0.5), (2, 0.5), (2, 1.0), (1, 1.0))
    for number, (binning, share) in enumerate(modes, 8):
        camera.set_binning(binning)
        camera.set_subframe(share)
        camera.start_exposure(0.1, number)
        frame = camera.wait_frame(30.0)
        mode = frame.camera
        found.append([frame.width_px, frame.height_px, mode.binning, mode.x0_px, mode.y0_px])
    return found


def stop_by(path: str, mount: Any, config: Config, after_stop: Any) -> dict[str, Any]:
    """A slew of 90 degrees and more, ended after half a second."""
    now_utc_ns = time.time_ns()
    site = config.site.to_site()
    # Back and forth, so that there is always some way to go.
    hour_angle_deg = -50.0 if mount.report().dec_icrs_deg > 20.0 else 50.0
    dec_deg = -20.0 if mount.report().dec_icrs_deg > 20.0 else 60.0
    ra_deg, dec_deg = (
        float(a) for a in icrs_of_hour_angle(site, hour_angle_deg, dec_deg, now_utc_ns)
    )
    mount.slew(ra_deg, dec_deg, now_utc_ns)
    time.sleep(0.5)
    was_slewing = mount.report().is_slewing
    result = (
        mount.abort()
        if path == "mount"
        else stop_mount("127.0.0.1", PORT, MOUNT, after_stop=after_stop)
    )
    rests = comes_to_rest(mount)
    # The driver tells what it makes of tracking at its own pace.
    time.sleep(1.0)
    return {
        "was_slewing": was_slewing,
        "is_answered": result.is_answered,
        "ms": result.ms,
        "is_tracking_by_result": result.is_tracking,
        "comes_to_rest": rests,
        "is_tracking": mount.report().is_tracking,
    }


def weather_and_dome(instruments: Instruments) -> dict[str, Any]:
    """What the safety monitor says at first, and when the dome has been opened."""
    safety_monitor = instruments.safety_monitor
    assert safety_monitor is not None
    first = safety_monitor.look()
    seen = [first.dome]
    wire = IndiWire("127.0.0.1", PORT)
    wire.new("Switch", "Dome Simulator", "DOME_SHUTTER", {"SHUTTER_OPEN": "On"})
    for _ in range(200):
        word = safety_monitor.look().dome
        seen += [word] if word not in seen[-1:] else []
        if word == "open":
            break
        time.sleep(0.1)
    wire.close()
    return {"weather": first.weather, "dome": seen, "detail": first.detail}


def unwatched_slew(instruments: Instruments, config: Config) -> dict[str, Any]:
    """A slew whose lease runs out: nobody asks anything meanwhile."""
    mount: Any = instruments.mount
    now_utc_ns = time.time_ns()
    ra_deg, dec_deg = icrs_of_hour_angle(config.site.to_site(), 60.0, -20.0, now_utc_ns)
    mount.slew(float(ra_deg), float(dec_deg), now_utc_ns)
    mount.keep(0.5, None)
    time.sleep(2.5)
    report = mount.report()
    # It would end anybody's slew: from now on somebody watches.
    mount.keep(600.0, None)
    return {
        "said": mount.take_messages(),
        "is_slewing": report.is_slewing,
        "is_tracking": report.is_tracking,
    }


def drivers_die(server: int, instruments: Instruments, config: Config) -> dict[str, Any]:
    """Mount's and camera's drivers are killed; indiserver starts them again, unconnected."""
    subprocess.run(["pkill", "-KILL", "-P", str(server), "indi_simulator"], check=True)
    clock = instruments.clock

    def slew() -> None:
        now_utc_ns = clock.now_utc_ns()
        ra_deg, dec_deg = icrs_of_hour_angle(config.site.to_site(), -20.0, 40.0, now_utc_ns)
        instruments.mount.slew(float(ra_deg), float(dec_deg), now_utc_ns)

    def take_frame() -> None:
        instruments.camera.start_exposure(1.0, 8)
        instruments.camera.wait_frame(10.0)

    return {"mount": words_until_done(slew), "camera": words_until_done(take_frame)}


def words_until_done(act: Any) -> list[str]:
    """What each try said until one went well; at most for half a minute."""
    said, ends_s = list[str](), time.monotonic() + 30.0
    while time.monotonic() < ends_s:
        said.append(what_happens(act))
        if said[-1] == "nothing":
            break
        time.sleep(0.2)
    return said


def wait_for_server() -> None:
    """Until somebody listens."""
    for _ in range(100):
        try:
            IndiWire("127.0.0.1", PORT, 0.2).close()
        except InstrumentError:
            time.sleep(0.1)
        else:
            return


def wait_for_arrival(instruments: Instruments) -> MountReport:
    """The first report that neither slews nor parks."""
    for _ in range(400):
        report = instruments.mount.report()
        if not (report.is_slewing or report.is_parking):
            return report
        time.sleep(0.1)
    raise AssertionError("the mount never arrived")


def comes_to_rest(mount: Any) -> bool:
    """Whether the mount's own process hears of the end of motion within a second."""
    for _ in range(20):
        if not mount.report().is_slewing:
            return True
        time.sleep(0.05)
    return False


def coordinates_on_the_wire() -> list[float]:
    """RA in hours and Dec in degrees as the driver says them to anybody."""

    def is_wanted(vector: IndiVector) -> bool:
        return vector.name == "EQUATORIAL_EOD_COORD"

    wire = IndiWire("127.0.0.1", PORT)
    wire.ask(MOUNT, "EQUATORIAL_EOD_COORD")
    vector = wire.wait(is_wanted, 5.0)
    wire.close()
    assert vector is not None
    return [float(vector.values["RA"]), float(vector.values["DEC"])]


def report_until_it_fails(instruments: Instruments) -> None:
    """Ask until the mount's process has noticed that the server is gone."""
    for _ in range(50):
        report = instruments.mount.report(timeout_s=2.0)
        assert math.isfinite(report.ra_icrs_deg)
        time.sleep(0.1)


def what_happens(act: Any) -> str:
    """The words of the InstrumentError, or that there was none."""
    try:
        act()
    except InstrumentError as error:
        return str(error)
    return "nothing"


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
