"""Satellites that flash and fade, clouds, the Moon, and what else crosses, in the pixels."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator.sky.brightness import world_extra_mag
from rsoconsole.simulator.world.world import SatelliteWorld
from tests.rigs.world_rig import (
    SCALE_ARCSEC_PX,
    STRIP,
    centre_and_spread,
    expose,
    stamps,
    streak_along,
)
from tests.truth.frame_truth import truth_from_json

TINY = OpticsConfig(width_px=80, height_px=80)


def test_a_satellite_flashes_with_its_period_duty_and_depth(monkeypatch):
    world = {"satellite": {"flash_period_s": 2.5, "flash_duty": 0.3, "flash_depth_mag": 2.0}}
    frame = expose(
        monkeypatch, world, stars=False, satellite_mag=8.5, exposure_s=20.0, optics=STRIP
    )
    truth = frame.truth.satellites[0]
    first, last = sorted((truth.x_start_px, truth.x_end_px))
    light = streak_along(frame)[round(first) + 4 : round(last) - 4]
    period_px = 2.5 * (last - first) / 20.0
    columns = np.arange(len(light))
    waves = [
        abs(np.sum((light - light.mean()) * np.exp(2j * np.pi * columns / trial)))
        for trial in np.arange(15.0, 60.0, 0.1)
    ]
    assert 15.0 + 0.1 * np.argmax(waves) == pytest.approx(period_px, rel=0.03)
    bright, faint = np.percentile(light, 92), np.percentile(light, 25)
    assert 2.5 * np.log10(bright / faint) == pytest.approx(2.0, abs=0.25)
    assert np.mean(light > (bright + faint) / 2.0) == pytest.approx(0.3, abs=0.04)


def test_a_satellite_fades_by_so_many_magnitudes_an_hour(monkeypatch):
    world = {"satellite": {"fade_mag_h": 3.0, "fainter_mag": 0.5}}

    def light(world, second):
        strip = expose(
            monkeypatch, world, stars=False, satellite_mag=9.0, second=second, optics=STRIP
        )
        return streak_along(strip).sum()

    lost = [2.5 * np.log10(light({}, s) / light(world, s)) for s in (0.0, 1200.0)]
    assert lost == pytest.approx([0.5, 1.5], abs=0.07)


def test_cloud_banks_come_at_their_rate_stay_and_take_their_light(monkeypatch):
    world = {"clouds": {"rate_h": 10.0, "duration_s": 100.0, "extinction_mag": 3.0}}
    fluxes = [
        stamps(expose(monkeypatch, world, second=s, optics=TINY), 15)[0].sum()
        for s in np.arange(0.0, 10_800.0, 60.0)
    ]
    lost_mag = -2.5 * np.log10(np.maximum(fluxes, 1.0) / np.percentile(fluxes, 90))
    is_hidden = lost_mag > 1.0
    banks = int(np.sum(np.diff(is_hidden.astype(int)) == 1) + is_hidden[0])
    assert banks >= 12, "30 in three hours, some of them as one"
    # Each hides for its duration and two thirds of its edges of 20 s.
    assert is_hidden.sum() * 60.0 == pytest.approx(30 * 127.0, rel=0.4)
    assert np.median(lost_mag[is_hidden]) == pytest.approx(3.0, abs=0.4)


def test_the_moon_brightens_the_sky_and_slopes_it(monkeypatch):
    world = {"moon": {"brightening_mag": 2.0, "gradient": 0.5, "gradient_angle_deg": 0.0}}
    offset = 21.0
    dark, lit = (
        expose(monkeypatch, each, stars=False).pixels / 16.0 - offset for each in ({}, world)
    )
    assert 2.5 * np.log10(np.median(lit) / np.median(dark)) == pytest.approx(2.0, abs=0.05)

    def slope(sky):
        columns = np.median(sky, axis=0) / np.median(sky)
        return np.polyfit(np.linspace(-0.5, 0.5, len(columns)), columns, 1)[0]

    assert slope(lit) - slope(dark) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("kind", ["low satellite", "aircraft"])
def test_traffic_crosses_at_its_rate(monkeypatch, kind):
    world = {"traffic": {f"{kind.replace(' ', '_')}_rate": 0.5}}
    crossings = [
        expose(monkeypatch, world, second=float(s), stars=False, optics=TINY).truth.traffic
        for s in range(60)
    ]
    assert {each.kind for frame in crossings for each in frame} == {kind}
    assert sum(map(len, crossings)) == pytest.approx(30, abs=16), "three sigma of Poisson"


def crossing(monkeypatch, world):
    """A frame with one crossing: its light along and across the line that the truth tells."""
    for second in range(40):
        frame = expose(monkeypatch, world, second=float(second), stars=False)
        if len(frame.truth.traffic) == 1:
            assert truth_from_json(frame.truth.to_json()) == frame.truth
            [one] = frame.truth.traffic
            (x0, y0), (x1, y1) = one.start_px, one.end_px
            length = np.hypot(x1 - x0, y1 - y0)
            ux, uy = (x1 - x0) / length, (y1 - y0) / length
            along, across = np.arange(0.0, length, 1.0), np.arange(-25.0, 25.5, 0.5)
            x = x0 + ux * along[:, None] - uy * across
            y = y0 + uy * along[:, None] + ux * across
            light = map_coordinates(frame.light, [y, x], order=1, cval=np.nan)
            is_inside = np.isfinite(light).all(axis=1)
            if is_inside.sum() > 150:
                return light[is_inside], across
    raise AssertionError("nothing crossed")


def test_a_low_satellite_is_a_steady_line_from_edge_to_edge(monkeypatch):
    light, across = crossing(monkeypatch, {"traffic": {"low_satellite_rate": 0.5}})
    profile = light.mean(axis=0)
    assert abs(across[np.argmax(profile)]) <= 1.0
    ridge = light[:, np.abs(across) <= 1.5].mean(axis=1)
    blocks = ridge[: len(ridge) // 30 * 30].reshape(-1, 30).mean(axis=1)
    assert blocks.min() > 0.6 * blocks.mean()


def test_an_aircraft_is_wide_and_blinks(monkeypatch):
    light, across = crossing(monkeypatch, {"traffic": {"aircraft_rate": 0.5}})
    profile = light.mean(axis=0)
    is_wide = across[profile > 0.5 * profile.max()]
    assert np.ptp(is_wide) > 4.0
    ridge = light[:, np.abs(across) <= 2.0].mean(axis=1)
    assert np.percentile(ridge, 99) > 2.0 * np.median(ridge)


def test_stars_do_not_flash_with_the_satellites(monkeypatch):
    world = {"satellite": {"flash_period_s": 2.0, "fade_mag_h": 5.0}}
    before, after = (
        centre_and_spread(stamps(expose(monkeypatch, each), 20)[5])[1] for each in ({}, world)
    )
    assert after == pytest.approx(before)
    assert SCALE_ARCSEC_PX > 1.0


def test_one_member_alone_can_fade():
    world = SatelliteWorld(fade_mag_h=4.0, fade_norad=29270)
    after_an_hour = [
        float(world_extra_mag(world, 1, norad_id, np.array([3600.0]))[0])
        for norad_id in (29270, 28946)
    ]
    assert after_an_hour == [4.0, 0.0]
