"""The drift between mount and stars, and the polar error it shows: against a turned mount."""

import math

import numpy as np
import pytest

from rsoconsole.simulator.mount.mount_model import MountTraits, systematic_error_deg
from rsoconsole.tracking import SolvedPointing, fit_drift, polar_hint

NS_PER_S = 1_000_000_000
SIDEREAL_DEG_S = 15.041 / 3600.0


def looks_of(
    hour_angle_deg: float,
    *,
    altitude_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    frames: int = 60,
    slew_every: int = 3,
    dec_deg: float = -5.0,
    turn_deg_h: float = 0.0,
) -> list[SolvedPointing]:
    """Frames of a mount that tracks, is sent on every few frames, and misses by 15 arcsec."""
    rng = np.random.default_rng(1)
    traits = MountTraits(
        polar_altitude_deg=altitude_deg,
        polar_azimuth_deg=azimuth_deg,
        cone_deg=0.0,
        tube_flexure_deg=0.0,
        random_arcsec=0.0,
    )
    looks, miss, ra = [], np.zeros(2), 10.0
    for n in range(frames):
        t_s = 30.0 * n
        if n % slew_every == 0:
            miss = rng.normal(0.0, 15.0 / 3600.0, 2)
            ra += 0.3
        h = hour_angle_deg + SIDEREAL_DEG_S * t_s
        east, north = systematic_error_deg(h, dec_deg, "west", 40.0, traits)
        noise = rng.normal(0.0, 0.1 / 3600.0, 2)
        plate = (
            ra + (east + miss[0] + noise[0]) / math.cos(math.radians(dec_deg)),
            dec_deg + north + miss[1] + noise[1],
        )
        looks.append(
            SolvedPointing(
                t_utc_ns=int(t_s * NS_PER_S),
                mount_icrs_deg=(ra, dec_deg),
                plate_icrs_deg=plate,
                rotation_deg=(359.99 + turn_deg_h * t_s / 3600.0) % 360.0,
            )
        )
    return looks


@pytest.mark.parametrize(
    ("hour_angle_deg", "altitude_deg", "azimuth_deg", "axis", "words"),
    [
        (-4.0, 0.0, 0.1, "azimuth", "too far east"),
        (-4.0, 0.0, -0.1, "azimuth", "too far west"),
        (-80.0, 0.1, 0.0, "altitude", "too low"),
        (70.0, 0.1, 0.0, "altitude", "too low"),
        (70.0, -0.1, 0.0, "altitude", "too high"),
    ],
)
def test_the_error_that_shows_at_an_hour_angle_is_found_with_its_side(
    hour_angle_deg, altitude_deg, azimuth_deg, axis, words
):
    looks = looks_of(hour_angle_deg, altitude_deg=altitude_deg, azimuth_deg=azimuth_deg)
    drift = fit_drift(looks)
    assert drift is not None
    middle = hour_angle_deg + drift.hours * 7.5
    hint = polar_hint(drift, middle, 40.0)
    assert (hint.axis, hint.words) == (axis, words)
    a_tenth_of_it = 0.6
    assert hint.error_arcmin == pytest.approx(6.0, abs=a_tenth_of_it)
    other = {"east": "west", "west": "east", "low": "high", "high": "low"}
    turned = " ".join(other.get(word, word) for word in words.split())
    assert polar_hint(drift, middle, -40.0).words == turned


def test_the_scatter_of_slews_is_no_drift():
    drift = fit_drift(looks_of(0.0, frames=60, slew_every=3))
    assert drift is not None
    assert abs(drift.north_arcsec_h.value) < 4.0 * drift.north_arcsec_h.sigma
    assert drift.north_arcsec_h.sigma < 5.0
    assert polar_hint(drift, 0.0, 40.0).words == ""
    # All in one, as if no slew were known, would not know it so well.
    one_slew = fit_drift(looks_of(0.0, frames=60, slew_every=1))
    assert one_slew is not None
    assert one_slew.north_arcsec_h.sigma > 2.0 * drift.north_arcsec_h.sigma


def test_a_field_that_turns_is_measured_through_north_and_since_the_flip():
    drift = fit_drift(looks_of(0.0, turn_deg_h=0.12))
    assert drift is not None
    assert drift.rotation_deg_h.value == pytest.approx(0.12, abs=0.001)
    before = [
        SolvedPointing(
            t_utc_ns=look.t_utc_ns - 3600 * NS_PER_S,
            mount_icrs_deg=look.mount_icrs_deg,
            plate_icrs_deg=look.plate_icrs_deg,
            rotation_deg=(look.rotation_deg + 180.0) % 360.0,
        )
        for look in looks_of(0.0)
    ]
    again = fit_drift([*before, *looks_of(0.0, turn_deg_h=0.12)])
    assert again == drift


def test_few_frames_or_a_short_while_say_nothing():
    assert fit_drift([]) is None
    assert fit_drift(looks_of(0.0, frames=4)) is None
    assert fit_drift(looks_of(0.0, frames=5)) is None  # two minutes
