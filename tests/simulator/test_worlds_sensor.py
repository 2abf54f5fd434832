"""Sensor, focus, seeing and optics of a world, measured in the pixels."""

import numpy as np
import pytest

from rsoconsole.sky import sky_to_pixel, wcs_from_cards
from tests.rigs.world_rig import (
    FOUR_STARS,
    OPTICS,
    SCALE_ARCSEC_PX,
    centre_and_spread,
    expose,
    fwhm_px,
    grid_px,
    mean_centre,
    mean_spread,
    stamps,
)


def sky(monkeypatch, world=None, **more):
    """Converter steps of a field without a star."""
    world = {"sensor": {"hot_fraction": 0.0}} if world is None else world
    return expose(monkeypatch, world, stars=False, **more)


def pixel_sigma(pixels):
    """Noise of a pixel against its neighbours in the same row and of the same column."""
    twice = pixels[1:, 1:] - pixels[:-1, 1:] - pixels[1:, :-1] + pixels[:-1, :-1]
    low, high = np.percentile(twice, [0.5, 99.5])
    # A Gaussian without its outermost hundredth is narrower by 4.4 %.
    return np.std(twice[(twice >= low) & (twice <= high)]) / 2.0 * 1.044


@pytest.mark.parametrize(
    ("name", "axis", "is_fixed"), [("row_noise_sigma", 1, False), ("column_noise_sigma", 0, True)]
)
def test_rows_and_columns_are_noisy_in_units_of_the_pixels_noise(monkeypatch, name, axis, is_fixed):
    def means(world, second):
        pixels = sky(monkeypatch, world, second=second).pixels.astype(float)
        return (np.median(pixels, axis=axis) - np.median(pixels)) / pixel_sigma(pixels)

    world = {"sensor": {name: 1.5}}
    first, second = means(world, 60.0), means(world, 90.0)
    assert np.std(first) == pytest.approx(1.5, rel=0.12)
    assert np.std(means({}, 60.0)) < 0.3
    # Rows are new in every frame, columns belong to the sensor.
    correlation = np.corrcoef(first, second)[0, 1]
    assert correlation > 0.9 if is_fixed else abs(correlation) < 0.2


def test_the_amplifier_glows_in_the_last_corner(monkeypatch):
    dark = sky(monkeypatch).pixels / 16.0
    lit = sky(monkeypatch, {"sensor": {"glow_e_s": 400.0, "hot_fraction": 0.0}}).pixels / 16.0
    more_e = (lit - dark) * 20000.0 / 4096.0
    diagonal_px = np.hypot(*OPTICS.field_deg) / SCALE_ARCSEC_PX * 3600.0
    for share in (0.1, 0.2, 0.3):
        at = round(319 - share * diagonal_px / np.sqrt(2.0))
        found_e = np.median(more_e[at - 3 : at + 4, at - 3 : at + 4])
        assert found_e == pytest.approx(4000.0 * np.exp(-share / 0.1), rel=0.08)
    assert abs(np.median(more_e[:50, :50])) < 3.0


def test_hot_pixels_are_as_many_as_stated(monkeypatch):
    light = sky(monkeypatch, {"sensor": {"hot_fraction": 0.01}}).light
    sixty_electrons = 60.0 / (20000.0 / 4096.0)
    found = np.mean(light > sixty_electrons)
    # Of rates from 3 to 1500 e/s nine tenths stand out in 10 s.
    assert found == pytest.approx(0.009, rel=0.15)


def test_gain_is_that_of_the_photon_transfer(monkeypatch):
    for gain in (0.8, 2.5):
        world = {"sensor": {"gain_e_adu": gain, "bits": 14, "hot_fraction": 0.0}}
        shift = 4.0
        a, b = (sky(monkeypatch, world, seed=seed).pixels / shift for seed in (1, 2))
        centre = (slice(100, 220), slice(100, 220))
        variance = np.var((a - b)[centre]) / 2.0
        offset_adu = 21.0 * 4.0
        level = np.mean(((a + b) / 2.0)[centre]) - offset_adu
        assert level / (variance - (1.7 / gain) ** 2) == pytest.approx(gain, rel=0.05)


