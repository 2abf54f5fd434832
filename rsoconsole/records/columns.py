"""Public tables of a session: their columns, with type and meaning.

From the one declaration of a table are made: the SQL of its view (``session/log/schema.py``), the
notebook's table, and its documentation (``python -m rsoconsole.records.columns
sessions/README.md``; a test compares both). Exported tables (``library/formats/rows.py``) are
declared in the same way, and have every number, text and truth value of a measurement.

A new column needs a field of a record and a line here. Its unit is the ending of its name, so that
no table can state another one.
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
    OF_MAGNITUDE,
    OF_MEASUREMENT,
    OF_MISS,
    OF_NAME,
    OF_NOT_FOLLOWED,
    OF_ORBIT,
    OF_PAIR,
    OF_PHOTOMETRY,
    OF_QUALITY,
    OF_SLEW,
    OF_SOLUTION,
    OF_TRACK,
)
from rsoconsole.records.field import ExpectedMembers, PairMotions
from rsoconsole.records.frames import Detections, NotSolved, Solution
from rsoconsole.records.leaps import LeapDone, LowPass
from rsoconsole.records.photometry import Photometry
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
"""Type of a column; json: a record or mapping; real with a shape: nested lists of numbers."""
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
    ("mag", "mag"),
    ("mag_sigma", "mag"),
    ("mag_sigma_colour", "mag"),
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
    """Dotted path in the row's record; "#": number or key, "=": value; empty: the column's name."""
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
    def has_sentence(self) -> bool:
        """True where the record has a reason with figures, and the column its sentence."""
        return self.record_path in _WORDED

    @property
    def record_path(self) -> str:
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


def parse_columns(spec: str, source: Source = "log") -> tuple[Column, ...]:
    """Parse columns of ``source``, one per line: ``name=path type[shape] meaning``."""
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


HEAD = parse_columns("""
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
        own=(*parse_columns(OF_FRAME), *parse_columns(OF_FILES, "files")),
    ),
    Table(
        name="image_quality",
        kind=Detections,
        row="what a frame says of focus, seeing and sky",
        own=parse_columns(OF_QUALITY),
    ),
    Table(
        name="detections",
        kind=Detections,
        parts="detections",
        row="a streak",
        own=parse_columns(f"number=# integer place among them, from 0{OF_CANDIDATE}"),
    ),
    Table(
        name="rejections",
        kind=Detections,
        parts="rejected",
        row="a candidate not taken",
        own=(
            *parse_columns("number=# integer place among them, from 0"),
            *(
                replace(each, path=f"detection.{each.record_path}")
                for each in parse_columns(OF_CANDIDATE)
            ),
            *parse_columns("reason text why not"),
        ),
    ),
    Table(
        name="not_solved",
        kind=NotSolved,
        row="a frame without a plate solution",
        own=parse_columns("reason text why\nms real how long it took"),
    ),
    Table(
        name="not_followed",
        kind=NotFollowed,
        row="a measurement the track did not take",
        own=parse_columns(OF_NOT_FOLLOWED),
        may_be_superseded=True,
    ),
    Table(
        name="timings",
        kind=CycleTiming,
        parts="stage_ms",
        row="a stage of one cycle",
        own=parse_columns("stage=# text its name\nms== real wall time"),
    ),
    Table(name="solutions", kind=Solution, row="a plate solution", own=parse_columns(OF_SOLUTION)),
    Table(
        name="measurements",
        kind=Measurement,
        row="a direction on the sky",
        own=parse_columns(OF_MEASUREMENT),
    ),
    Table(
        name="track",
        kind=TrackState,
        row="the filter at one instant",
        own=parse_columns(OF_TRACK),
        may_be_superseded=True,
    ),
    Table(name="slews", kind=SlewCommand, row="an order to the mount", own=parse_columns(OF_SLEW)),
    Table(
        name="misses",
        kind=Miss,
        row="an exposure without the object",
        own=parse_columns(OF_MISS),
        may_be_superseded=True,
    ),
    Table(
        name="orbits",
        kind=OrbitEstimate,
        row="the orbit through all that a track has measured, after each measurement",
        own=parse_columns(OF_ORBIT),
        may_be_superseded=True,
    ),
    Table(
        name="identifications",
        kind=Identified,
        row="which catalogued object a track is of",
        own=parse_columns(OF_NAME),
        may_be_superseded=True,
    ),
    Table(
        name="pairs",
        kind=PairMotions,
        parts="pairs",
        row="how two tracks move to each other",
        own=parse_columns(OF_PAIR),
        may_be_superseded=True,
    ),
    Table(
        name="expected",
        kind=ExpectedMembers,
        parts="unseen",
        row="a catalogued object that should be in the frame and is not followed",
        own=parse_columns(OF_EXPECTED),
    ),
    Table(
        name="leaps",
        kind=LeapDone,
        row="a leap ahead of a low satellite",
        own=parse_columns(OF_LEAP),
    ),
    Table(
        name="low_passes",
        kind=LowPass,
        row="a pass that was followed by leaps, with its orbit",
        own=parse_columns(OF_LOW_PASS),
    ),
    Table(
        name="photometry",
        kind=Photometry,
        row="a frame's zero point and limiting magnitude",
        own=parse_columns(OF_PHOTOMETRY),
    ),
    Table(
        name="magnitudes",
        kind=Photometry,
        parts="streaks",
        row="the brightness of a streak",
        own=parse_columns(OF_MAGNITUDE),
    ),
    Table(
        name="states",
        kind=StateChange,
        row="a change of the loop's state",
        own=parse_columns(
            "before text state before\nafter text state after\nreason text why\n"
            "kept_track_id integer the track that can be followed again after it; 0: none"
        ),
    ),
    Table(
        name="parameters",
        kind=ParameterChange,
        row="a changed setting",
        own=parse_columns(
            "name text dotted, as in the configuration\nbefore text its value before\n"
            "after text its value from then on\nby text who wanted it"
        ),
    ),
    Table(
        name="actions",
        kind=OperatorAction,
        row="an operator's command",
        own=parse_columns(
            "verb text what was wanted\narguments json with what\n"
            "outcome text what came of it\nby text who wanted it\n"
            "outcome_kind=outcome.kind text accepted, done, refused and so on"
        ),
    ),
    Table(
        name="events",
        kind=Event,
        row="a line of the log",
        own=parse_columns("level text info, warning or alarm\ntext text what was said"),
    ),
)
TABLES: Mapping[str, Table] = MappingProxyType({each.name: each for each in _ABOUT})
"""Tables by name, in the order of the documentation."""


