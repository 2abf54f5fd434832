"""Of which approaches of two satellites the operator is warned: once each, and how it ended. Pure.

A warning begins when two are nearer than the configured angle, or more likely than not to come so
near, and ends when they are clear of it again: figures that waver about the angle make no second.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rsoconsole.records import PairMotion
from rsoconsole.words import apart_words, clock, closest_words, tracks_words

Word = tuple[Literal["info", "warning"], str]
LIKELY, UNLIKELY = 0.5, 0.2
CLEAR_SHARE = 1.2
"""Of the angle: they are clear of each other again from there on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Approach:
    """One that the operator has been warned of."""

    nearest_arcsec: float
    nearest_utc_ns: int


class Approaches:
    """Those that are under way."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], _Approach] = {}

    def after(
        self,
        pairs: Sequence[PairMotion],
        alive: Collection[int],
        t_utc_ns: int | None,
        limit_arcsec: float,
    ) -> tuple[Collection[tuple[int, int]], Sequence[Word]]:
        """The pairs that are warned of after a frame, and words for what is new.

        ``alive``: the tracks that are followed; ``t_utc_ns``: the frame's instant.
        """
        words: list[Word] = []
        for pair in [each for each in self._open if not set(alive).issuperset(each)]:
            del self._open[pair]
            gone = " and ".join(str(n) for n in pair if n not in alive)
            words.append(("info", f"{tracks_words(pair)}: warning over, track {gone} ended"))
        for each in pairs:
            if t_utc_ns is None:
                break
            pair = (each.track_id, each.other_track_id)
            known = self._open.get(pair)
            if known is None:
                if _is_close(each, limit_arcsec):
                    self._open[pair] = _Approach(
                        nearest_arcsec=each.separation_arcsec, nearest_utc_ns=t_utc_ns
                    )
                    words.append(("warning", f"{tracks_words(pair)}: {_warning(each)}"))
                continue
            if each.separation_arcsec < known.nearest_arcsec:
                known = self._open[pair] = replace(
                    known, nearest_arcsec=each.separation_arcsec, nearest_utc_ns=t_utc_ns
                )
            if _is_clear(each, limit_arcsec):
                del self._open[pair]
                words.append(("info", f"{tracks_words(pair)}: {_end(each, known, limit_arcsec)}"))
        return frozenset(self._open), words


def _is_close(pair: PairMotion, limit_arcsec: float) -> bool:
    is_near = pair.separation_arcsec < limit_arcsec
    return is_near or (limit_arcsec > 0.0 and pair.close_probability >= LIKELY)


def _is_clear(pair: PairMotion, limit_arcsec: float) -> bool:
    is_apart = pair.separation_arcsec > CLEAR_SHARE * limit_arcsec
    return is_apart and (pair.close_probability <= UNLIKELY or limit_arcsec == 0.0)


def _warning(pair: PairMotion) -> str:
    return f"{apart_words(pair)} apart, {closest_words(pair)}"


def _end(pair: PairMotion, approach: _Approach, limit_arcsec: float) -> str:
    when = clock(approach.nearest_utc_ns, "minute")
    if limit_arcsec == 0.0:
        return "warning over, alert.separation_arcsec is 0"
    if approach.nearest_arcsec < limit_arcsec:
        return f"passed, nearest {approach.nearest_arcsec:.1f}″ at {when}"
    if pair.closest == "now":
        return f"warning over, they part: nearest {approach.nearest_arcsec:.1f}″ at {when}"
    return f"warning over, closest approach now {pair.closest_arcsec:.0f}″"
