"""Computes what the next hours bring, on a thread of its own: no key waits for it."""

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rsoconsole.console.night import EngineView, OrbitAhead, orbit_ahead
from rsoconsole.control import Poller
from rsoconsole.night import NightView

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Outlook

log = logging.getLogger(__name__)

EVERY_S = 30.0
WAIT_S = 1.0
BREATH_S = 2.0
"""So long at least from one orbit of a running engine to the next: simulated nights are quick."""
MINUTE_NS = 60 * 10**9


class OutlookWatch(Poller):
    """Computes it every half minute, and when the state or what is followed is another."""

    def __init__(
        self, on_seen: Callable[["Outlook"], None], on_orbit: Callable[[OrbitAhead], None]
    ) -> None:
        super().__init__("outlook", WAIT_S)
        self._on_seen, self._on_orbit = on_seen, on_orbit
        self._known = (NightView(), EngineView())
        self._computed_s = self._orbit_s = -EVERY_S
        self._computed_of: object = None
        self._orbit_of: object = None

    def update(self, night: NightView, engine: EngineView) -> None:
        """What is known by now (any thread)."""
        self._known = (night, engine)

    def _look(self) -> None:
        night, engine = self._known
        now = engine.now_utc_ns if engine.is_attached else night.last_utc_ns
        if night.config is None or not now:
            return
        for compute in (self._compute, self._compute_orbit):
            try:
                compute(night, engine, now)
            except Exception:  # a panel without it is worth more than no panel
                log.exception("the outlook cannot be computed")

    def _compute(self, night: NightView, engine: EngineView, now: int) -> None:
        assert night.config is not None
        direction = _direction(night, engine)
        is_known = night.track is not None, direction is not None
        of = (night.folder, night.state, is_known, _minute(engine, now))
        if of == self._computed_of and time.monotonic() - self._computed_s < EVERY_S:
            return
        self._computed_of, self._computed_s = of, time.monotonic()
        # Late: the sky's computation loads slowly, and the first paint does not wait for it.
        from rsoconsole.pipeline.outlook import outlook

        seen = outlook(night.config, now, direction, night.track)
        if not self._is_closing:
            self._on_seen(seen)

    def _compute_orbit(self, night: NightView, engine: EngineView, now: int) -> None:
        """Where the orbit on record leads."""
        assert night.config is not None
        found = night.orbit
        if found is None:
            return
        of = (night.folder, found, now // MINUTE_NS)
        since_s = time.monotonic() - self._orbit_s
        if of == self._orbit_of and since_s < EVERY_S:
            return
        if engine.is_attached and since_s < BREATH_S:
            return
        self._orbit_of, self._orbit_s = of, time.monotonic()
        try:
            ahead = orbit_ahead(found, night.config, now, folder=night.folder)
        except Exception:  # an orbit is worth showing that leads nowhere
            log.exception("where the orbit leads cannot be computed")
            ahead = OrbitAhead(folder=night.folder, estimate=found, from_utc_ns=now, outlook=None)
        if not self._is_closing:
            self._on_orbit(ahead)


def _minute(engine: EngineView, now: int) -> int | None:
    """The clock of a recorded night goes as fast as somebody looks through it."""
    return None if engine.is_attached else now // MINUTE_NS


def _direction(night: NightView, engine: EngineView) -> tuple[float, float] | None:
    """Where the telescope looks, by the mount's word or by the last frame."""
    if engine.mount_ra_icrs_deg is not None and engine.mount_dec_icrs_deg is not None:
        return engine.mount_ra_icrs_deg, engine.mount_dec_icrs_deg
    pointing = night.pointing
    return None if pointing is None else (pointing.ra_icrs_deg, pointing.dec_icrs_deg)
