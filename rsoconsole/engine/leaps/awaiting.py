"""The expected pass: of a catalogued object, or of the satellite that was followed last."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from rsoconsole.base import OrbitError
from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import NS
from rsoconsole.engine.leaps._leap_times import LeapDurations
from rsoconsole.engine.operator.by_hand import Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.orbits import (
    CatalogueEntry,
    ExpectedPass,
    LeapTrack,
    LowOrbit,
    osculating_elements,
    passes_above,
)
from rsoconsole.pipeline import (
    AwaitedPass,
    FrameStreak,
    Leap,
    PassOffset,
    PassPlan,
    awaited_pass,
    catalogue_errors,
    next_awaited_pass,
    read_catalogue,
)
from rsoconsole.records import Site
from rsoconsole.sky import EARTH_RADIUS_KM
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso


def load_awaited_elements(config: Config) -> CatalogueEntry:
    """Return the newest elements of the object ``leap.pass_norad``.

    Raises OrbitError, with a remedy.
    """
    number, files = config.leap.pass_norad, config.catalogue.tle_files
    if not files:
        raise OrbitError(
            f"no elements of {number}: name element sets in catalogue.tle_files of the"
            " configuration, or with --tle FILE"
        )
    sets = read_catalogue(files)
    found = [each for each in sets.entries if each.norad_id == number]
    if not found:
        why = "; ".join(each.words for each in sets.not_used if each.norad_id == number)
        raise OrbitError(
            f"no elements of {number} in {', '.join(map(str, files))}"
            + (f" can be used: {why}" if why else "")
        )
    return max(found, key=lambda each: each.epoch_utc_ns)


SEARCHED_NS = NS_PER_DAY


def first_streak_words(
    track: LeapTrack, awaited: AwaitedPass | None, found: PassOffset | None
) -> str:
    """Return words on a satellite's first streak: its rate, its sense, and its delay.

    ``awaited``: the expected pass; ``found``: the streak's offset from its prediction; both None
    where no pass was expected.
    """
    speed = track.best_hypothesis.streaks[0].speed_arcsec_s
    if awaited is None or found is None:
        sure = 100.0 * track.best_hypothesis.probability
        return f"a low satellite, {speed:.0f} arcsec/s: leaps ahead of it (this sense {sure:.0f} %)"
    late = "late" if found.late_s >= 0.0 else "early"
    return (
        f"{awaited.name} comes {abs(found.late_s):.2f} s {late},"
        f" {found.across_arcmin:+.1f} arcmin across, {speed:.0f} arcsec/s: leaps ahead of it"
    )


def awaited_words(awaited: AwaitedPass) -> str:
    """Return words on the expected pass: the object, and when it comes."""
    stare = awaited.stare
    either_s = (stare.until_utc_ns - stare.from_utc_ns) / 2 / NS_PER_S
    return (
        f"waits for {awaited.name}, which comes by at"
        f" {utc_ns_to_iso(stare.t_through_utc_ns, 0)} ± {either_s:.0f} s"
    )


def successful_leap_words(track: LeapTrack, seen: FrameStreak, leap: Leap | None) -> str:
    """Return words on a leap that met its satellite: number, streak and fit of the orbit."""
    best, number = track.best_hypothesis, len(track.best_hypothesis.streaks) - 1
    words = f"leap {number} met: {seen.detection.length_px:.0f} px"
    if leap is not None:
        slew = f"slew {leap.slew_s:.1f} s"
        words += f", {slew}, {100 * leap.within:.0f} % sure of it"
    orbit = best.orbit
    if orbit is not None:
        across = orbit.residuals_arcsec[..., 1]
        words += f"; across {np.sqrt(np.mean(across**2)):.1f} arcsec rms"
    return words


def pass_words(plan: PassPlan) -> str:
    """Return words on the plan of a pass, as made before its first leap."""
    return f"up to {len(plan.leaps)} leaps{_flips_words(plan)}; then: {_end_words(plan)}"


def remaining_pass_words(plan: PassPlan, *, is_dark: bool) -> str:
    """Return the rest of a pass in words: the number of leaps, until when, and what ends it.

    ``is_dark``: True where the Earth's shadow ends the pass.
    """
    words = f"by its orbit up to {len(plan.leaps)} more leaps{_flips_words(plan)}"
    if plan.leaps:
        words += f", until {utc_ns_to_iso(plan.leaps[-1].t_close_utc_ns, 0)[11:]}"
    return f"{words}; then: {'the shadow of the Earth' if is_dark else _end_words(plan)}"


def _end_words(plan: PassPlan) -> str:
    return plan.end.kind if plan.end.refusal is None else plan.end.refusal.text


def _flips_words(plan: PassPlan) -> str:
    if not plan.flip_count:
        return ""
    return f", {plan.flip_count} of them over the pier ({plan.longest_gap_s:.0f} s)"


def pass_summary_words(track: LeapTrack, parts: Sequence[LeapDurations]) -> str:
    """Return words on a finished pass: its streaks, and the median durations of its leaps."""
    streaks = track.best_hypothesis.streaks
    span_s = (streaks[-1].t_mid_utc_ns - streaks[0].t_mid_utc_ns) / NS_PER_S
    scatter_s = track.best_hypothesis.scatter_s
    words = f"{len(streaks)} streaks in {span_s:.0f} s, shutter ± {scatter_s:.2f} s"
    if not parts:
        return words

    def median(of: Callable[[LeapDurations], float]) -> float:
        return float(np.median([of(each) for each in parts]))

    return (
        f"{words}; a leap took {median(lambda each: each.total_s):.1f} s: slew"
        f" {median(lambda each: each.slew_s):.1f}, settle {median(lambda each: each.settle_s):.1f},"
        f" shutter {median(lambda each: each.shutter_s):.1f}, exposure"
        f" {median(lambda each: each.open_s):.2f}, read-out"
        f" {median(lambda each: each.readout_s):.1f}, wait {median(lambda each: each.wait_s):.1f}"
    )


def next_pass_of(
    orbit: LowOrbit, site: Site, now_utc_ns: int, least_altitude_deg: float
) -> ExpectedPass | None:
    """Return an orbit's next pass within a day; None where there is none."""
    later = passes_above(
        orbit, site, now_utc_ns + 600 * NS_PER_S, now_utc_ns + SEARCHED_NS, least_altitude_deg
    )
    return next(iter(later), None)


