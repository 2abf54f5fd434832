"""Which pass is waited for: of a catalogued object, or of what was leapt after last."""

from rsoconsole.engine.aim import NS
from rsoconsole.engine.leaps.leap_words import awaited_words
from rsoconsole.engine.leaps.pass_entry import entry_of
from rsoconsole.engine.operator import Control, Parts
from rsoconsole.errors import OrbitError
from rsoconsole.orbits.elements import CatalogueEntry
from rsoconsole.orbits.low import LowOrbit, passes_above
from rsoconsole.pipeline.leaps import Awaited, awaited_on, next_of
from rsoconsole.pipeline.orbits import errors_of

_WAITS_NS = 24 * 3600 * NS
_LOOKS_AGAIN_NS = 3600 * NS


class Awaiting:
    """Finds the next one, by elements or by the last orbit."""

    def __init__(self, control: Control, parts: Parts) -> None:
        self._control = control
        self._parts = parts
        self._site = control.config.site.to_site()
        self.awaited: Awaited | None = None
        """The pass that is waited for; None: whatever comes."""
        self._entry: CatalogueEntry | None = None
        self._last_orbit: LowOrbit | None = None
        """Of what was leapt after last."""
        self._looked_until_ns = 0
        """No pass was found: until then none is looked for again."""
        self._from_ns = 0
        """Passes before that are over."""

    def forget(self) -> None:
        """Nothing is waited for; the next one is found again."""
        self.awaited, self._looked_until_ns = None, 0

    def forget_elements(self) -> None:
        """Another one is to be waited for."""
        self.forget()
        self._entry, self._from_ns = None, 0

    def forget_orbit(self) -> None:
        """It was by a wrong clock."""
        self._last_orbit, self._from_ns = None, 0

    def passed_over(self) -> None:
        """What is waited for cannot be met, or has not come: the next one is looked for."""
        if self.awaited is not None:
            self._from_ns, self.awaited = self.awaited.set_utc_ns, None

    def over(self, orbit: LowOrbit | None) -> None:
        """A pass is over; what is known of its orbit."""
        self.forget()
        self._last_orbit = orbit

    def next_one(self, now_ns: int) -> Awaited | None:
        """The pass that is waited for, found where the last is over; None: whatever comes."""
        awaited, leap = self.awaited, self._control.config.leap
        if awaited is not None and now_ns > awaited.stare.until_utc_ns:
            self._parts.session_log.say("info", f"{awaited.name} did not come by")
            self.passed_over()
            awaited = None
        if awaited is not None or not (leap.pass_norad or leap.waits):
            return awaited
        if now_ns < self._looked_until_ns:
            return None
        try:
            self.awaited = self._next_pass(max(now_ns, self._from_ns))
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

    def _next_pass(self, now_ns: int) -> Awaited | None:
        config, held = self._control.config, self._parts.watch.limits
        lifted = self._parts.watch.lifted_limits()
        if config.leap.pass_norad:
            if self._entry is None:
                self._entry = entry_of(config)
            sigma_s = config.leap.late_sigma_s
            return next_of(
                self._entry,
                self._site,
                now_ns,
                limits=config.limits,
                held=held,
                late_sigma_s=sigma_s,
                lifted=lifted,
                errors=errors_of(config.catalogue),
            )
        orbit = self._last_orbit
        if orbit is None:
            return None
        least_deg = config.limits.min_altitude_deg
        for each in passes_above(orbit, self._site, now_ns, now_ns + _WAITS_NS, least_deg):
            found = awaited_on(
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
