"""The simulated mount's numbers: rates, settling, sides, errors."""

from itertools import pairwise
from math import hypot

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.simulator.mount.mount_model import (
    NS,
    MountModel,
    MountTraits,
    systematic_error_deg,
    travel_s,
    travelled_deg,
)
from rsoconsole.sky import lst_deg, separation_deg, wrap_180

T0 = 1_687_400_000 * NS
LATITUDE_DEG, LONGITUDE_DEG = 29.19, -81.05
SIDEREAL_DEG = float(lst_deg(LONGITUDE_DEG, T0))
ONE_ARCSEC = 1 / 3600


def make_model(hour_angle_deg: float = -30.0, dec_deg: float = -5.0, seed: int = 1) -> MountModel:
    return MountModel(
        latitude_deg=LATITUDE_DEG,
        longitude_deg=LONGITUDE_DEG,
        seed=seed,
        t_utc_ns=T0,
        ra_date_deg=(SIDEREAL_DEG - hour_angle_deg) % 360.0,
        dec_date_deg=dec_deg,
    )


def later(seconds: float) -> int:
    return T0 + round(seconds * NS)


def test_a_slew_takes_the_time_a_trapezoid_takes():
    # 20 deg at 4 deg/s with 2 deg/s^2: 2 s up, 2 s down (4 deg each), 12 deg at full rate in 3 s.
    assert travel_s(20.0, 4.0, 2.0) == pytest.approx(7.0)
    # 2 deg never reach full rate: 2 sqrt(2 / 2) s.
    assert travel_s(-2.0, 4.0, 2.0) == pytest.approx(2.0)


@given(st.floats(-200, 200), st.floats(0.5, 10), st.floats(0.5, 10))
def test_an_axis_never_exceeds_its_rate_and_ends_where_it_should(distance, rate, acceleration):
    total_s = travel_s(distance, rate, acceleration)
    steps = [travelled_deg(distance, total_s * k / 200, rate, acceleration) for k in range(201)]
    assert steps[0] == pytest.approx(0.0, abs=1e-9)
    assert steps[-1] == pytest.approx(distance)
    fastest = max(abs(b - a) for a, b in pairwise(steps))
    assert fastest <= rate * total_s / 200 * (1 + 1e-6) + 1e-9


def test_a_slew_arrives_at_its_target_and_stays_there():
    model = make_model()
    ra_deg, dec_deg = model.instant(T0).ra_date_deg - 10.0, 3.0
    duration_s = model.slew(ra_deg, dec_deg, T0)
    assert model.instant(later(duration_s - 0.1)).is_slewing
    for wait_s in (0.01, 3600.0):
        now = model.instant(later(duration_s + wait_s))
        assert not now.is_slewing
        assert separation_deg(now.ra_date_deg, now.dec_date_deg, ra_deg, dec_deg) < 1e-9


def test_a_slew_across_ra_0h_takes_the_short_way():
    model = make_model(hour_angle_deg=wrap_180(SIDEREAL_DEG - 359.0))
    assert model.slew(1.0, -5.0, T0) == pytest.approx(travel_s(2.0, 4.0, 2.0))


def test_the_swing_after_a_slew_is_gone_in_a_second_and_a_half():
    model = make_model()
    ra_deg = model.instant(T0).ra_date_deg + 10.0
    duration_s = model.slew(ra_deg, -5.0, T0)
    settled = model.boresight_date_deg(later(duration_s + 30.0))
    swing = separation_deg(*model.boresight_date_deg(later(duration_s + 0.01)), *settled)
    left = separation_deg(*model.boresight_date_deg(later(duration_s + 1.5)), *settled)
    assert swing > 10 * ONE_ARCSEC
    # The polar error's own drift over half a minute is part of it.
    assert left < ONE_ARCSEC


def test_without_tracking_the_sky_drifts_at_the_sidereal_rate():
    model = make_model()
    before = model.instant(T0)
    model.set_tracking(False, T0)
    after = model.instant(later(60.0))
    drift_arcsec = wrap_180(after.ra_date_deg - before.ra_date_deg) * 3600
    assert drift_arcsec == pytest.approx(15.041 * 60, abs=0.1)
    assert not after.is_tracking
    assert wrap_180(after.hour_angle_deg - before.hour_angle_deg) == pytest.approx(0, abs=1e-6)


