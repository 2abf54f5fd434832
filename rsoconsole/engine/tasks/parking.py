"""Sends the mount to its park position and does not let go until it is there."""

from rsoconsole.engine.aim import NS, InstrumentController
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.errors import InstrumentError

RETRY_NS = 30 * NS
ENOUGH = 20
"""Orders after which it is said for the last time that somebody must go there."""


class Parking:
    """One wish to park, from the order to the mount's own word that it is parked."""

    def __init__(
        self, instrument_controller: InstrumentController, session_log: SessionLog
    ) -> None:
        self._instrument_controller = instrument_controller
        self._session_log = session_log
        self.is_wanted = False
        """The mount is not parked yet and shall be."""
        self._orders = 0
        self._next_utc_ns = 0

    def want(self) -> None:
        """Park; the order goes out with the next look."""
        self.is_wanted, self._orders, self._next_utc_ns = True, 0, 0

    def forget(self) -> None:
        """Somebody has decided otherwise."""
        self.is_wanted = False

    def see_to_it(self) -> None:
        """One look: order, wait, order again; never raises."""
        if not self.is_wanted or self._instrument_controller.now_utc_ns() < self._next_utc_ns:
            return
        self._next_utc_ns = self._instrument_controller.now_utc_ns() + RETRY_NS
        try:
            report = self._instrument_controller.mount_report()
            if report.is_parked:
                self.is_wanted = False
                self._session_log.say("info", "the mount is parked")
                return
            if report.is_slewing and self._orders > 0:
                return
            self._orders += 1
            self._instrument_controller.order_park()
            self._session_log.say("info", "the mount parks")
        except InstrumentError as error:
            self._complain(str(error))
        if self._orders >= ENOUGH:
            self.is_wanted = False
            self._complain(f"it was told {self._orders} times")

    def _complain(self, why: str) -> None:
        self._session_log.say("alarm", f"the mount does not park: {why}; park it by hand")
