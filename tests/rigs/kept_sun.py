"""For nights in process: where the Sun stands is asked at each look at the limits."""

from collections.abc import Iterator
from functools import lru_cache

import pytest

from rsoconsole.engine.aim import night
from rsoconsole.sky import sun_altitude_deg

_kept_altitude_deg = lru_cache(maxsize=50_000)(sun_altitude_deg)


@pytest.fixture(scope="module", autouse=True)
def kept_sun() -> Iterator[None]:
    """The nights begin at one instant: what one has asked is known to the next."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(night, "sun_altitude_deg", _kept_altitude_deg)
        yield
