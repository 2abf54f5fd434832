"""Checks the mount once a second, whatever moves it, and ends forbidden motions.

On a real telescope this runs on a separate thread, so that it goes on while the loop waits for a
solver or a camera. Under simulation, time passes only while the loop waits, so that the loop itself
makes the check at every step of a wait. The watch acts first and informs the loop afterwards.
"""

import contextlib
import functools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Literal

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import Ordered
from rsoconsole.engine.aim.night import NightEnd, night_end, overrides_still_needed
from rsoconsole.engine.aim.states import LimitMet, NightEnded
from rsoconsole.engine.machine.machine import notify_systemd
from rsoconsole.engine.tasks._limit_stop import LimitStop
from rsoconsole.engine.tasks._observed_motion import (
    How,
    ObservedMotion,
    Own,
    OwnMotion,
    ParkedMotion,
    observed_motion,
    pose_of,
)
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.instruments import Instruments, MountReport
from rsoconsole.records import Event
from rsoconsole.sky import LimitName, Limits, Pose, Refusal, separation_deg

log = logging.getLogger(__name__)

NS = 1_000_000_000
EVERY_S = 1.0
SILENCE_S = 5.0
AHEAD_S = 6 * 3600.0
FORECAST_HOLDS_NS = 300 * NS
LATEST_S = 10.0
"""Age up to which a report still gives the mount's position, s."""
MOVED_DEG = 0.05
STOOD_STILL_S = 5.0
LOOP_SILENCE_S = 180.0
"""Silence after which the loop counts as hanging, s; longer than the usual time limits."""
LIFTS: dict[str, LimitName] = {"sun": "twilight"}
"""The limit that is lifted by overriding an arming check, by the check's name."""
ALL_BUT_SUN: tuple[LimitName, ...] = ("altitude", "horizon", "hour angle", "pier", "twilight")


