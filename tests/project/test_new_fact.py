"""A fact of a frame is added in three files: screen, notebook, report and export show it then."""

from pathlib import Path

from tests.rigs.worked_example import expect_used

MAX_FILES = 3

EXAMPLE = {
    "rsoconsole/records/frames.py": [
        (
            """
    background_adu: float | None = None
""",
            """
    moon_glow_adu: float | None = None
    background_adu: float | None = None
""",
        )
    ],
    "rsoconsole/records/column_specs.py": [
        (
            """
background_adu real median of the sky in a pixel, and the camera's offset without a dark
""",
            """
background_adu real median of the sky in a pixel, and the camera's offset without a dark
moon_glow_adu real of the sky's light what the Moon gives
""",
        )
    ],
    "rsoconsole/night/frame.py": [
        (
            """
    FrameQuantity("star_count", "stars", "", ".0f"),
""",
            """
    FrameQuantity("star_count", "stars", "", ".0f"),
    FrameQuantity("moon_glow_adu", "glow of the Moon", "ADU", ".1f"),
""",
        )
    ],
}
"""File -> pieces of it: what stands there, and what stands there afterwards."""

USE = """
import csv, io, sys
from dataclasses import replace
from pathlib import Path

import rsoconsole
from rsoconsole.console.words.curves import image_quality_lines
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.api import to_csv
from rsoconsole.night import Night
from rsoconsole.library.notebook.session import open_session
from rsoconsole.library import render_report
from rsoconsole.records import Detections
from rsoconsole.session import SessionReader
from rsoconsole.session import SessionWriter

assert Path(rsoconsole.__file__).is_relative_to(Path.cwd()), rsoconsole.__file__
folder, sample = Path("night"), SessionReader(Path(sys.argv[1]) / "sessions" / "intelsat-14")
writer = SessionWriter.create(folder, sample.config(), {})
for _, t_utc_ns, record in sample.records():
    if isinstance(record, Detections):
        record = replace(record, moon_glow_adu=12.5 + record.frame_id)
    writer.append(record, t_utc_ns)
writer.close()
assert writer.faults == ()

# A screen.
reader = SessionReader(folder)
night = Night(folder, reader.read_meta(), reader.config())
for seq, t_utc_ns, record in reader.records():
    night.fold_record(t_utc_ns, record, seq)
lines = image_quality_lines(night.view().rows, 80, 40)
shown = ["".join(text for text, _ in line) for line in lines]
assert any("glow of the Moon" in line and "ADU" in line for line in shown), shown

# A notebook: its table with the unit, and its plot.
session = open_session(folder)
assert session.table("image_quality")["moon_glow_adu"][0] == 13.5
figure = session.plot_quality()
assert any("glow of the Moon" in axis.get_ylabel() for axis in figure.axes)

# The report.
assert "Glow of the Moon" in render_report(folder).html

# An export.
rows = list(csv.DictReader(io.StringIO(to_csv(read_exported_night(folder).rows))))
assert rows and all(float(r["moon_glow_adu"]) == 12.5 + int(r["frame_id"]) for r in rows)
print("used")
"""


def test_a_new_fact_takes_three_files_and_is_shown_everywhere(tmp_path: Path) -> None:
    assert len(EXAMPLE) <= MAX_FILES
    expect_used(tmp_path, EXAMPLE, USE)
