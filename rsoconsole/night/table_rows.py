"""Rows of a session's public tables, made from its log. Pure."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rsoconsole.records import (
    SUPERSEDED,
    TABLES,
    Column,
    FollowedAgain,
    Reason,
    Table,
    column_value,
)
from rsoconsole.session import to_json_value
from rsoconsole.words import text

Row = dict[str, Any]
Logged = tuple[int, int, Any]
"""A record with its place: (place in the log, UTC nanoseconds, record), as the reader gives it."""


def public_table_rows(name: str, log: Sequence[Logged], files: Iterable[Row] = ()) -> list[Row]:
    """Return the rows of the public table ``name``, in the order of the log.

    ``log``: (place, UTC nanoseconds, record) in order. ``files``: rows of the session's view
    ``frames``, which give the columns about files.
    """
    table = TABLES[name]
    rows = list(_rows(table, log))
    if table.may_be_superseded:
        last = {r.frame_id: seq for seq, _, r in log if isinstance(r, FollowedAgain)}
        for row in rows:
            row[SUPERSEDED.name] = last.get(row["frame_id"], 0) > row["seq"]
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
        head = {"seq": seq, "t_utc_ns": t_utc_ns, "frame_id": getattr(record, "frame_id", None)}
        for number, part in _parts(table, record):
            yield head | {each.name: _plain(_member(number, part, each)) for each in columns}


def _parts(table: Table, record: Any) -> Iterable[tuple[Any, Any]]:
    """Yield the rows of one record: (number or key, source of the columns)."""
    if not table.parts:
        return ((None, record),)
    parts = getattr(record, table.parts)
    return tuple(parts.items()) if isinstance(parts, Mapping) else enumerate(parts)


def _member(number: Any, part: Any, column: Column) -> Any:
    if column.record_path in {"#", "="}:
        return number if column.record_path == "#" else part
    return column_value(part, column)


def _plain(value: Any) -> Any:
    """Return the value; records, and tuples of records, as the log's JSON."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Reason):
        return text(value)
    if isinstance(value, tuple) and all(isinstance(each, tuple | float) for each in value):
        return value
    return json.dumps(to_json_value(value), separators=(",", ":"))
