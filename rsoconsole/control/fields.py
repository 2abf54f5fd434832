"""Records that cross the wire field by field: a move's preview, and the tracks of the field."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rsoconsole.control.wire import one_line, to_printable
from rsoconsole.records import PairMotion, UnseenMember
from rsoconsole.words import (
    approach_words,
    catalogued_name,
    separation_rate_words,
    separation_words,
    tracks_words,
    unseen_words,
)

if TYPE_CHECKING:
    from pydantic import TypeAdapter

Record = TypeVar("Record")
_PATHS = frozenset(("session",))
"""Fields that hold file names: passed unchanged, because any cleaning would name another file."""


def to_json_types(value: Any) -> Any:
    """Return a record, or a value of its fields, in types that JSON has."""
    if is_dataclass(value):
        return {each.name: to_json_types(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, tuple):
        return [to_json_types(each) for each in value]
    if isinstance(value, Mapping):
        return dict(value)
    return str(value) if isinstance(value, Path) else value


def read_record(kind: type[Record], data: Mapping[str, Any]) -> Record | None:
    """Return the record of the given kind from an answer's data; None where it cannot be made.

    Texts are cleaned for a terminal. A field with an invalid value counts as missing; None is
    returned where a field without a default is missing.
    """
    from pydantic import ValidationError

    said = {
        name: value if name in _PATHS else _printable(value)
        for name, value in data.items()
        if value is not None
    }
    reader: TypeAdapter[Record] = _reader(kind)  # type: ignore[arg-type]  # a class has a hash
    try:
        return reader.validate_python(said)
    except ValidationError as error:
        odd = {each["loc"][0] for each in error.errors()}
    try:
        return reader.validate_python({n: value for n, value in said.items() if n not in odd})
    except ValidationError:  # a field without a default is not said
        return None


@cache
def _reader(kind: Any) -> "TypeAdapter[Any]":
    # Not loaded by what only gives an order, as STOP does.
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def _printable(value: Any) -> Any:
    if isinstance(value, str):
        return to_printable(value)
    if isinstance(value, Mapping):
        return {name: _printable(each) for name, each in value.items()}
    return [_printable(each) for each in value] if isinstance(value, list) else value


@dataclass(frozen=True, slots=True, kw_only=True)
class MovePreview:
    """Preview of a move: where the telescope would look, and whether it may; nothing has moved."""

    ra_icrs_deg: float
    """Right ascension where the telescope would look, ICRS."""
    dec_icrs_deg: float
    ra_date_deg: float
    """Right ascension of the same direction, equinox of date."""
    dec_date_deg: float
    alt_deg: float
    az_deg: float
    way_deg: float
    """Distance from the telescope's present direction, deg."""
    slew_s: float
    """Duration of the slew, settling included, s."""
    pier_side: str | None = None
    pier_side_after: str | None = None
    margins_deg: tuple[tuple[str, float], ...] = ()
    """Each limit's name, and how far inside it the telescope would be, deg."""
    refused: str | None = None
    """Reason why the telescope may not go there; None where it may."""


MAX_LINES = 12
"""Greatest number of pairs and of missing objects in plain lines; JSON lists all."""


def sort_by_separation(pairs: Iterable[PairMotion]) -> tuple[PairMotion, ...]:
    """Return pairs of tracks in the order of their separation, smallest first."""
    return tuple(sorted(pairs, key=lambda each: each.separation_arcsec))


def neighbours_and_missing_words(
    pairs: Sequence[PairMotion], unseen: Sequence[UnseenMember], uncatalogued: Sequence[int]
) -> list[str]:
    """Return lines of at most 80 columns on each track's nearest neighbour and missing objects.

    ``unseen``: catalogued objects expected in the field that have no track; ``uncatalogued``:
    numbers of tracks that no catalogued object explains.
    """
    lines = [_pair_words(each) for each in _nearest(pairs)[:MAX_LINES]]
    if uncatalogued:
        lines.append(f"not in the catalogue: {tracks_words(uncatalogued)}")
    for each in unseen[:MAX_LINES]:
        name = catalogued_name(one_line(each.name)[:24], each.norad_id)
        lines.append(f"expected, not seen: {unseen_words(name, each)}")
    return lines


def _nearest(pairs: Sequence[PairMotion]) -> list[PairMotion]:
    """Return the pairs of nearest neighbours, and those with a warning."""
    met: set[int] = set()
    found = []
    for each in pairs:
        if each.is_close or not {each.track_id, each.other_track_id} <= met:
            found.append(each)
        met |= {each.track_id, each.other_track_id}
    return found


def _pair_words(pair: PairMotion) -> str:
    mark = " !" if pair.is_close else ""
    return (
        f"{pair.track_id}-{pair.other_track_id}: {separation_words(pair)}"
        f" {separation_rate_words(pair)},"
        f" {approach_words(pair)}{mark}"
    )