@pytest.mark.parametrize("bits", [8, 10, 16])
def test_a_converter_of_so_many_bits_has_so_many_steps(monkeypatch, bits):
    world = {"sensor": {"bits": bits, "gain_e_adu": 4.0 if bits < 16 else 0.2}}
    pixels = expose(monkeypatch, world, star_mag=7.0, optics=FOUR_STARS).pixels
    step = 2 ** (16 - bits)
    assert not np.any(pixels % step)
    assert len(np.unique(pixels // step)) > 2
    assert pixels.max() // step == 2**bits - 1


def test_a_colour_sensor_shows_its_mosaic(monkeypatch):
    light = expose(monkeypatch, {"sensor": {"bayer": True, "hot_fraction": 0.0}}, stars=False)
    mono = sky(monkeypatch)
    offset = 21.0
    shares = [
        np.median(light.pixels[row::2, column::2] / 16.0 - offset)
        / np.median(mono.pixels[row::2, column::2] / 16.0 - offset)
        for row in (0, 1)
        for column in (0, 1)
    ]
    assert shares == pytest.approx([0.45, 0.60, 0.60, 0.40], abs=0.03)


def test_joined_pixels_make_a_smaller_frame_of_less_noise(monkeypatch):
    single, joined = sky(monkeypatch), sky(monkeypatch, {"sensor": {"binning": 2}})
    assert joined.pixels.shape == (160, 160)
    assert np.median(joined.pixels) == pytest.approx(np.median(single.pixels), rel=0.05)
    ratio = pixel_sigma(joined.pixels.astype(float)) / pixel_sigma(single.pixels.astype(float))
    assert ratio == pytest.approx(0.5, abs=0.06)
    # Twice the angle in a pixel: the truth's plate says so, and the stars agree.
    cards = expose(monkeypatch, {"sensor": {"binning": 2}}).truth.wcs_cards
    assert abs(cards["CD2_2"]) * 3600.0 == pytest.approx(2.0 * SCALE_ARCSEC_PX, rel=1e-9)


def test_seeing_is_the_width_of_the_stars(monkeypatch):
    for fwhm_arcsec in (2.0, 6.0):
        frame = expose(monkeypatch, {"seeing": {"fwhm_arcsec": fwhm_arcsec}}, star_mag=12.3)
        # Altitude 38 deg widens it by 1.6^0.3, the pixel's own width adds in squares.
        disc_px = fwhm_arcsec / SCALE_ARCSEC_PX * 1.6**0.3
        assert fwhm_px(frame) == pytest.approx(np.hypot(disc_px, 0.68), rel=0.12)


def test_seeing_drifts_through_the_night(monkeypatch):
    world = {"seeing": {"fwhm_arcsec": 3.0, "drift_percent_h": 50.0}}
    early, late = (
        np.mean(
            [fwhm_px(expose(monkeypatch, world, second=s + more)) for more in (0.0, 20.0, 40.0)]
        )
        for s in (0.0, 7200.0)
    )
    assert late / early == pytest.approx(1.5**2, rel=0.08)


def test_out_of_focus_a_star_is_a_ring_of_that_radius(monkeypatch):
    world = {"focus": {"ring_px": 8.0}, "seeing": {"fwhm_arcsec": 1.5}}
    frame = expose(monkeypatch, world, star_mag=10.0)
    box = np.mean(stamps(frame, 20), axis=0)
    rows, columns = np.indices(box.shape) - 20.0
    r = np.hypot(rows, columns)
    profile = [np.median(box[(r > at - 0.5) & (r <= at + 0.5)]) for at in range(15)]
    assert profile[0] < 0.3 * max(profile)
    outer = np.interp(-0.5 * max(profile), -np.array(profile[6:]), np.arange(6, 15))
    assert outer == pytest.approx(8.0, abs=0.7)


def test_a_longer_focal_length_draws_the_stars_apart(monkeypatch):
    for error in (0.03, -0.04):
        frame = expose(monkeypatch, {"optics": {"scale_error": error}})
        shifts = np.array([centre_and_spread(box)[0] for box in stamps(frame)])
        x, y = (at - 159.5 for at in grid_px())
        found = np.polyfit(np.concatenate([x, y]), shifts.T.ravel(), 1)[0]
        assert found == pytest.approx(error, abs=0.001)
        cards = frame.truth.wcs_cards
        assert abs(cards["CD2_2"]) * 3600.0 == pytest.approx(SCALE_ARCSEC_PX / (1.0 + error))


def test_distortion_moves_the_corners_outwards_with_the_radius_cubed(monkeypatch):
    plain, bent = expose(monkeypatch), expose(monkeypatch, {"optics": {"distortion": 0.02}})
    x, y = (at - 159.5 for at in grid_px())
    reach = np.hypot(x, y)
    shifts = np.array(
        [
            centre_and_spread(after)[0] - centre_and_spread(before)[0]
            for after, before in zip(stamps(bent), stamps(plain), strict=True)
        ]
    )
    outwards = (shifts[:, 0] * x + shifts[:, 1] * y) / reach
    assert outwards == pytest.approx(0.02 * reach**3 / np.hypot(159.5, 159.5) ** 2, abs=0.2)
    # The truth's plate has it, too.
    wcs = wcs_from_cards(bent.truth.wcs_cards)
    before = wcs_from_cards(plain.truth.wcs_cards)
    from rsoconsole.sky import pixel_to_sky

    told_x, told_y = sky_to_pixel(wcs, *pixel_to_sky(before, *grid_px()))
    assert told_x - grid_px()[0] == pytest.approx(shifts[:, 0], abs=0.15)
    assert told_y - grid_px()[1] == pytest.approx(shifts[:, 1], abs=0.15)


def test_index_stars_have_moved_together_and_each_its_own_way(monkeypatch):
    base = {"drift_arcsec": 0.0, "random_arcsec": 0.0}
    plain = expose(monkeypatch, {"catalogue": base})
    together = {"catalogue": base | {"drift_arcsec": 3.0, "drift_angle_deg": 90.0}}
    moved = (mean_centre(expose(monkeypatch, together)) - mean_centre(plain)) * SCALE_ARCSEC_PX
    # East lies towards smaller columns.
    assert moved == pytest.approx([-3.0, 0.0], abs=0.15)
    apart = expose(monkeypatch, {"catalogue": base | {"random_arcsec": 2.0}})
    offsets = [
        (centre_and_spread(after)[0] - centre_and_spread(before)[0]) * SCALE_ARCSEC_PX
        for after, before in zip(stamps(apart), stamps(plain), strict=True)
    ]
    assert np.std(offsets) == pytest.approx(2.0, rel=0.35)
    assert mean_spread(apart) == pytest.approx(mean_spread(plain), abs=0.2)
