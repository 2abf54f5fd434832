"""Every track of a session: what it measured, its orbit, its name, how it ended. Pure."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsoconsole.control import one_line
from rsoconsole.night.frame import NightFrame
from rsoconsole.night.quality import Quality, quality_of, updates_of
from rsoconsole.records import (
    SUPERSEDED,
    TABLES,
    Column,
    FollowedAgain,
    Identified,
    Measurement,
    OrbitEstimate,
    Reason,
    Table,
    TrackState,
    member,
)
from rsoconsole.session import to_json_value
from rsoconsole.words import identity, text


@dataclass(frozen=True, slots=True, kw_only=True)
class NightTrack:
    """One track, as the record has it at its end; what the operator's word replaced counts not."""

    number: int
    """Its number in the session."""
    states: tuple[TrackState, ...]
    """In order of time: predicted, initial, updated."""
    measurements: tuple[Measurement, ...]
    """Those that it took, in order of time, the first of all among them where it is on record."""
    orbit: OrbitEstimate | None = None
    """The last one."""
    identified: Identified | None = None
    """The last word on which catalogued object it is."""
    missed: Mapping[int, str] = field(default_factory=dict)
    """Frames that did not show it, by their numbers, and why."""
    lost: str = ""
    """What the fold gave it up for, in words; empty: it did not."""
    ended: str = ""
    """What ended it, in words; empty: nothing that is on record."""

    @property
    def name(self) -> str | None:
        """In the catalogue; None where that is not known, or more than one may be it."""
        found = self.identified
        is_known = found is not None and found.verdict == "identified" and bool(found.matches)
        return self.object_words if is_known else None

    @property
    def object_words(self) -> str:
        """What catalogue or ledger say of it: a name, a name in doubt, or that none fits."""
        return one_line(identity(self.identified))

    @property
    def quality(self) -> Quality:
        """How well its updates met what was predicted."""
        return quality_of(updates_of(self.states))


@dataclass(slots=True)
class _Parts:
    states: list[TrackState] = field(default_factory=list)
    missed: dict[int, str] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)
    """What ended it, each time."""
    orbit: OrbitEstimate | None = None
    name: Identified | None = None
    dropped: list[str] = field(default_factory=list)


def tracks_of(frames: Iterable[NightFrame]) -> dict[int, NightTrack]:
    """The tracks of a night's frames by their numbers."""
    parts: dict[int, _Parts] = {}
    measured: dict[str, Measurement] = {}
    for frame in sorted(frames, key=lambda each: each.frame_id):
        measured |= {each.measurement_id: each for each in frame.all_measured}
        for each in frame.tracks:
            states = parts.setdefault(each.track_id, _Parts()).states
            states += [state for state in (each.predicted, each.updated) if state is not None]
        for miss in frame.misses:
            own = None if miss.track_id is None else parts.get(miss.track_id)
            if own is None:
                continue
            own.missed[frame.frame_id] = text(miss.reason)
            if miss.reason.lost is not None:
                own.lost.append(text(miss.reason.lost))
        for orbit in frame.orbits:
            parts.setdefault(orbit.track_id, _Parts()).orbit = orbit
        for name in frame.names:
            parts.setdefault(name.track_id, _Parts()).name = name
        for number in () if frame.decision is None else frame.decision.dropped:
            if number in parts:
                parts[number].dropped.append("dropped by the operator")
    return {
        number: _track(number, own, measured) for number, own in sorted(parts.items()) if own.states
    }


def _track(number: int, own: _Parts, measured: dict[str, Measurement]) -> NightTrack:
    ids: list[str | None] = []
    for state in own.states:
        begun = (*(state.begun_with or ())[:1], *state.begun_through)
        ids += [*begun, state.measurement_id]
    ended = (*own.lost, *own.dropped)
    return NightTrack(
        number=number,
        states=tuple(own.states),
        measurements=tuple(measured[each] for each in ids if each in measured),
        orbit=own.orbit,
        identified=own.name,
        missed=own.missed,
        lost=own.lost[-1] if own.lost else "",
        ended=ended[-1] if ended else "",
    )


Row = dict[str, Any]
Logged = tuple[int, int, Any]
"""(seq, t_utc_ns, record), as the reader gives it."""


def rows_of(name: str, log: Sequence[Logged], files: Iterable[Row] = ()) -> list[Row]:
    """The rows of a view, in the order of the log.

    ``files``: rows of the session's own view ``frames``, for what it knows of files.
    """
    table = TABLES[name]
    rows = list(_rows(table, log))
    if table.may_be_superseded:
        _mark_superseded(rows, log)
    of_files = [column.name for column in table.own if column.source == "files"]
    kept = {row["seq"]: row for row in files} if of_files else {}
    for row in rows:
        row.update({column: kept.get(row["seq"], {}).get(column) for column in of_files})
    return rows


def _rows(table: Table, log: Sequence[Logged]) -> Iterator[Row]:
    columns = [column for column in table.own if column.source == "log"]
    for seq, t_utc_ns, record in log:
        if type(record) is not table.kind:
            continue
        head = {
            "seq": seq,
            "t_utc_ns": t_utc_ns,
            "frame_id": getattr(record, "frame_id", None),
        }
        for number, part in _parts(table, record):
            yield head | {each.name: _plain(_member(number, part, each)) for each in columns}


def _parts(table: Table, record: Any) -> Iterable[tuple[Any, Any]]:
    """The rows that one record makes: (number or key, what the columns are taken from)."""
    if not table.parts:
        return ((None, record),)
    parts = getattr(record, table.parts)
    return tuple(parts.items()) if isinstance(parts, Mapping) else enumerate(parts)


def _member(number: Any, part: Any, column: Column) -> Any:
    if column.place in {"#", "="}:
        return number if column.place == "#" else part
    return member(part, column)


def _plain(value: Any) -> Any:
    """As it is; records, and tuples of records, as the JSON that the log has."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Reason):
        return text(value)
    if isinstance(value, tuple) and all(isinstance(each, tuple | float) for each in value):
        return value
    return json.dumps(to_json_value(value), separators=(",", ":"))


def _mark_superseded(rows: list[Row], log: Sequence[Logged]) -> None:
    last = {r.frame_id: seq for seq, _, r in log if isinstance(r, FollowedAgain)}
    for row in rows:
        row[SUPERSEDED.name] = last.get(row["frame_id"], 0) > row["seq"]
