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

from rsoconsole.config import Config
from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.connect import connect_instruments
from rsoconsole.instruments.indi_wire import IndiVector, IndiWire, stop_mount
from rsoconsole.instruments.ports import Instruments, MountReport
from rsoconsole.sky.frames import icrs_of_hour_angle

PORT = 7624
MOUNT = "Telescope Simulator"


def main(folder: Path) -> None:
    """One slew, one frame, two stops, parking, and the death of the server."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    command = ["indiserver", "-p", str(PORT), "-u", str(folder / "indi.sock")]
    command += ["indi_simulator_telescope", "indi_simulator_ccd"]
    with (folder / "indiserver.log").open("wb") as log:
        server = subprocess.Popen(
            command, stderr=log, stdout=log, env={**os.environ, "HOME": str(folder)}
        )
    try:
        wait_for_server()
        config = Config.model_validate({"indi": {"port": PORT}})
        with connect_instruments(config, log_dir=folder) as instruments:
            facts = night(instruments, config)
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

    for path in ("mount", "indi"):
        mount.slew(ra_deg + 60.0, dec_deg - 30.0, clock.now_utc_ns())
        time.sleep(0.5)
        was_slewing = mount.report().is_slewing
        result = mount.abort() if path == "mount" else stop_mount("127.0.0.1", PORT, MOUNT)
        facts[f"stop_by_{path}"] = {
            "was_slewing": was_slewing,
            "stopped": result.stopped,
            "ms": result.ms,
            "comes_to_rest": comes_to_rest(instruments),
        }

    mount.park()
    facts["is_parked"] = wait_for_arrival(instruments).is_parked
    facts["slew_while_parked"] = what_happens(
        lambda: mount.slew(ra_deg, dec_deg, clock.now_utc_ns())
    )
    mount.unpark()
    facts["is_parked_after_unpark"] = mount.report().is_parked
    return facts


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
    """The first report that does not slew."""
    for _ in range(400):
        report = instruments.mount.report()
        if not report.is_slewing:
            return report
        time.sleep(0.1)
    raise AssertionError("the mount never arrived")


def comes_to_rest(instruments: Instruments) -> bool:
    """Whether the mount's own process hears of the end of motion within a second."""
    for _ in range(20):
        if not instruments.mount.report().is_slewing:
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
    main(Path(sys.argv[1]))
