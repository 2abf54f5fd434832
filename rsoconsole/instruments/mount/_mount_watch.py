"""Watch over the mount by its own process, for the time when no engine watches.

Runs on a thread of its own: neither a parent that hangs nor an order that waits for its answer
delays it.
"""

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.mount._mount_owner import MountOwner
from rsoconsole.instruments.mount._stop_measurement import StopMeasurement
from rsoconsole.instruments.mount.mount_lease import Lease
from rsoconsole.instruments.mount.mount_mirror import MountMirror
from rsoconsole.words import utc_ns_to_iso

_LOOK_EVERY_S = 0.2
_TRY_AGAIN_S = 5.0
_HOLD_S = 3.0


class MountWatch:
    """Ends a slew that no engine watches any more, and ends tracking at the limit it was given."""

    def __init__(
        self,
        *,
        lease: Lease,
        mirror: MountMirror,
        owner: MountOwner,
        stop: Callable[[], dict[str, Any]],
        track: Callable[[bool], bool | None],
        say: Callable[[str], None],
        park: Callable[[], object] = lambda: None,
        on_ended: Callable[[float, float], None] = lambda _unwatched_s, _lease_s: None,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """``stop`` ends motion and restores tracking, ``track`` turns that on or off.

        ``park`` is called at a limit for a mount whose tracking cannot be turned off. ``on_ended``
        is called, before a slew is ended, with the time without any order, and the longest allowed
        one.
        """
        self.lease, self.owner = lease, owner
        self._mirror, self._stop, self._track, self._park = mirror, stop, track, park
        self._monotonic_s = monotonic_s
        self._held: tuple[bool, float] | None = None
        self._measurement: StopMeasurement | None = None
        self._say_to_parent = say
        self._on_ended = on_ended
        self._wake, self._is_over = threading.Event(), threading.Event()
        self._is_unattended = False
        self._is_moved_by_others = False
        self._try_again_s = 0.0
        self._thread = threading.Thread(target=self._run, daemon=True, name="watch")

    @property
    def is_taken_over(self) -> bool:
        """True where another process has claimed the mount after this process did."""
        return self.owner.has_claimed and not self.owner.is_ours()

    def start(self) -> None:
        """Begin to watch, on a thread of its own."""
        self._thread.start()

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        """Renew the lease for ``lease_s``, because the engine watches the mount.

        ``track_until_utc_ns``: when tracking must end, at the next limit; None: no limit.
        """
        self.lease.begin(self._monotonic_s(), lease_s)
        self.lease.set_limit(track_until_utc_ns)
        self.owner.claim()
        self._wake.set()

    def hold_tracking(self, is_on: bool | None) -> None:
        """Restore this tracking state whenever the driver changes it within some seconds.

        After a STOP a driver may restore its own tracking state at its next poll of the mount.
        ``is_on`` None: restore nothing from now on, because a new order sets tracking.
        """
        self._held = None if is_on is None else (is_on, self._monotonic_s() + _HOLD_S)

    def set_stop_measurement(self, measurement: StopMeasurement | None) -> None:
        """End the present measurement of a STOP, and run ``measurement`` instead; None: run
        none.
        """
        before, self._measurement = self._measurement, measurement
        if before is not None:
            before.end()
        self._wake.set()

    def note_slew_order(self) -> None:
        """Begin the lease and claim the mount, because a slew is about to be ordered."""
        self.lease.begin(self._monotonic_s())
        self.owner.claim()

    def look(self, *, is_moving: bool) -> None:
        """Note that the mount has reported, and whether it moves; returns at once."""
        if self._is_unattended and is_moving:
            self._is_moved_by_others = True
        self._wake.set()

    def end(self) -> None:
        """End the supervision; returns when none of its actions is in progress."""
        self._is_over.set()
        self._wake.set()
        self._thread.join()

    def watch_unattended(self) -> None:
        """Watch the mount after the parent has ended, until tracking has ended at the limit.

        Ends earlier where another process takes over, or the mount is parked or moved by others.
        """
        limit_utc_ns = self.lease.open_limit_utc_ns()
        if limit_utc_ns is None or not self.owner.has_claimed or self._mirror.is_parked:
            return
        self._say(f"nobody watches: tracking ends at {utc_ns_to_iso(limit_utc_ns, 0)}")
        self._is_unattended = True
        while self.lease.open_limit_utc_ns() is not None:
            self._wake.wait(_LOOK_EVERY_S)
            self._wake.clear()
            if self._is_moved_by_others or self.is_taken_over or self._mirror.is_parked:
                self._say("somebody else has the mount now")
                return
            self._look_at_limit()

    def finish_stop_measurement(self) -> None:
        """Finish the measurement of the last STOP after the parent is gone."""
        while self._measurement is not None and not self._measurement.is_over:
            self._measurement.look()
            time.sleep(_LOOK_EVERY_S)

    def _run(self) -> None:
        while not self._is_over.is_set():
            self._wake.wait(_LOOK_EVERY_S)
            self._wake.clear()
            if not self._is_over.is_set():
                self.watch()

    def watch(self) -> None:
        """Check once, and act where necessary: STOP, tracking state, slew, limit."""
        self._look_at_stop()
        self._look_at_tracking()
        self._look_at_slew()
        self._look_at_limit()

    def _look_at_stop(self) -> None:
        if self._measurement is not None:
            self._measurement.look()

    def _look_at_tracking(self) -> None:
        held, mirror = self._held, self._mirror
        if held is None or mirror.is_moving or mirror.is_reported_parked:
            return
        is_on, until_s = held
        if self._monotonic_s() > until_s:
            self._held = None
        elif mirror.is_reported_tracking is not is_on:
            try:
                self._track(is_on)
            except InstrumentError as error:
                self._say(f"tracking cannot be turned {'on' if is_on else 'off'}: {error}")

    def _look_at_slew(self) -> None:
        # The way to the park position ends where nobody needs to watch.
        if not self._is_slew_unwatched():
            return
        # Drivers say what they do property by property: look again when all has been said.
        self._is_over.wait(_LOOK_EVERY_S)
        if not self._is_slew_unwatched():
            return
        unwatched_s = self.lease.unwatched_s(self._monotonic_s())
        # Before the mount is seen to stand: who sees that must know why.
        self._on_ended(unwatched_s, self.lease.lease_s)
        self._say(
            f"nobody has watched this slew for {unwatched_s:.1f} s"
            f" ({self.lease.lease_s:g} s are allowed): it is ended"
        )
        try:
            result = self._stop()
        except InstrumentError as error:
            self._say(f"the slew cannot be ended: {error}")
            return
        if not result["is_answered"]:
            self._say(result["detail"])

    def _is_slew_unwatched(self) -> bool:
        return self._mirror.is_slewing and self.lease.has_lapsed(self._monotonic_s())

    def _look_at_limit(self) -> None:
        if not self.lease.is_past_limit(self._mirror.now_utc_ns()):
            return
        if self._mirror.is_moving or not self._mirror.is_tracking:
            return
        if self._monotonic_s() < self._try_again_s:
            return
        self._try_again_s = self._monotonic_s() + _TRY_AGAIN_S
        able = self._mirror.abilities
        if able.can_park and not able.can_set_tracking:
            self._park()
            self.lease.close_limit()
            self._say("the mount is at its limit: its tracking cannot be turned off, it parks")
            return
        try:
            is_tracking = self._track(False)
        except InstrumentError as error:
            self._say(f"the mount is at its limit and tracks on: {error}")
            return
        if is_tracking is False:
            self.lease.close_limit()
            self._try_again_s = 0.0
            self._say("the mount is at its limit: tracking is off")
        else:
            self._say("the mount is at its limit and tracks on: stop it by hand")

    def _say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)
        self._say_to_parent(text)