def orbit_words(orbit: LowOrbit, later: ExpectedPass | None) -> Iterator[str]:
    """Yield lines on an orbit and its next pass, with their uncertainties."""
    found = osculating_elements(orbit.r_km, orbit.v_km_s)
    yield (
        f"its orbit: {found.a_km - EARTH_RADIUS_KM:.0f} km, e {found.e:.4f},"
        f" i {found.i_deg:.2f} deg{', taken to be nearly round' if orbit.believes_round else ''}"
    )
    if later is not None:
        yield (
            f"its next pass: {utc_ns_to_iso(later.rise_utc_ns, 0)} ± {later.sigma_s:.1f} s,"
            f" ± {later.sigma_across_deg:.2f}° across,"
            f" up to {later.top_altitude_deg:.0f}°"
        )


_LOOKS_AGAIN_NS = 3600 * NS


class PassFinder:
    """Finds the next pass to wait for, by elements or by the last satellite's own orbit."""

    def __init__(self, control: LoopControl, parts: Parts) -> None:
        self._control = control
        self._parts = parts
        self._site = control.config.site.to_site()
        self.awaited: AwaitedPass | None = None
        """The pass that is waited for; None: any satellite will do."""
        self._entry: CatalogueEntry | None = None
        self._last_orbit: LowOrbit | None = None
        self._looked_until_ns = 0
        """Time until which no further search is made, as no pass was found, UTC ns."""
        self._from_ns = 0
        """Time before which all passes are over, UTC ns."""

    def forget_pass(self) -> None:
        """Forget the expected pass, so that ``next_pass`` searches again."""
        self.awaited, self._looked_until_ns = None, 0

    def forget_elements(self) -> None:
        """Forget the elements, because another satellite is expected now."""
        self.forget_pass()
        self._entry, self._from_ns = None, 0

    def forget_orbit(self) -> None:
        """Forget the orbit of the satellite followed last, because the clock was wrong."""
        self._last_orbit, self._from_ns = None, 0

    def skip_pass(self) -> None:
        """Give up the expected pass; ``next_pass`` then finds a later one."""
        if self.awaited is not None:
            self._from_ns, self.awaited = self.awaited.set_utc_ns, None

    def note_pass_over(self, orbit: LowOrbit | None) -> None:
        """Note that a pass has ended; ``orbit``: the orbit found from it, None without one."""
        self.forget_pass()
        self._last_orbit = orbit

    def next_pass(self, now_ns: int) -> AwaitedPass | None:
        """Return the pass to wait for; a new one is searched for where the last is over.

        None where no pass is configured or found: then the telescope waits for any satellite.
        """
        awaited, leap = self.awaited, self._control.config.leap
        if awaited is not None and now_ns > awaited.stare.until_utc_ns:
            self._parts.session_log.say("info", f"{awaited.name} did not come by")
            self.skip_pass()
            awaited = None
        if awaited is not None or not (leap.pass_norad or leap.waits):
            return awaited
        if now_ns < self._looked_until_ns:
            return None
        try:
            self.awaited = self._find_pass(max(now_ns, self._from_ns))
        except OrbitError as error:
            self._looked_until_ns = now_ns + _LOOKS_AGAIN_NS
            self._parts.session_log.say("warning", f"nothing is waited for: {error}")
            return None
        if self.awaited is not None:
            self._parts.session_log.say("info", awaited_words(self.awaited))
        elif leap.pass_norad or self._last_orbit is not None:
            self._looked_until_ns = now_ns + _LOOKS_AGAIN_NS
            self._parts.session_log.say("info", "no pass within a day to wait for: stares instead")
        return self.awaited

    def _find_pass(self, now_ns: int) -> AwaitedPass | None:
        config, held = self._control.config, self._parts.watch.limits
        lifted = self._parts.watch.lifted_limits()
        if config.leap.pass_norad:
            if self._entry is None:
                self._entry = load_awaited_elements(config)
            sigma_s = config.leap.late_sigma_s
            return next_awaited_pass(
                self._entry,
                self._site,
                now_ns,
                limits=config.limits,
                held=held,
                late_sigma_s=sigma_s,
                lifted=lifted,
                errors=catalogue_errors(config.catalogue),
            )
        orbit = self._last_orbit
        if orbit is None:
            return None
        least_deg = config.limits.min_altitude_deg
        for each in passes_above(orbit, self._site, now_ns, now_ns + SEARCHED_NS, least_deg):
            found = awaited_pass(
                "it",
                orbit.states,
                self._site,
                up_utc_ns=(each.rise_utc_ns, each.set_utc_ns),
                sigma_s=each.sigma_s,
                held=held,
                now_utc_ns=now_ns,
                lifted=lifted,
            )
            if found is not None:
                return found
        return None
