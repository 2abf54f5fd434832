"""Records as the tables that sessions have of them, without what only a session's log has."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rsoconsole.night import Row, rows_of
from rsoconsole.notebook import as_table
from rsoconsole.records import TABLES, Column, Record

if TYPE_CHECKING:
    from astropy.table import QTable

_OF_THE_LOG = ("seq", "t_utc_ns", "is_superseded")
FRAME = Column(name="frame", type="text", meaning="The frame by its name.")


def table_of(
    name: str,
    records: Sequence[Record],
    meta: dict[str, Any],
    *,
    names: Mapping[int, str] | None = None,
    extra: Sequence[Column] = (),
    more: Sequence[Row] = (),
) -> "QTable":
    """The view of that name over these records, a ``QTable``; ``sessions/README.md`` describes it.

    ``names``: of the frames, by their numbers, for a first column ``frame``. ``extra``: further
    columns, whose values ``more`` has for each row.
    """
    rows = rows_of(name, [(seq, 0, record) for seq, record in enumerate(records, start=1)])
    columns = [each for each in TABLES[name].columns if each.name not in _OF_THE_LOG]
    if names is not None:
        columns.insert(0, FRAME)
        rows = [{**row, "frame": names.get(row["frame_id"])} for row in rows]
    if extra:
        rows = [{**row, **added} for row, added in zip(rows, more, strict=True)]
    return as_table((*columns, *extra), rows, meta)
