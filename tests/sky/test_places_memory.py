"""The Earth's velocity is remembered by its instants: it must be what erfa gives for each."""

import erfa
import numpy as np
import pytest

from rsoconsole.sky import places
from rsoconsole.sky.times import jd_tt

T0_UTC_NS = 1_687_400_000_000_000_000


def by_erfa(t_utc_ns: int) -> np.ndarray:
    _, barycentric = erfa.epv00(*jd_tt(t_utc_ns))
    return np.asarray(barycentric["v"]) * (places.AU_KM / places.S_PER_DAY)


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3), (0,), (300,)])
def test_each_instant_has_its_own_whatever_was_asked_before(shape):
    random = np.random.default_rng(len(shape))
    for _ in range(3):  # the second time all are known, the third some
        t = T0_UTC_NS + random.integers(0, 40, shape) * 30 * 10**9
        found = places.earth_velocity_km_s(t)
        assert found.shape == (*np.shape(t), 3)
        for index in np.ndindex(*np.shape(t)):
            assert np.array_equal(found[index], by_erfa(int(np.asarray(t)[index])))


def test_it_remembers_no_more_than_it_needs(monkeypatch):
    monkeypatch.setattr(places, "_MAX_REMEMBERED", 10)
    for night in range(20):
        places.earth_velocity_km_s(T0_UTC_NS + (night * 100 + np.arange(5)) * 10**9)
    assert len(places._remembered) <= 15
