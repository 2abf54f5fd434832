"""The mount, behind a child process that speaks INDI, with a second path for STOP beside it."""

import dataclasses
import itertools
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import IndiConfig, MountConfig, WaitsConfig
from rsoconsole.instruments.indi.indi_process import IndiProcess, device_settings, drain_messages
from rsoconsole.instruments.indi.wire_stop import StopCallbacks, stop_mount
from rsoconsole.instruments.motion import REPEATS_FOR_S, Motion
from rsoconsole.instruments.mount._mount_stop import MountStop
from rsoconsole.instruments.mount.pier_side import PierConvention
from rsoconsole.instruments.ports import (
    MountAbilities,
    MountReport,
    SiteCheck,
    SlewEnd,
    StopResult,
    ignore_stop_result,
)
from rsoconsole.records import Site
from rsoconsole.sky import separation_deg
from rsoconsole.words import measured_text

log = logging.getLogger(__name__)

_MAX_MESSAGES = 100
_ABORT_ANSWER_S = 0.1
_SETTLED_S = 2.5
"""Longest wait for the tracking state to be set, after the driver has answered ABORT."""
_PAST_S = 10.0
_MEASURED_S = REPEATS_FOR_S + 1.0
"""Longest measurement of a STOP, even where the measuring process has died."""
_KM_PER_DEG = 111.19
_SITE_TOLERANCE_KM = 1.0
_STAMP_NS = 1_000


