"""What the report says of the field as a whole: pairs of tracks, and who was expected in vain."""

from collections.abc import Iterable
from dataclasses import dataclass

from rsoconsole.records import ExpectedMembers, PairMotion, PairMotions, Record, UnseenMember

MOST_PAIRS = 40
"""In the page's table, those that came nearest first; the rest stand in the session."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairFacts:
    """Two tracks, as their last motion on record has them, and how near they had been."""

    last: PairMotion
    nearest_arcsec: float
    """Least separation of a frame."""
    nearest_utc_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenFacts:
    """A catalogued object that stood in frames and was not followed there."""

    looks: int
    """How often the catalogue was asked while it should have been there, and no track was of it."""
    of_looks: int
    """How often the catalogue was asked on record."""
    lit: int
    """Of ``looks`` those in which the Sun shone on it."""
    last: UnseenMember


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldFacts:
    """Of the whole field."""

    pairs: tuple[PairFacts, ...] = ()
    """Nearest first."""
    unseen: tuple[UnseenFacts, ...] = ()
    """Those that were missed most often first."""


def field_facts(records: Iterable[Record]) -> FieldFacts:
    """From the records of a session, in order of time."""
    pairs: dict[tuple[int, int], PairFacts] = {}
    unseen: dict[int, tuple[int, int, UnseenMember]] = {}
    looks = 0
    for record in records:
        match record:
            case PairMotions():
                for each in record.pairs:
                    ids = each.track_id, each.other_track_id
                    pairs[ids] = _nearer(pairs.get(ids), each)
            case ExpectedMembers():
                looks += 1
                for member in record.unseen:
                    count, lit, _ = unseen.get(member.norad_id, (0, 0, member))
                    unseen[member.norad_id] = (count + 1, lit + member.is_lit, member)
            case _:
                pass
    return FieldFacts(
        pairs=tuple(sorted(pairs.values(), key=lambda each: each.nearest_arcsec)),
        unseen=tuple(
            UnseenFacts(
                looks=count,
                of_looks=looks,
                lit=lit,
                last=member,
            )
            for _, (count, lit, member) in sorted(
                unseen.items(), key=lambda item: (-item[1][0], item[0])
            )
        ),
    )


def _nearer(before: PairFacts | None, now: PairMotion) -> PairFacts:
    if before is not None and before.nearest_arcsec <= now.separation_arcsec:
        return PairFacts(
            last=now,
            nearest_arcsec=before.nearest_arcsec,
            nearest_utc_ns=before.nearest_utc_ns,
        )
    return PairFacts(last=now, nearest_arcsec=now.separation_arcsec, nearest_utc_ns=now.t_utc_ns)
