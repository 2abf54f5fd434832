"""A column is added in two files, and every table that shows its record has it with its unit."""

from pathlib import Path

from rsoconsole.records.columns import tables_markdown, with_tables_markdown
from tests.rigs.worked_example import expect_used

ROOT = Path(__file__).parents[2]
MAX_FILES = 2

EXAMPLE = {
    "rsoconsole/records/steps.py": [
        (
            """
    is_clipped: bool = False


def measurement_id_of(""",
            """
    is_clipped: bool = False
    position_angle_deg: float | None = None


def measurement_id_of(""",
        )
    ],
    "rsoconsole/records/column_specs.py": [
        (
            """
measurement_id text its id, unique in the session
""",
            """
measurement_id text its id, unique in the session
position_angle_deg real of the streak, east of north
""",
        )
    ],
}
"""File -> pieces of it: what stands there, and what stands there afterwards."""

USE = """
import csv, io, json, sys
from dataclasses import replace
from pathlib import Path

import rsoconsole
from rsoconsole.library.formats.rows import COLUMNS
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.api import to_csv, to_ecsv, to_jsonl
from rsoconsole.library.notebook.session import open_session
from rsoconsole.records.columns import with_tables_markdown
from rsoconsole.records import Measurement, Ruling
from rsoconsole.session import SessionReader
from rsoconsole.session import SessionWriter
from tests.pages.tables import read_csv

NAME, root = "position_angle_deg", Path(sys.argv[1])
assert Path(rsoconsole.__file__).is_relative_to(Path.cwd()), rsoconsole.__file__

# A night of today, and one that was recorded before there was such a column.
folder, before = Path("night"), root / "sessions" / "intelsat-14"
old = SessionReader(before)
writer = SessionWriter.create(folder, old.config(), {})
for _, t_utc_ns, record in old.records():
    if isinstance(record, Measurement):
        record = replace(record, position_angle_deg=91.25)
    if isinstance(record, Ruling):
        turned = [replace(m, position_angle_deg=91.25) for m in record.refused]
        taken = record.taken and replace(record.taken, position_angle_deg=91.25)
        record = replace(record, taken=taken, refused=tuple(turned))
    writer.append(record, t_utc_ns)
writer.close()
assert writer.faults == ()

# By SQL: the file's own view, and today's over the old file.
new = SessionReader(folder)
with new.connect() as connection:
    (found,) = connection.execute(f"SELECT DISTINCT {NAME} FROM measurements").fetchall()
assert found == (91.25,)
assert {row[NAME] for row in new.view_rows("measurements")} == {91.25}
assert {row[NAME] for row in old.view_rows("measurements")} == {None}

# The notebook's table, with its unit.
table = open_session(folder).table("measurements")
assert str(table[NAME].unit) == "deg" and set(table[NAME].value) == {91.25}

# Exported tables, there and back.
exported = read_exported_night(folder)
rows = list(csv.DictReader(io.StringIO(to_csv(exported.rows))))
assert rows and {row[NAME] for row in rows} == {"91.25"}
Path("night.csv").write_text(to_csv(exported.rows))
assert read_csv(Path("night.csv")) == exported.rows
assert {json.loads(line)[NAME] for line in to_jsonl(exported.rows).splitlines()} == {91.25}
assert f"name: {NAME}, unit: deg, datatype: float64" in to_ecsv(exported)

# The documentation.
page = with_tables_markdown((root / "sessions" / "README.md").read_text(encoding="utf-8"))
(line,) = [line for line in page.splitlines() if line.startswith("| `measurements` |")]
assert line.endswith(f", measurement_id, {NAME} |"), line
print("used")
"""


def test_a_new_column_takes_two_files_and_is_in_every_table(tmp_path: Path) -> None:
    assert len(EXAMPLE) <= MAX_FILES
    expect_used(tmp_path, EXAMPLE, USE)


def test_the_page_is_written_from_the_columns() -> None:
    page = (ROOT / "sessions" / "README.md").read_text(encoding="utf-8")
    assert with_tables_markdown(page) == page
    stale = page.replace(", measurement_id |", " |")
    assert stale != page
    assert with_tables_markdown(stale) == page
    assert tables_markdown() in page
