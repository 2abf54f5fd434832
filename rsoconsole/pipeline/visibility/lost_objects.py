"""Objects for which SGP4 has no place in all or a part of a span. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits import CatalogueEntry, UnusedSet, failure_words
from rsoconsole.sky import IntArray
from rsoconsole.words import catalogued_name, utc_text


@dataclass(frozen=True, slots=True, kw_only=True)
class LostObject:
    """Object without a place at instants of a span."""

    norad_id: int
    name: str
    reason: str
    from_utc_ns: int
    """First instant without a place, of those computed."""
    until_utc_ns: int
    """Last of them."""
    share: float
    """Share of the instants that have no place, above 0 to 1."""

    @property
    def is_always(self) -> bool:
        """True where it has a place at no instant."""
        return self.share == 1.0

    @property
    def unused(self) -> UnusedSet:
        """Its element set, as one that cannot be used."""
        return UnusedSet(norad_id=self.norad_id, name=self.name, reason=self.reason)

    @property
    def words(self) -> str:
        """Object, when it has no place, and why, in one sentence."""
        if self.is_always:
            return self.unused.words
        start, end = (
            utc_text(each, "dated minute") for each in (self.from_utc_ns, self.until_utc_ns)
        )
        name = catalogued_name(self.name, self.norad_id)
        part = f"no place in {100.0 * self.share:.0f} % of the time"
        return f"{name}: {part}, from {start} to {end}: {self.reason}"


def lost_objects(
    entries: Sequence[CatalogueEntry],
    failed: IntArray,
    t_utc_ns: IntArray,
    span_utc_ns: tuple[int, int],
) -> tuple[LostObject, ...]:
    """Return the objects without a place at some instant of a span.

    ``failed``: SGP4's error codes (M, N) of M objects at N instants, 0 where there is a place.
    """
    is_within = (t_utc_ns >= span_utc_ns[0]) & (t_utc_ns <= span_utc_ns[1])
    codes, t = failed[:, is_within], t_utc_ns[is_within]
    found = []
    for n in np.flatnonzero(codes.any(axis=1)):
        at = np.flatnonzero(codes[n])
        found.append(
            LostObject(
                norad_id=entries[int(n)].norad_id,
                name=entries[int(n)].name,
                reason=failure_words(int(codes[n, at[0]])),
                from_utc_ns=int(t[at[0]]),
                until_utc_ns=int(t[at[-1]]),
                share=len(at) / len(t),
            )
        )
    return tuple(found)