class Watch:
    """Watches mount, sky and loop: ``look``, or every second within ``running``."""

    def __init__(
        self,
        instruments: Instruments,
        config: Config,
        queue: CommandQueue,
        say: Callable[[Event], None],
        ordered: Callable[[], Ordered | None] = lambda: None,
    ) -> None:
        """``say``: puts a line on record, from any thread.

        ``ordered``: returns the motion that this program has ordered last.
        """
        self._instruments = instruments
        self._config = config
        self._queue = queue
        self._say = say
        self.limits = Limits(config.site.to_site(), config.limits, config.mount)
        self.lifted: frozenset[str] = frozenset()
        """Checks that the operator has overridden by name, as long as their reason stands."""
        self._is_responsible = False
        self._lock = threading.Lock()
        """Lock over the two above, which the loop sets and the watch's thread thins out."""
        self._said: dict[str, str] = {}
        self._forecast_of: tuple[MountReport, frozenset[LimitName]] | None = None
        self.last_report: MountReport | None = None
        self.is_blind = False
        self._last_pose: Pose | None = None
        self._rested: Pose | None = None
        """Pose at the last look before it began to slew."""
        self._ordered = ordered
        self._own, self._parked = OwnMotion(ordered), ParkedMotion()
        self._stop = LimitStop(instruments, say)
        self.next_limit: tuple[int, Refusal] | None = None
        """Time at which sidereal tracking meets a limit, UTC ns, and the limit; None: none near."""
        self._end = threading.Event()
        self._loop_alive_s = time.monotonic()

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config
        self.limits = Limits(config.site.to_site(), config.limits, config.mount)

    def take_over(self, is_responsible: bool, lifted: frozenset[str] | None = None) -> None:
        """Set whether autonomy is responsible for the mount.

        Only then do the end of the night and the least altitude end a motion. ``lifted``: names of
        the checks that are overridden from now on; None: unchanged.
        """
        with self._lock:
            self._is_responsible = is_responsible
            if lifted is not None:
                self.lifted = lifted

    def lifted_limits(self) -> frozenset[LimitName]:
        """Return the limits that are lifted by overridden arming checks."""
        return frozenset(LIFTS[name] for name in self.lifted if name in LIFTS)

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Check once a second on a thread while entered; under simulation the loop checks."""
        if self._instruments.clock.is_simulated:
            yield
            return
        thread = threading.Thread(target=self._run, daemon=True, name="watch")
        thread.start()
        try:
            yield
        finally:
            self._end.set()
            thread.join(SILENCE_S + 1.0)

    def _run(self) -> None:
        looked_s = time.monotonic()
        while not self._end.wait(EVERY_S):
            if time.monotonic() - looked_s > STOOD_STILL_S:
                # Nothing ran, this watch no more than the loop: that is no loop that hangs.
                self._loop_alive_s = time.monotonic()
            self.look()
            looked_s = time.monotonic()

    def loop_is_alive(self) -> None:
        """Note a sign of life of the loop, at every step of a wait; under simulation check, too."""
        self._loop_alive_s = time.monotonic()
        if self._instruments.clock.is_simulated:
            self.look()

    def look(self) -> None:
        """Check loop, weather and mount once, and end motions not allowed; never raises."""
        try:
            self._look_at_the_loop()
            now_ns = self._instruments.clock.now_utc_ns()
            self._look_at_the_sky(now_ns)
            self._look_at_the_mount(now_ns)
            self._said.pop("watch", None)
            self.is_blind = False
        except RsoconsoleError as error:
            self.is_blind = True
            self._say_once("watch", "alarm", f"nobody can tell where the mount is: {error}")
        except Exception:
            # A fault of the watch must be loud, and must not end the watching.
            log.exception("the watch broke")
            self._say_once("watch", "alarm", "the watch over the limits broke: see the log")

    def is_loop_alive(self) -> bool:
        """Return True while the loop has recently given a sign of life; from any thread."""
        silent_s = time.monotonic() - self._loop_alive_s
        frame_s, again_s = (
            self._config.exposure.frame_timeout_s,
            self._config.waits.longest_connection_s,
        )
        return silent_s < max(LOOP_SILENCE_S, 2.0 * frame_s, frame_s + again_s)

    def _look_at_the_loop(self) -> None:
        if self.is_loop_alive():
            notify_systemd("WATCHDOG=1")
            self._said.pop("loop", None)
            return
        words = "the loop hangs: frames have ended, the limits are still watched; restart it"
        self._say_once("loop", "alarm", words)

    def limit_before(self, t_utc_ns: int) -> Refusal | None:
        """Return the limit that sidereal tracking meets before an instant; None without one."""
        if self.next_limit is None or self.next_limit[0] > t_utc_ns:
            return None
        return self.next_limit[1]

    def refusal(self, report: MountReport) -> Refusal | None:
        """Return the limit that forbids the mount's present motion; None where none does.

        None also for a mount that stands or is parked.
        """
        last = self.last_report
        seen = observed_motion(report, last)
        if seen.how == "stands" or (report.is_parked and seen.how != "slews"):
            return None
        pose = pose_of(report)
        own = self._own.kind(pose, seen, self.limits)
        return self._refusal(report, pose, seen, own)

    def end_at_limit(self, words: str) -> None:
        """End motion and tracking before a limit that the loop foresees, and raise an alarm.

        The forecast is forgotten until the next look, so that the loop does not meet the same limit
        again.
        """
        self.next_limit = self._forecast_of = None
        parks = not self._is_responsible
        end = functools.partial(
            self._stop.end, "tracks", self._instruments.clock.now_utc_ns(), parks=parks
        )
        done = self._stop.words("tracks", parks=parks)
        self._queue.stop(LimitMet(words=f"{words}; {done}"), end)

    def abort_ordered(self) -> None:
        """Note that a STOP sends ABORT now, so that the stopping distance can be learned."""
        self._stop.note_abort(self._instruments.clock.now_utc_ns())

    def _held_lifted(self) -> frozenset[LimitName]:
        """Return the limits that end no motion; the least altitude does so under autonomy only."""
        lifted = self.lifted_limits()
        return lifted if self._is_responsible else lifted | {"altitude"}

    def _refusal(
        self, report: MountReport, pose: Pose, seen: ObservedMotion, own: Own | None
    ) -> Refusal | None:
        """Return the limit that forbids a motion; this program's own were checked when ordered."""
        limits = self.limits
        if seen.how != "slews":
            return limits.refuse_pose(pose, is_slewing=False, lifted=self._held_lifted())
        is_parking = own == "park" or report.is_parking or report.is_parked or self._stop.is_parking
        if is_parking or own == "slew":
            return limits.refuse_pose(
                pose,
                is_slewing=True,
                is_parking=is_parking,
                lifted=self.lifted_limits(),
                before=self._last_pose,
            )
        ahead_s = EVERY_S + min(report.age_s, LATEST_S)
        if seen.rates is not None:
            rate_deg_s = seen.rates.fastest_deg_s(pose.dec_icrs_deg)
            ahead_s += self._stop.distance.at(rate_deg_s) / rate_deg_s
        return limits.refuse_motion(
            pose,
            seen.rates,
            ahead_s,
            lifted=self._held_lifted(),
            before=self._last_pose,
            rested=self._rested,
        )

    def night_end(self) -> NightEnd | None:
        """Return the reason to end the night now; None where observing is possible."""
        safety_monitor = self._instruments.safety_monitor
        sky = None if safety_monitor is None else safety_monitor.look()
        now_ns = self._instruments.clock.now_utc_ns()
        return night_end(self._config, now_ns, sky, self.lifted)

    def _look_at_the_mount(self, now_ns: int) -> None:
        mount = self._instruments.mount
        not_before = now_ns if self._instruments.clock.is_simulated else None
        report = mount.report(not_before, SILENCE_S)
        before, self.last_report = self.last_report, report
        pose, seen = pose_of(report), observed_motion(report, before)
        self._own.update(report, pose, seen)
        if (ordered := self._ordered()) is not None:
            self._stop.forget_park(ordered.t_utc_ns)
        self._stop.look(report, pose, seen, is_heeded=not self._queue.is_stopping)
        own = self._own.kind(pose, seen, self.limits)
        is_stopped = self._look_whether_it_is_parked(report, own, now_ns)
        if seen.how == "stands" or (report.is_parked and seen.how != "slews"):
            self._look_at_a_resting_mount(report, pose)
            mount.keep(self._config.mount.lease_s, None)
            return
        refusal = self._refusal(report, pose, seen, own)
        self._last_pose = pose
        if seen.how != "slews":
            self._rested = pose
        if refusal is not None:
            self._end_motion(seen.how, own, refusal, now_ns)
            return
        self._said.pop("limit", None)
        if not is_stopped:
            self._stop.forget_motion()
        self._look_ahead(report, pose, seen)
        mount.keep(
            self._config.mount.lease_s, None if self.next_limit is None else self.next_limit[0]
        )

    def _look_whether_it_is_parked(self, report: MountReport, own: Own | None, now_ns: int) -> bool:
        """Compare the driver's claim that it is parked with the measured motion.

        Some drivers report it as soon as they have the order. True where it moves or tracks: it is
        stopped.
        """
        does = self._parked.motion_while_parked(report)
        parks = own == "park" or report.is_slewing or report.is_parking
        if does is None or (does == "moves" and parks):
            if not report.is_parked:
                self._said.pop("parked", None)
            return False
        how: How = "tracks" if does == "tracks" else "slews"
        if "parked" not in self._said or self._stop.is_due(how, now_ns):
            self._stop.end(how, now_ns, parks=False)
            words = f"the mount says that it is parked and {does} (measured)"
            done = self._stop.words(how, parks=False)
            self._say_once("parked", "alarm", f"{words}: {done}", is_same=True)
        return True

    def _look_at_a_resting_mount(self, report: MountReport, pose: Pose) -> None:
        """Note a mount at rest: nothing can be stopped, but the Sun may come to where it looks."""
        self.next_limit = self._forecast_of = None
        self._last_pose = self._rested = pose
        self._said.pop("limit", None)
        if report.is_parked:
            return
        self._stop.forget_motion()
        refusal = self.limits.refuse_pose(pose, is_slewing=False, lifted=ALL_BUT_SUN)
        if refusal is None:
            self._said.pop("Sun", None)
        else:
            words = f"the telescope stands {refusal.text}: cover it, or park it"
            self._say_once("Sun", "alarm", words, is_same=True)

    def _end_motion(self, how: How, own: Own | None, refusal: Refusal, now_ns: int) -> None:
        """End a motion and report it once; one that goes on is stopped again now and then."""
        if not self._stop.is_due(how, now_ns):
            return
        # Autonomy leads the mount away from a limit by itself, if it can.
        parks = not (self._is_responsible and self._stop.is_first(how))
        end = functools.partial(self._stop.end, how, now_ns, parks=parks)
        if self._said.get("limit") == refusal.limit:
            # Told before: it goes on, or has started to track again without having been moved away.
            with contextlib.suppress(RsoconsoleError):
                end()
            return
        self._said["limit"] = refusal.limit
        whose = "a slew off any way ordered here: " if how == "slews" and own is None else ""
        words = f"{whose}{refusal.text}; {self._stop.words(how, parks=parks)}"
        self._queue.stop(LimitMet(words=words), end)

    def _look_ahead(self, report: MountReport, pose: Pose, seen: ObservedMotion) -> None:
        if seen.how == "slews":
            self.next_limit = self._forecast_of = None
            return
        self._look_how_low(pose)
        lifted = self._held_lifted()
        if self._forecast_of is not None and _holds(*self._forecast_of, report, lifted):
            return
        self.next_limit = self.limits.next_limit(pose, AHEAD_S, lifted=lifted)
        self._forecast_of = report, lifted

    def _look_how_low(self, pose: Pose) -> None:
        """Warn of a low altitude while autonomy is not responsible; the motion is left alone."""
        refusal = None
        if not self._is_responsible:
            refusal = self.limits.refuse_pose(pose, is_slewing=False, lifted=self.lifted_limits())
        if refusal is None:
            self._said.pop("altitude", None)
        else:
            words = f"{refusal.text}: it is let be, for autonomy does not have the mount"
            self._say_once("altitude", "warning", words, is_same=True)

    def _look_at_the_sky(self, now_ns: int) -> None:
        safety_monitor = self._instruments.safety_monitor
        sky = None if safety_monitor is None else safety_monitor.look()
        if sky is not None and sky.weather == "warning" and "weather" not in self.lifted:
            self._say_once("weather", "warning", f"the weather station warns: {sky.detail}")
        else:
            self._said.pop("weather", None)
        with self._lock:
            self.lifted = overrides_still_needed(self._config, now_ns, sky, self.lifted)
            end = night_end(self._config, now_ns, sky, self.lifted)
            is_ours = end is not None and self._is_responsible
            if is_ours:
                self._is_responsible = False
        if end is None:
            self._said.pop("night", None)
        elif is_ours:
            self._queue.interrupt(
                NightEnded(
                    words=end.detail,
                    parks=self._config.mount.park_at_end,
                    is_dawn=end.cause == "dawn",
                )
            )
        elif end.cause != "dawn":
            self._say_once("night", "alarm", f"{end.detail}: the mount is not armed, look to it")

    def _say_once(
        self, about: str, level: Literal["warning", "alarm"], text: str, *, is_same: bool = False
    ) -> None:
        """Report a text once; ``is_same``: not again where only its figures have changed."""
        said = self._said.get(about)
        if said == text or (is_same and said is not None):
            return
        self._said[about] = text
        self._say(Event(level=level, text=text))


def _holds(
    last: MountReport,
    last_lifted: frozenset[LimitName],
    report: MountReport,
    lifted: frozenset[LimitName],
) -> bool:
    """True where the limit found ahead of the last report is still ahead of this one."""
    return (
        last_lifted == lifted
        and last.pier_side == report.pier_side
        and 0 <= report.t_utc_ns - last.t_utc_ns < FORECAST_HOLDS_NS
        and separation_deg(
            last.ra_icrs_deg, last.dec_icrs_deg, report.ra_icrs_deg, report.dec_icrs_deg
        )
        < MOVED_DEG
    )