class IndiMount:
    """A mount that is reached through INDI. Thread-safe."""

    def __init__(
        self,
        config: IndiConfig,
        log_path: Path,
        mount: MountConfig | None = None,
        waits: WaitsConfig | None = None,
        *,
        site: Site | None = None,
    ) -> None:
        """Describe the mount; ``start`` connects.

        ``mount``, ``waits`` None: the defaults. ``site`` None: the driver's convention for the side
        of the pier cannot be found.
        """
        waits = waits or WaitsConfig()
        self._order_s = waits.longest_order_s
        self._config, self._mount = config, mount or MountConfig()
        self._pier = PierConvention(self._mount.pier_side, site, self._say)
        self._latest: MountReport | None = None
        self._tracks_after_stop: bool | None = None
        self._messages: deque[str] = deque(maxlen=_MAX_MESSAGES)
        self._slew_end: SlewEnd | None = None
        self._stops: dict[int, MountStop] = {}
        self._stop_numbers = itertools.count(1)
        self._has_order = False
        """True from an order until measured rest: a driver that comes back is stopped first."""
        self.process = IndiProcess(
            name="mount",
            module="rsoconsole.instruments.mount.mount_child",
            settings={
                **device_settings("mount", config.mount, config, waits),
                "simulated": config.simulated,
                "after_stop": self._mount.after_stop,
                "lease_s": self._mount.lease_s,
            },
            log_path=log_path,
            on_event=self._on_event,
            start_s=waits.longest_connection_s,
            on_start=lambda: {"stops_first": self._has_order},
        )

    def start(self) -> None:
        """Start the mount's process and connect. Raises InstrumentError."""
        self.process.start()

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        """Slew to a direction and track; returns once the mount has accepted the order.

        ``now_utc_ns`` fixes the epoch of date.
        """
        self._slew_end = None
        self._new_order()
        self._pier.begin_slew(ra_icrs_deg, dec_icrs_deg)
        self.process.request(
            "slew",
            self._order_s,
            ra_icrs_deg=ra_icrs_deg,
            dec_icrs_deg=dec_icrs_deg,
            now_utc_ns=now_utc_ns,
        )

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        """Return the mount's latest state.

        ``not_before_utc_ns``, in a simulated observatory: wait for a report of this instant or
        later. Raises InstrumentError when none comes within ``timeout_s`` of wall time.
        """
        if not self._config.simulated:
            answer = self.process.request("report", timeout_s)
            return self._take_report(_to_report(answer["report"]))
        # INDI's stamps are whole microseconds.
        wanted_utc_ns = (not_before_utc_ns or 0) // _STAMP_NS * _STAMP_NS

        def is_fresh() -> bool:
            return self._latest is not None and self._latest.t_utc_ns >= wanted_utc_ns

        if not self.process.wait(is_fresh, timeout_s):
            self.process.end_if_hung()
            raise InstrumentError(
                f"the mount has not reported for {timeout_s:.0f} s: check its cable and driver"
            )
        latest = self._latest
        assert latest is not None
        return latest

    def abort(
        self, timeout_s: float = 2.0, *, on_news: Callable[[StopResult], None] = ignore_stop_result
    ) -> StopResult:
        """End motion at once, then measure how the mount moves; never raises.

        Returns when ABORT is answered, or after ``timeout_s``; ``on_news`` gets the measured motion
        later. The setting ``mount.after_stop`` decides whether tracking is then on: "track"
        restores it only where the mount tracked, or was slewing to track.
        """
        self._pier.forget_slew()
        deadline_s = time.monotonic() + timeout_s
        had_tracking = self._tracks_after_stop
        stop = MountStop(on_news)
        number = next(self._stop_numbers)
        self._stops[number] = stop
        self._has_order = True

        def through_the_process() -> StopResult:
            answer = self.process.request(
                "abort", timeout_s + _ABORT_ANSWER_S, had_tracking=had_tracking, number=number
            )
            return _to_result(answer)

        past_it = self._past_the_process(stop, deadline_s, had_tracking)
        way_past: threading.Thread | None = None
        if self.process.pid is not None:
            stop.begin("mount", through_the_process)
        if not stop.wait_answered(_ABORT_ANSWER_S):
            way_past = stop.begin("indi", past_it)
        result = stop.wait_end(deadline_s + _SETTLED_S)
        if way_past is not None and stop.leaves_to("mount"):
            # It must not turn tracking on behind an order that comes after this.
            way_past.join(_ABORT_ANSWER_S)
        expired = threading.Timer(_MEASURED_S, self._end_stop, (number, "nothing was heard of it"))
        expired.daemon = True
        expired.start()
        return result

    def _past_the_process(
        self, stop: MountStop, deadline_s: float, had_tracking: bool | None
    ) -> Callable[[], StopResult]:
        """Return a STOP by a second plain connection.

        It returns when ABORT is answered; the measurement continues on a thread.
        """

        def act() -> StopResult:
            first: queue.SimpleQueue[StopResult] = queue.SimpleQueue()

            def take(result: StopResult) -> None:
                if result.motion is None:
                    first.put(result)
                else:
                    stop.measured("indi", result.motion)

            watched = StopCallbacks(
                on_ordered=lambda: stop.ordered("indi"),
                on_answered=lambda: stop.answered("indi"),
                is_over=lambda: stop.leaves_to("mount"),
            )
            indi = self._config
            threading.Thread(
                target=stop_mount,
                args=(indi.host, indi.port, indi.mount, max(0.2, deadline_s - time.monotonic())),
                kwargs={
                    "after_stop": self._mount.after_stop,
                    "had_tracking": had_tracking,
                    "watched": watched,
                    "on_result": take,
                },
                daemon=True,
                name="stop past the mount's process",
            ).start()
            return first.get(timeout=_PAST_S)

        return act

    def _end_stop(self, number: int, why: str = "", *, is_superseded: bool = False) -> None:
        stop = self._stops.pop(number, None)
        if stop is not None:
            stop.end(why, is_superseded=is_superseded)

    def _new_order(self) -> None:
        """End the measurement of earlier STOPs for a new order."""
        self._has_order = True
        for number in tuple(self._stops):
            why = "another order came before it was measured"
            self._end_stop(number, why, is_superseded=True)

    def park(self) -> None:
        """Order the mount to its park position."""
        self._new_order()
        self._pier.forget_slew()
        self.process.request("park", self._order_s)

    def unpark(self) -> None:
        """Release a parked mount."""
        self._new_order()
        self.process.request("unpark", self._order_s)

    def set_tracking(self, is_on: bool) -> None:
        """Turn sidereal tracking on or off."""
        self.process.request("set_tracking", self._order_s, is_on=is_on)

    def set_sidereal_rate(self) -> None:
        """Set the sidereal rate, where the mount has another one to track at."""
        self.process.request("set_sidereal_rate", self._order_s)

    def abilities(self) -> MountAbilities:
        """Return what the mount's driver can do."""
        return MountAbilities(**self.process.request("abilities", self._order_s)["abilities"])

    def set_site(self, site: Site) -> None:
        """Set the site in the mount."""
        self.process.request("set_site", self._order_s, **dataclasses.asdict(site))

    def check_site(self, site: Site) -> SiteCheck:
        """Compare the mount's own site with ``site``, the configured one."""
        answer = self.process.request("site", self._order_s)["site"]
        if answer is None:
            detail = "the mount does not tell its site"
            return SiteCheck(is_consistent=True, reported=None, detail=detail)
        reported = Site(**answer)
        distance_km = _KM_PER_DEG * separation_deg(
            site.longitude_deg, site.latitude_deg, reported.longitude_deg, reported.latitude_deg
        )
        is_consistent = distance_km <= _SITE_TOLERANCE_KM
        detail = (
            "the mount stands at the configured site"
            if is_consistent
            else f"the mount believes to stand {distance_km:.0f} km from the configured site"
        )
        return SiteCheck(is_consistent=is_consistent, reported=reported, detail=detail)

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        """Renew the lease on motion; never raises, never waits, starts no process.

        The arguments are those of ``MountPort.keep``.
        """
        if not self.process.send("keep", lease_s=lease_s, track_until_utc_ns=track_until_utc_ns):
            log.debug("the mount's process did not hear that the mount is watched")

    def utc_offset_s(self) -> float | None:
        """Return the mount's clock minus the engine's, s; None when the mount reports no time."""
        offset = self.process.request("utc_offset", self._order_s)["offset_s"]
        return None if offset is None else float(offset)

    def take_messages(self) -> tuple[str, ...]:
        """Remove and return the messages of the mount's process about its own actions."""
        return drain_messages(self._messages)

    def take_slew_end(self) -> SlewEnd | None:
        """Return, once, how the mount's process ended an unwatched slew; None: it ended none."""
        taken, self._slew_end = self._slew_end, None
        return taken

    def restart(self) -> None:
        """End the process, start a new one and connect."""
        self.process.restart()

    def close(self) -> None:
        """End the process; it leaves the mount tracking at the sidereal rate, not slewing."""
        self.process.close()

    def _on_event(self, message: dict[str, Any]) -> None:
        if message.get("event") == "report":
            self._take_report(_to_report(message["report"]))
            self._tracks_after_stop = message["tracks_after_stop"]
        elif message.get("event") == "slew ended":
            self._slew_end = SlewEnd(
                unwatched_s=float(message["unwatched_s"]), lease_s=float(message["lease_s"])
            )
        elif message.get("event") in ("stop ordered", "stop answered"):
            stop = self._stops.get(message["number"])
            if stop is None:
                return
            if message["event"] == "stop answered":
                stop.answered("mount", message["at_s"])
            else:
                stop.ordered("mount", message["at_s"])
        elif message.get("event") == "stop measured":
            self._measured(message)
        elif message.get("event") == "message":
            self._say(str(message["text"]))

    def _measured(self, message: dict[str, Any]) -> None:
        """Handle a measured motion since the open STOPs."""
        motion = None if message["motion"] is None else Motion(**message["motion"])
        if motion is not None:
            self._has_order &= not motion.is_at_rest
            if not self._stops:  # it was stopped by the watch, or after its driver came back
                self._say(_motion_words(motion))
        for number, stop in tuple(self._stops.items()):
            if motion is not None:
                stop.measured("mount", motion, message["at_s"])
            if message["is_over"]:
                self._end_stop(number)

    def _say(self, text: str) -> None:
        self._messages.append(text)
        log.warning("%s", text)

    def _take_report(self, report: MountReport) -> MountReport:
        report = dataclasses.replace(report, pier_side=self._pier.side(report))
        self._latest = report
        if report.motion.is_at_rest and not report.is_slewing:
            self._has_order = False
        return report


def _to_report(table: dict[str, Any]) -> MountReport:
    return MountReport(**{**table, "motion": Motion(**table["motion"])})


def _to_result(answer: dict[str, Any]) -> StopResult:
    return StopResult(
        is_answered=bool(answer["is_answered"]),
        ms=0.0,
        path="mount",
        detail=answer["detail"],
        is_tracking=answer["is_tracking"],
    )


def _motion_words(motion: Motion) -> str:
    since = "" if motion.kind == "unknown" else "since then "
    return since + measured_text(motion.kind, motion.rate_deg_s)