def test_a_target_past_the_meridian_takes_the_other_side_of_the_pier():
    model = make_model(hour_angle_deg=-5.0)
    assert model.instant(T0).pier_side == "west"
    duration_s = model.slew(SIDEREAL_DEG - 10.0, -5.0, T0)
    assert duration_s > 40.0
    assert model.instant(later(duration_s)).pier_side == "east"


def test_just_past_the_meridian_the_mount_does_not_flip():
    model = make_model(hour_angle_deg=-5.0)
    duration_s = model.slew(SIDEREAL_DEG - 0.4, -5.0, T0)
    assert duration_s < 5.0
    assert model.instant(later(duration_s)).pier_side == "west"


def test_tracking_through_the_meridian_never_flips():
    model = make_model(hour_angle_deg=-1.0)
    assert model.instant(later(3600.0)).pier_side == "west"


def test_abort_stands_where_it_is_and_goes_on_tracking():
    model = make_model()
    model.slew(model.instant(T0).ra_date_deg + 40.0, -5.0, T0)
    model.abort(later(3.0))
    at_once, after = model.instant(later(3.0)), model.instant(later(60.0))
    assert not at_once.is_slewing
    assert at_once.is_tracking
    assert after.ra_date_deg == pytest.approx(at_once.ra_date_deg, abs=1e-9)


def test_a_parked_mount_stands_still_at_the_pole_until_released():
    model = make_model()
    duration_s = model.park(T0)
    assert model.instant(later(1.0)).is_slewing
    parked = model.instant(later(duration_s + 1))
    assert parked.is_parked
    assert not parked.is_tracking
    assert parked.dec_date_deg == pytest.approx(90.0)
    model.unpark(later(duration_s + 2))
    assert not model.instant(later(duration_s + 3)).is_parked


@pytest.mark.parametrize("hour_angle_deg", [-60.0, -20.0, 20.0, 60.0])
@pytest.mark.parametrize("dec_deg", [-10.0, 0.0, 10.0])
def test_systematic_errors_are_about_a_tenth_of_a_degree(hour_angle_deg, dec_deg):
    side = "west" if hour_angle_deg < 0 else "east"
    error = systematic_error_deg(hour_angle_deg, dec_deg, side, LATITUDE_DEG, MountTraits())
    assert 0.03 < hypot(*error) < 0.2


def test_a_flip_jumps_by_minutes_of_arc():
    west = systematic_error_deg(0.0, -5.0, "west", LATITUDE_DEG, MountTraits())
    east = systematic_error_deg(0.0, -5.0, "east", LATITUDE_DEG, MountTraits())
    assert hypot(east[0] - west[0], east[1] - west[1]) > 3 / 60


def test_repeated_slews_scatter_by_fifteen_arcsec():
    model = make_model()
    ra_deg = model.instant(T0).ra_date_deg
    errors = []
    for k in range(400):
        model.slew(ra_deg, -5.0, T0)
        errors.append(model.boresight_date_deg(later(5.0 + 0 * k)))
    mean = (sum(e[0] for e in errors) / 400, sum(e[1] for e in errors) / 400)
    rms_deg = (sum(separation_deg(*e, *mean) ** 2 for e in errors) / 400) ** 0.5
    # 400 draws in two axes know their scatter to 4 %.
    assert rms_deg * 3600 == pytest.approx(15.0, rel=0.12)


def test_the_same_seed_points_the_same_and_another_does_not():
    looks = []
    for seed in (1, 1, 2):
        model = make_model(seed=seed)
        model.slew(model.instant(T0).ra_date_deg + 5.0, -5.0, T0)
        looks.append(model.boresight_date_deg(later(60.0)))
    assert looks[0] == looks[1]
    assert looks[0] != looks[2]


def test_the_past_is_remembered_after_a_later_slew():
    model = make_model()
    before = model.boresight_date_deg(later(5.0))
    model.slew(model.instant(T0).ra_date_deg + 5.0, -5.0, later(10.0))
    assert model.boresight_date_deg(later(5.0)) == before
