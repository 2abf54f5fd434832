"""The field as a whole in the engine's status: pairs of tracks, and who is missing."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from rsoconsole.control.text import one_line
from rsoconsole.records import ExpectedMembers, PairMotion
from rsoconsole.sky import utc_ns_to_iso

MOST_LINES = 12
"""Of pairs and of missing objects in plain lines: JSON has all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairNow:
    """How two tracks move to each other, as of the last frame; as ``records`` has it."""

    track_id: int = 0
    other_track_id: int = 0
    separation_arcsec: float | None = None
    sigma_separation_arcsec: float | None = None
    position_angle_deg: float | None = None
    separation_rate_arcsec_min: float | None = None
    sigma_separation_rate_arcsec_min: float | None = None
    closest: str = ""
    """now, ahead or beyond."""
    closest_utc_ns: int | None = None
    sigma_closest_s: float | None = None
    closest_arcsec: float | None = None
    closest_low_arcsec: float | None = None
    """The interval of 68 %."""
    closest_high_arcsec: float | None = None
    horizon_s: float | None = None
    path: str = ""
    """straight or curved."""
    is_close: bool = False
    """The operator is warned of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenNow:
    """A catalogued object that should be in the field and has no track."""

    norad_id: int = 0
    name: str | None = None
    ra_icrs_deg: float | None = None
    dec_icrs_deg: float | None = None
    x_px: float | None = None
    y_px: float | None = None
    is_usable: bool = False
    """Its whole streak would be in the frame."""
    is_lit: bool = False


def pairs_now(pairs: Iterable[PairMotion]) -> tuple[PairNow, ...]:
    """The nearest first."""
    read = [PairNow(**_members(PairNow, each)) for each in pairs]
    return tuple(sorted(read, key=lambda each: each.separation_arcsec or 0.0))


def unseen_now(expected: ExpectedMembers | None) -> tuple[UnseenNow, ...]:
    """As of the last look at the catalogue."""
    unseen = () if expected is None else expected.unseen
    return tuple(UnseenNow(**_members(UnseenNow, each)) for each in unseen)


def field_words(
    pairs: tuple[PairNow, ...], unseen: tuple[UnseenNow, ...], uncatalogued: tuple[int, ...]
) -> list[str]:
    """Each track's nearest neighbour and who is missing, in lines of at most 80 columns."""
    lines = [_pair_words(each) for each in _nearest(pairs)[:MOST_LINES]]
    if uncatalogued:
        lines.append(f"not in the catalogue: track {', '.join(map(str, uncatalogued))}")
    for each in unseen[:MOST_LINES]:
        why = "" if each.is_lit else ", in shadow"
        why += "" if each.is_usable else ", at the edge"
        name = one_line(each.name or "")[:24]
        place = f"x {each.x_px or 0.0:.0f} y {each.y_px or 0.0:.0f}{why}"
        lines.append(f"expected, not seen: {name} ({each.norad_id}) {place}")
    return lines


def _nearest(pairs: tuple[PairNow, ...]) -> list[PairNow]:
    """Those in which one is the other's nearest, and those of a warning."""
    met: set[int] = set()
    found = []
    for each in pairs:
        if each.is_close or not {each.track_id, each.other_track_id} <= met:
            found.append(each)
        met |= {each.track_id, each.other_track_id}
    return found


def _pair_words(pair: PairNow) -> str:
    least = {"now": "they part", "beyond": "still nearing"}.get(pair.closest)
    if least is None:
        when = utc_ns_to_iso(pair.closest_utc_ns or 0, 0)[11:16]
        low, high = pair.closest_low_arcsec or 0.0, pair.closest_high_arcsec or 0.0
        least = f'least {low:.0f} to {high:.0f}" {when}Z'
    mark = " !" if pair.is_close else ""
    return (
        f"{pair.track_id}-{pair.other_track_id}: {pair.separation_arcsec or 0.0:.1f} ±"
        f' {pair.sigma_separation_arcsec or 0.0:.1f}"'
        f" {pair.separation_rate_arcsec_min or 0.0:+.2f} ±"
        f' {pair.sigma_separation_rate_arcsec_min or 0.0:.2f}"/min, {least}{mark}'
    )


def _members(kind: type, record: Any) -> dict[str, Any]:
    return {each.name: getattr(record, each.name) for each in fields(kind)}
