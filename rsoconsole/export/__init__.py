"""The night for others: tables, CCSDS tracking messages, IOD lines, solved frames, DS9 regions.

Reads sessions and branches, writes files beside them, and reads back what it wrote. May touch
session, pipeline and all below; the report is drawn by ``notebook.report``, a floor above.
"""

from rsoconsole.export.api import Export, ExportOptions, Format, export, render
from rsoconsole.export.iod_reader import IodObservation, parse_iod, read_iod
from rsoconsole.export.night import ExportedNight, read_night
from rsoconsole.export.rows import COLUMNS, MeasuredRow
from rsoconsole.export.tables import read_csv, read_ecsv, read_jsonl
from rsoconsole.export.target import Target
from rsoconsole.export.tdm_reader import Tdm, TdmAngles, TdmSegment, parse_tdm, read_tdm

__all__ = [
    "COLUMNS",
    "Export",
    "ExportOptions",
    "ExportedNight",
    "Format",
    "IodObservation",
    "MeasuredRow",
    "Target",
    "Tdm",
    "TdmAngles",
    "TdmSegment",
    "export",
    "parse_iod",
    "parse_tdm",
    "read_csv",
    "read_ecsv",
    "read_iod",
    "read_jsonl",
    "read_night",
    "read_tdm",
    "render",
]
