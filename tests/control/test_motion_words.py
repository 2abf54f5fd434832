"""What the status line says of the mount's motion: measured where it is, else its driver's word."""

import pytest

from rsoconsole.control import Status, motion_words


@pytest.mark.parametrize(
    ("status", "says"),
    [
        (Status(mount_motion="tracks", is_tracking=False), "tracks, measured"),
        (Status(mount_motion="stands", is_tracking=True), "stands, measured"),
        (
            Status(mount_motion="moves", mount_rate_deg_s=3.2, is_tracking=True),
            "moves at 3.2 deg/s, measured",
        ),
        (
            Status(mount_motion="moves", mount_rate_deg_s=0.25, is_slewing=False),
            "moves at 0.2 deg/s, measured",
        ),
        (
            Status(mount_motion="moves", mount_rate_deg_s=0.01),
            "moves at 36 arcsec/s, measured",
        ),
        (Status(mount_motion="unknown", is_tracking=True), "tracks by its driver's word"),
        (Status(mount_motion="unknown", is_tracking=False), "stands by its driver's word"),
        (Status(is_tracking=True), "tracks by its driver's word"),
        (Status(), "how it moves is not known"),
        (Status(is_slewing=True, slew_left_s=23.4), "slewing, 23 s left"),
        (Status(is_slewing=True, is_parking=True), "parking"),
        (
            Status(is_slewing=True, mount_motion="moves", mount_rate_deg_s=3.0, slew_left_s=9.0),
            "slewing, 9 s left",
        ),
        (Status(is_slewing=True, mount_motion="tracks"), "slewing, but it tracks, measured"),
        (Status(is_parked=True), "parked"),
        (Status(is_parked=True, mount_motion="stands"), "parked"),
        (Status(is_parked=True, mount_motion="tracks"), "parked, but it tracks, measured"),
        (
            Status(is_parked=True, mount_motion="moves", mount_rate_deg_s=3.2),
            "parked, but it moves at 3.2 deg/s, measured",
        ),
    ],
)
def test_measured_before_claimed(status: Status, says: str):
    assert motion_words(status) == says
