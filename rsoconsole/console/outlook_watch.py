"""Reckons what the next hours bring, on a thread of its own: a Pi takes half a second for it."""

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.night import NightView
from rsoconsole.control.looker import Looker

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Outlook

log = logging.getLogger(__name__)

EVERY_S = 30.0
WAIT_S = 1.0
MINUTE_NS = 60 * 10**9


class OutlookWatch(Looker):
    """Reckons anew every half minute, and when another thing is followed."""

    def __init__(self, on_seen: Callable[["Outlook"], None]) -> None:
        super().__init__("outlook", WAIT_S)
        self._on_seen = on_seen
        self._night = NightView()
        self._engine = EngineView()
        self._reckoned_s = -EVERY_S
        self._reckoned_of: object = None

    def tell(self, night: NightView, engine: EngineView) -> None:
        """What is known by now (any thread)."""
        self._night, self._engine = night, engine

    def _look(self) -> None:
        try:
            self._reckon()
        except Exception:  # a panel without it is worth more than no panel
            log.exception("the outlook cannot be reckoned")

    def _reckon(self) -> None:
        night, engine = self._night, self._engine
        now = engine.now_utc_ns if engine.is_attached else night.last_utc_ns
        if night.config is None or not now:
            return
        # The clock of a recorded night goes as fast as somebody looks through it.
        minute = None if engine.is_attached else now // MINUTE_NS
        of = (night.folder, night.state, night.track is None, minute)
        if of == self._reckoned_of and time.monotonic() - self._reckoned_s < EVERY_S:
            return
        self._reckoned_of, self._reckoned_s = of, time.monotonic()
        # Late: the sky's reckoning loads slowly, and the first paint does not wait for it.
        from rsoconsole.pipeline.outlook import outlook

        seen = outlook(night.config, now, _direction(night, engine), night.track)
        if not self._is_closing:
            self._on_seen(seen)


def _direction(night: NightView, engine: EngineView) -> tuple[float, float] | None:
    """Where the telescope looks, by the mount's word or by the last frame."""
    if engine.mount_ra_icrs_deg is not None and engine.mount_dec_icrs_deg is not None:
        return engine.mount_ra_icrs_deg, engine.mount_dec_icrs_deg
    pointing = night.pointing
    return None if pointing is None else (pointing.ra_icrs_deg, pointing.dec_icrs_deg)
