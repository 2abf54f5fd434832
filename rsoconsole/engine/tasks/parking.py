"""Sends the mount to its park position, again and again until it is parked."""

from rsoconsole.base import InstrumentError
from rsoconsole.engine.aim.instrument_controller import NS, InstrumentController
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.words import NO_PARK

RETRY_NS = 30 * NS
ENOUGH = 20
"""Number of orders after which parking is given up, with a last alarm."""


class Parking:
    """A request to park, which lasts until the mount is parked or the request is ended."""

    def __init__(
        self, instrument_controller: InstrumentController, session_log: SessionLog
    ) -> None:
        self._instrument_controller = instrument_controller
        self._session_log = session_log
        self.is_wanted = False
        self.trouble = ""
        """Reason why the mount does not park; empty where it has accepted the last order."""
        self._orders = 0
        self._next_utc_ns = 0
        """Time before which no further order and no report goes out, UTC ns."""
        self._is_silent = False

    def want(self) -> None:
        """Request a park.

        The order is given at the next ``see_to_it``, unless the mount is on its way to park
        already.
        """
        self.is_wanted, self._orders, self._next_utc_ns = True, 0, 0
        self.trouble = ""

    def forget(self) -> None:
        """End the request to park."""
        self.is_wanted = self._is_silent = False

    def see_to_it(self) -> None:
        """Read the mount's report and order the park where that is due; never raises."""
        if not self.is_wanted:
            return
        now_ns = self._instrument_controller.now_utc_ns()
        is_due = now_ns >= self._next_utc_ns
        if self._is_silent and not is_due:
            return  # each look at a silent mount takes as long as it is waited for
        try:
            report = self._instrument_controller.mount_report()
            self._is_silent = False
            if report.is_parked:
                self.forget()
                self._instrument_controller.forget_order()
                self._session_log.say("info", "the mount is parked")
                return
            if self._instrument_controller.is_on_its_way_to_park(report) or not is_due:
                return
            self._next_utc_ns = now_ns + RETRY_NS
            self._order()
        except InstrumentError as error:
            self._is_silent, self._next_utc_ns = True, now_ns + RETRY_NS
            self._complain(str(error))

    def _order(self) -> None:
        """Order the park. Raises InstrumentError where the mount's abilities are not known."""
        if not self._instrument_controller.instruments.mount.abilities().can_park:
            self.forget()
            self._complain(NO_PARK)
            return
        self._orders += 1
        try:
            self._instrument_controller.order_park()
            self.trouble = ""
            self._session_log.say("info", "the mount parks")
        except InstrumentError as error:
            self._complain(str(error))
        if self._orders >= ENOUGH:
            self.forget()
            self._complain(f"it was told {self._orders} times")

    def _complain(self, why: str) -> None:
        self.trouble = why
        self._session_log.say("alarm", f"the mount does not park: {why}; park it by hand")
