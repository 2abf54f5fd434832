"""The loop's own pointing offset: learnt, filtered, kept by side and place, dropped in time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.sky import lst_deg, pier_side, separation_deg, wrap_180
from rsoconsole.tracking import CLIP_ARCSEC, PointingModel, pointing_command, with_solved_frame
from rsoconsole.tracking.pointing import LARGE_SLEW_DEG, NO_OFFSET
from tests.tiers import plain_first

RA_DEG, DEC_DEG = 150.0, -5.0


def seen(
    model: PointingModel,
    east_arcsec: float,
    north_arcsec: float = 0.0,
    *,
    hour_angle_deg: float = -30.0,
    pier_side: str | None = "west",
) -> PointingModel:
    """The model after a frame whose centre lay so far beside the commanded place."""
    return with_solved_frame(
        model,
        commanded_ra_deg=RA_DEG,
        commanded_dec_deg=DEC_DEG,
        solved_ra_deg=RA_DEG + east_arcsec / 3600.0 / math.cos(math.radians(DEC_DEG)),
        solved_dec_deg=DEC_DEG + north_arcsec / 3600.0,
        hour_angle_deg=hour_angle_deg,
        declination_deg=DEC_DEG,
        pier_side=pier_side,  # type: ignore[arg-type]
    )


@given(
    ra_deg=st.floats(0, 359.99),
    dec_deg=st.floats(-80, 80),
    east_arcsec=st.floats(-600, 600),
    north_arcsec=st.floats(-600, 600),
)
def test_one_frame_is_enough_to_land_where_it_is_wanted(ra_deg, dec_deg, east_arcsec, north_arcsec):
    """A mount that is always wrong by as much on the sky, anywhere, across RA 0h too."""

    def looks(sent: tuple[float, float]) -> tuple[float, float]:
        cos_dec = math.cos(math.radians(sent[1]))
        return (sent[0] + east_arcsec / 3600.0 / cos_dec) % 360.0, sent[1] + north_arcsec / 3600.0

    wanted = (ra_deg, dec_deg)
    model = with_solved_frame(
        PointingModel(),
        commanded_ra_deg=ra_deg,
        commanded_dec_deg=dec_deg,
        solved_ra_deg=looks(wanted)[0],
        solved_dec_deg=looks(wanted)[1],
        hour_angle_deg=0.0,
        declination_deg=dec_deg,
        pier_side="west",
    )
    landed = looks(pointing_command(model.last, *wanted))
    # What is left grows with the square of the offset and towards the pole: 600" at 80 deg.
    assert separation_deg(*landed, *wanted) * 3600.0 < 15.0


def test_what_is_random_is_filtered():
    model = seen(PointingModel(), 300.0)
    model = seen(model, 340.0)
    assert model.last.east_arcsec == pytest.approx(320.0, abs=0.1)
    assert model.last.samples == 2


@pytest.mark.parametrize(
    ("hour_angle_deg", "pier_side", "is_kept"),
    [
        (-30.0, "west", True),
        (-30.0 + LARGE_SLEW_DEG - 1.0, "west", True),
        (-30.0 + LARGE_SLEW_DEG + 1.0, "west", False),
        (-30.0, "east", False),
        (-30.0, None, False),
    ],
    ids=["same place", "small slew", "large slew", "flip", "side untold"],
)
def test_the_offset_is_dropped_after_a_flip_or_a_large_slew(hour_angle_deg, pier_side, is_kept):
    model = seen(PointingModel(), 300.0)
    offset = model.at(hour_angle_deg, DEC_DEG, pier_side)
    assert (offset.east_arcsec == pytest.approx(300.0, abs=0.1)) is is_kept
    if not is_kept:
        assert offset == NO_OFFSET
        after = seen(model, -200.0, hour_angle_deg=hour_angle_deg, pier_side=pier_side)
        assert after.last.east_arcsec == pytest.approx(-200.0, abs=0.1)
        assert after.last.samples == 1


def test_the_other_side_is_remembered_for_the_return_and_relearnt_whole():
    model = seen(seen(PointingModel(), 300.0), 310.0)
    model = seen(model, -200.0, hour_angle_deg=20.0, pier_side="east")
    back = model.at(-31.0, DEC_DEG, "west")
    assert (back.east_arcsec, back.samples) == (pytest.approx(305.0, abs=0.1), 0)
    model = seen(model, 360.0, hour_angle_deg=-31.0)
    assert model.last.east_arcsec == pytest.approx(360.0, abs=0.1)
    assert len(model.offsets) == 2


def test_places_of_a_list_are_remembered_each_and_a_sweep_leaves_one_trail():
    model = PointingModel()
    for hour_angle_deg, east_arcsec in ((-40.0, 100.0), (-20.0, 200.0), (-15.0, 220.0)):
        model = seen(model, east_arcsec, hour_angle_deg=hour_angle_deg)
    assert len(model.offsets) == 2
    assert model.at(-41.0, DEC_DEG, "west").east_arcsec == pytest.approx(100.0, abs=0.1)
    assert model.at(-41.0, DEC_DEG, "west").samples == 0
    assert model.at(-16.0, DEC_DEG, "west").samples == 2


def test_a_mount_that_was_synced_by_hand_is_believed_at_once():
    model = seen(seen(PointingModel(), 300.0), 300.0)
    assert seen(model, 0.0).last.east_arcsec == pytest.approx(0.0, abs=1e-6)


def test_an_offset_never_grows_beyond_its_clip():
    model = seen(PointingModel(), 3.0 * CLIP_ARCSEC, -2.0 * CLIP_ARCSEC)
    assert (model.last.east_arcsec, model.last.north_arcsec) == (CLIP_ARCSEC, -CLIP_ARCSEC)


def test_nothing_known_changes_nothing():
    assert pointing_command(PointingModel().at(0.0, 0.0, "west"), RA_DEG, DEC_DEG) == (
        RA_DEG,
        DEC_DEG,
    )


def errors_arcmin(seed: int, places: list[tuple[float, float]]) -> list[float]:
    """How far the simulated mount, led by the model, looks beside each (hour angle, dec)."""
    t_ns = 1_687_400_000_000_000_000
    mount = MountModel(
        latitude_deg=29.19,
        longitude_deg=-81.05,
        seed=seed,
        t_utc_ns=t_ns,
        ra_date_deg=0.0,
        dec_date_deg=0.0,
    )
    model, errors = PointingModel(), []
    for hour_angle_deg, dec_deg in places:
        ra_deg = (float(lst_deg(-81.05, t_ns)) - hour_angle_deg) % 360.0
        offset = model.at(hour_angle_deg, dec_deg, pier_side(hour_angle_deg))
        sent = pointing_command(offset, ra_deg, dec_deg)
        mount.slew(*sent, t_ns)
        t_ns += 90_000_000_000
        looks = mount.boresight_date_deg(t_ns)
        errors.append(separation_deg(*looks, ra_deg, dec_deg) * 60.0)
        model = with_solved_frame(
            model,
            commanded_ra_deg=sent[0],
            commanded_dec_deg=sent[1],
            solved_ra_deg=looks[0],
            solved_dec_deg=looks[1],
            hour_angle_deg=wrap_180(float(lst_deg(-81.05, t_ns)) - sent[0]),
            declination_deg=sent[1],
            pier_side=mount.instant(t_ns).pier_side,
        )
    return errors


@pytest.mark.parametrize("dec_deg", plain_first(1, [-4.7, -20.0, 35.0]))
def test_forty_mounts_land_within_two_arcmin_after_three_frames_and_again_after_a_flip(
    dec_deg,
):
    """Each draws its own random errors; polar axis, cone, flexure and flip jump are in all."""
    east, west = [(-25.0, dec_deg)] * 5, [(30.0, dec_deg)] * 5
    found = np.array([errors_arcmin(seed, east + west + east) for seed in range(40)])
    two_arcmin = 2.0
    assert np.max(found[:, 3:5]) < two_arcmin
    assert np.max(found[:, 8:10]) < two_arcmin
    assert np.max(found[:, 10:]) < two_arcmin  # the return needs no frame at all
    # Without what was learnt it would not be so: each first frame on a side is far off.
    assert np.min(found[:, [0, 5]]) > two_arcmin
    one_sigma_of_a_slew = 15.0 / 60.0
    assert np.sqrt(np.mean(found[:, 8:10] ** 2)) < 2.0 * one_sigma_of_a_slew
