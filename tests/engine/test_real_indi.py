"""Mount and camera against Debian's indiserver, telescope simulator and CCD simulator."""

import json
import subprocess
import sys
from math import cos, radians, sin, tan
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.sky import hours_to_deg, separation_deg, wrap_180
from tests.children.indi_clients import CLIENTS
from tests.rigs.network_namespace import namespace_for

pytestmark = [pytest.mark.indi_bin, pytest.mark.nightly("Debian's INDI server and drivers")]
ROOT = Path(__file__).resolve().parents[2]
NEEDED = (
    "indiserver",
    *(f"indi_simulator_{device}" for device in ("telescope", "ccd", "weather", "dome")),
)


@pytest.fixture(scope="module", params=CLIENTS)
def night(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    namespace = namespace_for(NEEDED, "indi-bin")
    # Sockets have short names: pytest's folders may be too deep.
    folder = tmp_path_factory.mktemp("indi")
    done = subprocess.run(
        [
            *namespace,
            sys.executable,
            "-m",
            "tests.real_sky.real_indi_night",
            str(folder),
            request.param,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    facts: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return facts


def test_the_mount_arrives_where_it_was_sent(night):
    one_arcmin = 1 / 60
    assert separation_deg(*night["target"], *night["arrived"]) < one_arcmin
    assert night["is_tracking"]


def test_the_driver_is_told_hours_in_epoch_of_date(night):
    # Precession in RA: m + n sin(ra) tan(dec), 46.1 and 20.0 arcsec a year (Meeus 1998, ch. 21).
    ra_deg, dec_deg = night["target"]
    years = night["t_utc_ns"] / 1e9 / 86400 / 365.25 - 30
    slope = sin(radians(ra_deg)) * tan(radians(dec_deg))
    precession_deg = (46.1 + 20.0 * slope) / 3600 * years
    nutation_and_aberration_deg = (17.2 + 20.5) / 3600 / cos(radians(dec_deg))
    ra_date_deg = hours_to_deg(night["on_the_wire"][0])
    shift_deg = wrap_180(ra_date_deg - ra_deg)
    assert shift_deg == pytest.approx(precession_deg, abs=nutation_and_aberration_deg)
    assert abs(shift_deg) > 2 * nutation_and_aberration_deg


def test_longitude_survives_the_wire_0_to_360(night):
    assert night["site_ok"]


def test_a_frame_arrives_with_its_start_and_length(night):
    frame = night["frame"]
    assert (frame["id"], frame["shape"], frame["dtype"]) == (7, [1024, 1280], "uint16")
    assert frame["exposure_s"] == 1.0
    assert 1.0 <= frame["age_s"] < 30.0
    # The header's J2000 pointing comes from the driver's own precession, not from ours.
    assert separation_deg(*night["target"], *frame["pointing"]) < 0.05


def test_a_part_of_the_sensor_is_read_and_its_corner_known_though_no_header_tells(night):
    assert night["parts"] == [
        [640, 512, "1x1", 320, 256],
        [320, 256, "2x2", 160, 128],
        [640, 512, "2x2", None, None],
        [1280, 1024, "1x1", None, None],
    ]


@pytest.mark.parametrize("path", ["mount", "indi", "still_mount", "still_indi"])
def test_stop_ends_a_slew_by_either_path_and_tracking_is_as_configured(night, path):
    stop = night[f"stop_by_{path}"]
    assert stop["was_slewing"]
    assert stop["is_answered"]
    assert stop["comes_to_rest"]
    is_wanted = not path.startswith("still")
    assert (stop["is_tracking_by_result"], stop["is_tracking"]) == (is_wanted, is_wanted)


def test_a_slew_that_nobody_watches_is_ended(night):
    assert not night["lease"]["is_slewing"]
    assert night["lease"]["is_tracking"]
    assert "nobody has watched this slew" in night["lease"]["said"][0]


def test_weather_and_dome_are_watched(night):
    # The dome simulator starts closed, and its shutter takes its time.
    assert night["sky"] == {"weather": "ok", "dome": ["closed", "moving", "open"], "detail": ""}


def test_the_mount_s_clock_is_the_machine_s(night):
    # The driver took it from the same machine when it was connected, in whole seconds.
    assert night["utc_offset_s"] == pytest.approx(0.0, abs=3.0)


def test_a_parked_mount_is_not_slewed_until_it_is_unparked(night):
    assert night["is_parked"]
    assert "unpark" in night["slew_while_parked"]
    assert not night["is_parked_after_unpark"]


@pytest.mark.parametrize("device", ["mount", "camera"])
def test_a_driver_that_is_started_again_is_connected_again(night, device):
    said = night["driver_dies"][device]
    assert said[-1] == "nothing", said
    assert len(said) <= 3, said
    assert all("is no longer connected" in words for words in said[:-1]), said


def test_a_dead_server_is_an_error_with_words(night):
    assert "start indiserver" in night["after_death"]