def column_value(record: Any, column: Column) -> Any:
    """Return the value of a column for a row; None where the column's path leads to nothing.

    That is a member that is None, or an index past the end; a name that the record's class lacks
    raises AttributeError. ``record``: the record, or the part of it that is the row.
    """
    value = record
    for step in column.record_path.split("."):
        if value is None:
            return None
        if step.isdigit():
            value = value[int(step)] if int(step) < len(value) else None
        else:
            value = getattr(value, step)
    return value


def tables_markdown() -> str:
    """Return the Markdown table of all tables with their columns, for ``sessions/README.md``."""
    lines = ["| view | a row is | columns beside those three |", "|---|---|---|"]
    for table in TABLES.values():
        named = ", ".join(column.name for column in table.columns[len(HEAD) :])
        lines.append(f"| `{table.name}` | {table.row} | {named} |")
    return "\n".join(lines)


def with_tables_markdown(page: str) -> str:
    """Return a Markdown page with its table of tables replaced by the present one."""
    first, *_, last = (line for line in page.splitlines() if _is_of_table(line))
    before, _, rest = page.partition(first)
    return before + tables_markdown() + rest.partition(last)[2]


def _is_of_table(line: str) -> bool:
    return line.startswith(("| view | a row is |", *(f"| `{name}` | " for name in TABLES)))


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        path.write_text(with_tables_markdown(path.read_text(encoding="utf-8")), encoding="utf-8")
