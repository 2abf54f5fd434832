"""The public tables of a session: their columns, with type and meaning.

Each table is declared once. From its declaration are made: the SQL of the views
(``session/log/schema.py``), the notebook's tables, and the documentation (``python -m
rsoconsole.records.columns sessions/README.md``; a test compares both). Exported tables are declared
in the same language (``library/formats/rows.py``), and have every number, text or truth that a
measurement has here.

A new column takes a field of a record and a line here.

A column's unit is in its name, so that no table can state another unit.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

from rsoconsole.records.column_specs import (
    OF_CANDIDATE,
    OF_EXPECTED,
    OF_FILES,
    OF_FRAME,
    OF_LEAP,
    OF_LOW_PASS,
    OF_MEASUREMENT,
    OF_MISS,
    OF_NAME,
    OF_NOT_FOLLOWED,
    OF_ORBIT,
    OF_PAIR,
    OF_QUALITY,
    OF_SLEW,
    OF_SOLUTION,
    OF_TRACK,
)
from rsoconsole.records.field import ExpectedMembers, PairMotions
from rsoconsole.records.frames import Detections, NotSolved, Solution
from rsoconsole.records.leaps import LeapDone, LowPass
from rsoconsole.records.steps import (
    CycleTiming,
    Event,
    FrameTaken,
    Identified,
    Measurement,
    Miss,
    NotFollowed,
    OperatorAction,
    OrbitEstimate,
    ParameterChange,
    SlewCommand,
    StateChange,
    TrackState,
)

ColumnType: TypeAlias = Literal["integer", "real", "text", "truth", "json"]
"""Type of a column; json: a record or mapping, as the log has it; real with a shape: nested lists
of numbers."""
Source: TypeAlias = Literal["log", "files"]

_UNITS = (
    ("_arcsec_px", "arcsec / pix"),
    ("_arcsec_min", "arcsec / min"),
    ("_deg_s", "deg / s"),
    ("_km_s", "km / s"),
    ("_arcsec_s", "arcsec / s"),
    ("_arcsec2", "arcsec2"),
    ("_arcsec", "arcsec"),
    ("_bytes", "byte"),
    ("_utc_ns", "ns"),
    ("_deg", "deg"),
    ("_km", "km"),
    ("_px", "pix"),
    ("_mag", "mag"),
    ("_s", "s"),
)
_WORDED = frozenset(("reason", "outcome"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column of a table."""

    name: str
    type: ColumnType
    meaning: str
    path: str = ""
    """Members and indices joined by points, in the record or the part of it that a row is; "#" is
    the part's number or key, "=" its value. Empty: the column's own name."""
    shape: tuple[int, ...] = ()
    """Shape of the matrices in the column, () for none; a matrix of another shape is JSON."""
    source: Source = "log"

    @property
    def unit(self) -> str | None:
        """Unit as astropy writes it, by the ending of the name; None where it names no unit."""
        if self.name == "ms":
            return "ms"
        return next((unit for ending, unit in _UNITS if self.name.endswith(ending)), None)

    @property
    def is_worded(self) -> bool:
        """True where the record has a reason with figures, and the column has its sentence."""
        return self.place in _WORDED

    @property
    def place(self) -> str:
        """Path of the column in the record: ``path``, or the name where that is empty."""
        return self.path or self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """One of the session's public views."""

    name: str
    kind: type
    """Type of the record that its rows are made from."""
    row: str
    """What one row is, in words: "an exposure"."""
    own: tuple[Column, ...]
    """The columns, without those that every table begins with."""
    parts: str = ""
    """Name of the member of the record whose items are the rows; empty: the record is one row."""
    may_be_superseded: bool = False
    """True where rows may cease to count, after a decision of the operator."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """All columns, in order: those that every table has, then its own."""
        return (*HEAD, *self.own, *((SUPERSEDED,) if self.may_be_superseded else ()))


def columns_of(spec: str, source: Source = "log") -> tuple[Column, ...]:
    """Parse columns, one per line: ``name=path type[shape] meaning``."""
    return tuple(_column(line, source) for line in spec.strip().splitlines())


def _column(line: str, source: Source) -> Column:
    named, kind, meaning = line.split(None, 2)
    name, _, path = named.partition("=")
    plain, _, shape = kind.partition("[")
    sizes = tuple(int(size) for size in shape.removesuffix("]").split(",") if size)
    if plain not in {"integer", "real", "text", "truth", "json"}:
        raise ValueError(f"{line!r} has no type of a column")
    return Column(
        name=name,
        type=plain,  # type: ignore[arg-type]  # looked at above
        meaning=meaning,
        path=path,
        shape=sizes,
        source=source,
    )


HEAD = columns_of("""
seq integer place in the order of the log
t_utc_ns integer when it was put on record
frame_id integer number of the exposure
""")
SUPERSEDED = Column(
    name="is_superseded",
    type="truth",
    meaning="the operator's word has had the frame followed again: the row counts no more",
)
_ABOUT: tuple[Table, ...] = (
    Table(
        name="frames",
        kind=FrameTaken,
        row="an exposure",
        own=(*columns_of(OF_FRAME), *columns_of(OF_FILES, "files")),
    ),
    Table(
        name="image_quality",
        kind=Detections,
        row="what a frame says of focus, seeing and sky",
        own=columns_of(OF_QUALITY),
    ),
    Table(
        name="detections",
        kind=Detections,
        parts="detections",
        row="a streak",
        own=columns_of(f"number=# integer place among them, from 0{OF_CANDIDATE}"),
    ),
    Table(
        name="rejections",
        kind=Detections,
        parts="rejected",
        row="a candidate not taken",
        own=(
            *columns_of("number=# integer place among them, from 0"),
            *(replace(each, path=f"detection.{each.place}") for each in columns_of(OF_CANDIDATE)),
            *columns_of("reason text why not"),
        ),
    ),
    Table(
        name="not_solved",
        kind=NotSolved,
        row="a frame without a plate solution",
        own=columns_of("reason text why\nms real how long it took"),
    ),
    Table(
        name="not_followed",
        kind=NotFollowed,
        row="a measurement the track did not take",
        own=columns_of(OF_NOT_FOLLOWED),
        may_be_superseded=True,
    ),
    Table(
        name="timings",
        kind=CycleTiming,
        parts="stage_ms",
        row="a stage of one cycle",
        own=columns_of("stage=# text its name\nms== real wall time"),
    ),
    Table(name="solutions", kind=Solution, row="a plate solution", own=columns_of(OF_SOLUTION)),
    Table(
        name="measurements",
        kind=Measurement,
        row="a direction on the sky",
        own=columns_of(OF_MEASUREMENT),
    ),
    Table(
        name="track",
        kind=TrackState,
        row="the filter at one instant",
        own=columns_of(OF_TRACK),
        may_be_superseded=True,
    ),
    Table(name="slews", kind=SlewCommand, row="an order to the mount", own=columns_of(OF_SLEW)),
    Table(
        name="misses",
        kind=Miss,
        row="an exposure without the object",
        own=columns_of(OF_MISS),
        may_be_superseded=True,
    ),
    Table(
        name="orbits",
        kind=OrbitEstimate,
        row="the orbit through all that a track has measured, after each measurement",
        own=columns_of(OF_ORBIT),
        may_be_superseded=True,
    ),
    Table(
        name="identifications",
        kind=Identified,
        row="which catalogued object a track is of",
        own=columns_of(OF_NAME),
        may_be_superseded=True,
    ),
    Table(
        name="pairs",
        kind=PairMotions,
        parts="pairs",
        row="how two tracks move to each other",
        own=columns_of(OF_PAIR),
        may_be_superseded=True,
    ),
    Table(
        name="expected",
        kind=ExpectedMembers,
        parts="unseen",
        row="a catalogued object that should be in the frame and is not followed",
        own=columns_of(OF_EXPECTED),
    ),
    Table(
        name="leaps", kind=LeapDone, row="a leap ahead of a low satellite", own=columns_of(OF_LEAP)
    ),
    Table(
        name="low_passes",
        kind=LowPass,
        row="a pass that was followed by leaps, with its orbit",
        own=columns_of(OF_LOW_PASS),
    ),
    Table(
        name="states",
        kind=StateChange,
        row="a change of the loop's state",
        own=columns_of(
            "before text state before\nafter text state after\nreason text why\n"
            "kept_track_id integer the track that can be followed again after it; 0: none"
        ),
    ),
    Table(
        name="parameters",
        kind=ParameterChange,
        row="a changed setting",
        own=columns_of(
            "name text dotted, as in the configuration\nbefore text its value before\n"
            "after text its value from then on\nby text who wanted it"
        ),
    ),
    Table(
        name="actions",
        kind=OperatorAction,
        row="an operator's command",
        own=columns_of(
            "verb text what was wanted\narguments json with what\n"
            "outcome text what came of it\nby text who wanted it\n"
            "outcome_kind=outcome.kind text accepted, done, refused and so on"
        ),
    ),
    Table(
        name="events",
        kind=Event,
        row="a line of the log",
        own=columns_of("level text info, warning or alarm\ntext text what was said"),
    ),
)
TABLES: Mapping[str, Table] = MappingProxyType({each.name: each for each in _ABOUT})
"""Tables by name, in the order of the documentation."""


def column_value(record: Any, column: Column) -> Any:
    """Return the value of a column in a record, or in the part of a record that is the row.

    None where the path leads to nothing.
    """
    value = record
    for step in column.place.split("."):
        if value is None:
            return None
        if step.isdigit():
            value = value[int(step)] if int(step) < len(value) else None
        else:
            value = getattr(value, step)
    return value


def documentation() -> str:
    """Return the Markdown table of all tables, as ``sessions/README.md`` shows it."""
    lines = ["| view | a row is | columns beside those three |", "|---|---|---|"]
    for table in TABLES.values():
        named = ", ".join(column.name for column in table.columns[len(HEAD) :])
        lines.append(f"| `{table.name}` | {table.row} | {named} |")
    return "\n".join(lines)


def with_documentation(page: str) -> str:
    """Return the text of a Markdown page with its table of tables brought up to date."""
    first, *_, last = (line for line in page.splitlines() if _is_of_table(line))
    before, _, rest = page.partition(first)
    return before + documentation() + rest.partition(last)[2]


def _is_of_table(line: str) -> bool:
    return line.startswith(("| view | a row is |", *(f"| `{name}` | " for name in TABLES)))


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        path.write_text(with_documentation(path.read_text(encoding="utf-8")), encoding="utf-8")
