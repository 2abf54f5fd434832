"""The filter of slow satellites on low ones: what leaps show of them goes through it as well.

Truth is SGP4's of real element sets. Where filters may run away, one pass in thirty ends in rates
of a million degrees a second.
"""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.records import Measurement, TrackState
from rsoconsole.sky import wrap_180
from rsoconsole.tracking.filters import adaptive, bank, estimator
from rsoconsole.tracking.filters.filter_grid import FINE
from rsoconsole.words import NS_PER_S
from tests.makers import geo_measurement
from tests.tiers import plain_first
from tests.truth.low_passes import SITE, LowPass, are_there, low_passes

pytestmark = pytest.mark.skipif(not are_there(), reason="the element files are not there")
ADAPTIVE = FilterConfig()
LEAP_S, FLIP_S = 5.5, 30.0
MANY = pytest.mark.nightly("statistics over many passes")


def measured(one: LowPass, seed: int) -> list[Measurement]:
    """By leaps, with one long way about the pier; the shutter is late by 20 ms at random."""
    random = np.random.default_rng(seed)
    count = int((one.set_utc_ns - one.rise_utc_ns) / NS_PER_S / LEAP_S) - 6
    flip = random.integers(3, max(count - 3, 4))
    t = one.rise_utc_ns + np.array(
        [round((LEAP_S * k + (FLIP_S if k >= flip else 0.0)) * NS_PER_S) for k in range(count)]
    )
    places = one.satellite.astrometric_place(SITE, t)
    found = []
    for k in range(count):
        ra, dec = float(places.ra_icrs_deg[k]), float(places.dec_icrs_deg[k])
        cos_dec = np.cos(np.radians(dec))
        rate = np.array([places.ra_rate_deg_s[k] * cos_dec, places.dec_rate_deg_s[k]]) * 3600.0
        cov = 0.02**2 * np.outer(rate, rate) + np.eye(2)
        east, north = random.multivariate_normal(np.zeros(2), cov) / 3600.0
        found.append(
            Measurement(
                measurement_id=f"{k + 1}-0",
                frame_id=k + 1,
                t_mid_utc_ns=int(t[k]),
                ra_icrs_deg=(ra + east / cos_dec) % 360.0,
                dec_icrs_deg=dec + north,
                cov_sky_arcsec2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])),
                x_px=0.0,
                y_px=0.0,
                confidence=1.0,
                source="network",
            )
        )
    return found


def followed(night: list[Measurement]) -> list[tuple[TrackState, Measurement]]:
    """What was predicted, beside what was measured."""
    state, found = estimator.initialise(*night[:2], ADAPTIVE), []
    for m in night[2:]:
        there = estimator.predict(state, m.t_mid_utc_ns, ADAPTIVE, m.frame_id)
        found.append((there, m))
        state = estimator.update(there, m, ADAPTIVE)
    return found


def sigmas2(there: TrackState, m: Measurement) -> float:
    """Squared, of what is measured about what was predicted, by both covariances."""
    cos_dec = np.cos(np.radians(there.x[2]))
    off = np.array([wrap_180(m.ra_icrs_deg - there.x[0]) * cos_dec, m.dec_icrs_deg - there.x[2]])
    to_sky = np.array([cos_dec, 1.0])
    own = np.array(there.P)[np.ix_([0, 2], [0, 2])] * np.outer(to_sky, to_sky)
    ee, en, nn = m.cov_sky_arcsec2
    total = own * 3600.0**2 + np.array([[ee, en], [en, nn]])
    return float(3600.0**2 * off @ np.linalg.solve(total, off))


@pytest.mark.parametrize(
    ("number", "seed"),
    [(0, 1), (4, 2), (16, 3), (29, 2)]
    + [pytest.param(*each, marks=MANY) for each in ((8, 2), (12, 3), (16, 2), (20, 1), (25, 3))],
)
def test_a_pass_is_followed_with_numbers_of_this_world(number, seed):
    night = followed(measured(low_passes(30)[number], seed))
    rates = [(s.x[1] * np.cos(np.radians(s.x[2])), s.x[3]) for s, _ in night]
    assert np.max(np.abs(rates)) < 1.5
    assert np.all(np.isfinite([s.P for s, _ in night]))
    assert max(s.P[2][2] for s, _ in night) < 20.0**2
    assert np.mean([sigmas2(*each) < ADAPTIVE.gate_nis for each in night]) > 0.9


def run_away(state: TrackState, which: slice, variance: float) -> TrackState:
    """The same track, some of whose filters have a variance without measure."""
    before = adaptive._bank_of(state)
    covariances = before.covariances.copy()
    covariances[which] = np.where(np.eye(6) > 0.0, variance, 0.0)
    log_weights = before.log_weights.copy()
    log_weights[which] = np.log(bank.MIN_WEIGHT)
    grown = replace(before, covariances=covariances, log_weights=log_weights)
    return replace(state, memory=adaptive._Memory(grown, state.x))


def test_what_nobody_believes_is_not_in_the_bounds():
    night = measured(low_passes(1)[0], 1)
    state = estimator.update(
        estimator.predict(
            estimator.initialise(*night[:2], ADAPTIVE), night[2].t_mid_utc_ns, ADAPTIVE, 3
        ),
        night[2],
        ADAPTIVE,
    )
    to_ns = night[3].t_mid_utc_ns
    plain = estimator.predict(state, to_ns, ADAPTIVE, 4)
    first = slice(0, FINE.filters_per_motion)
    for variance in (1e20, np.nan):
        there = estimator.predict(run_away(state, first, variance), to_ns, ADAPTIVE, 4)
        assert there.x == pytest.approx(plain.x, rel=1e-6)
        assert np.array(there.P) == pytest.approx(np.array(plain.P), rel=1e-2)


def test_where_all_have_run_away_nothing_is_known():
    night = measured(low_passes(1)[0], 1)
    state = run_away(estimator.initialise(*night[:2], ADAPTIVE), slice(None), np.nan)
    there = estimator.predict(state, night[2].t_mid_utc_ns, ADAPTIVE, 3)
    assert np.all(np.isfinite(there.P))
    assert there.P[2][2] > 50.0**2


@pytest.mark.parametrize("rate_arcsec_s", plain_first(1, [200.0, 60.0, 500.0]))
def test_over_a_long_coast_nobody_grows_surer(rate_arcsec_s):
    """Filters that are believed and have grown wider than the sky keep their say."""
    night = [
        geo_measurement(
            n,
            dec_deg=40.0,
            cadence_s=5.0,
            rate_deg_s=rate_arcsec_s / 3600.0,
            cov_sky_arcsec2=(0.25, 0.0, 0.25),
        )
        for n in range(1, 5)
    ]
    state = estimator.initialise(*night[:2], ADAPTIVE)
    for m in night[2:]:
        there = estimator.predict(state, m.t_mid_utc_ns, ADAPTIVE, m.frame_id)
        state = estimator.update(there, m, ADAPTIVE)
    start_ns, sigma_deg, most = night[-1].t_mid_utc_ns, 0.0, []
    for since_s in range(100, 7200, 400):
        there = estimator.predict(state, start_ns + since_s * NS_PER_S, ADAPTIVE, since_s)
        own = np.sqrt(max(there.P[0][0] * np.cos(np.radians(there.x[2])) ** 2, there.P[2][2]))
        assert own > min(0.8 * sigma_deg, 10.0), since_s
        sigma_deg = own
        assert there.mixture is not None
        most.append(dict(there.mixture.motion_probabilities)["any orbit"])
    assert np.ptp(most) < 1e-6  # a mere prediction believes no other motion
