"""Export of sessions in every format but the report, which ``notebook.report`` draws."""

import csv
import io
import json
import time
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from rsoconsole.base import ExportError, system_errors_as, write_durably
from rsoconsole.library.formats import solved_fits as on_record
from rsoconsole.library.formats.iod import STATION, check_station, site_line, to_iod
from rsoconsole.library.formats.night import ExportedNight, read_exported_night
from rsoconsole.library.formats.rows import COLUMNS, MeasuredRow
from rsoconsole.library.formats.score import ScoreOptions, scored_rows, to_score
from rsoconsole.library.formats.solved_fits import solved_fits, to_regions
from rsoconsole.library.formats.tables import to_astropy_time
from rsoconsole.library.formats.target import Target
from rsoconsole.library.formats.tdm import ORIGINATOR, tdm_to_xml, to_tdm, unclipped_rows
from rsoconsole.library.formats.udl import to_udl

_NAMES = tuple(column.name for column in COLUMNS)
TIME, DIRECTION = "t_mid_utc", "direction"


def to_csv(rows: Iterable[MeasuredRow]) -> str:
    """Return the rows as CSV: a line with the columns' names, then one line a measurement."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_NAMES)
    for row in rows:
        writer.writerow([_csv_field(row.value(name)) for name in _NAMES])
    return text.getvalue()


def to_jsonl(rows: Iterable[MeasuredRow]) -> str:
    """Return the rows as JSON lines, one object for each measurement."""
    return "".join(
        json.dumps({name: row.value(name) for name in _NAMES}, allow_nan=False) + "\n"
        for row in rows
    )


def to_ecsv(night: ExportedNight) -> str:
    """Return a session's measurements as ECSV, with units and descriptions of the columns.

    The table's ``meta`` is ``ExportedNight.table_metadata``. When astropy reads it, ``t_mid_utc``
    is a ``Time`` and ``direction`` a ``SkyCoord``.
    """
    import numpy as np
    from astropy.coordinates import SkyCoord
    from astropy.table import MaskedColumn, Table

    types = {"integer": "int64", "real": "float64", "truth": "bool"}
    table = Table(meta=night.table_metadata())
    for column in COLUMNS:
        if column.name == TIME:
            table[TIME] = to_astropy_time(
                np.array([row.t_mid_utc_ns for row in night.rows], np.int64)
            )
            table[TIME].info.description = column.meaning
            continue
        values = [row.value(column.name) for row in night.rows]
        blank: Any = "" if column.type == "text" else 0
        filled = [blank if value is None else value for value in values]
        table[column.name] = MaskedColumn(
            filled,
            mask=[value is None for value in values],
            dtype=types.get(column.type, str),
            unit=column.unit,
            description=column.meaning,
        )
    places = np.array([(row.ra_icrs_deg, row.dec_icrs_deg) for row in night.rows]).reshape(-1, 2)
    table[DIRECTION] = SkyCoord(*places.T, unit="deg", frame="icrs")
    table[DIRECTION].info.description = "ra_icrs_deg and dec_icrs_deg"
    text = io.StringIO()
    with warnings.catch_warnings():
        # Astropy doubts UTC some years ahead, where leap seconds are not yet decided.
        warnings.filterwarnings("ignore", message=".*dubious year")
        table.write(text, format="ascii.ecsv")
    return text.getvalue()


def _csv_field(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


TextFormat = Literal["csv", "ecsv", "jsonl", "tdm", "tdm-xml", "iod", "udl", "score"]
FrameFormat = Literal["fits", "regions"]
Format = Literal[TextFormat, FrameFormat]
TEXT_FORMATS: tuple[str, ...] = get_args(TextFormat)
FRAME_FORMATS: tuple[str, ...] = get_args(FrameFormat)
MESSAGES = ("tdm", "tdm-xml", "iod", "udl", "score")
"""Formats that hold only measurements taken by tracks, as messages for others."""
_ENDINGS: Mapping[str, str] = {"tdm-xml": "tdm.xml", "udl": "udl.json", "score": "score.csv"}
FOLDER = Path("branches") / "exports"
"""Default folder of exports, relative to the session's folder."""
_SUFFIXES: Mapping[FrameFormat, str] = {"fits": ".fits.fz", "regions": ".reg"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Options of an export."""

    everything: bool = False
    """True: tables also hold refused measurements and the results that a decision replaced."""
    track: int | None = None
    """Id of the only track in TDM, IOD, UDL and SCORE; None: all tracks."""
    target: Target = field(default_factory=Target)
    """Catalogue numbers of the observed object, in TDM, IOD, UDL and SCORE."""
    station: str = STATION
    """Number of the observing station in IOD lines."""
    sky: str = " "
    """State of the sky in IOD lines: one of E, G, F, P, B, T, or blank for not stated."""
    site_line: bool = False
    """True: IOD lines follow a comment with the station's place, as in posts to SeeSat-L."""
    originator: str = ORIGINATOR
    """Originator in TDM, source in UDL."""
    score: ScoreOptions = field(default_factory=ScoreOptions)
    """Observer, detector and filter in SCORE's table."""
    frames: tuple[int, ...] | None = None
    """Numbers of the only frames in FITS and regions; None: all frames."""
    is_forced: bool = False
    """True: existing files are overwritten."""

    def __post_init__(self) -> None:
        """Check the options. Raises ExportError for a value that cannot be written."""
        check_station(self.station, self.sky)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportResult:
    """Result of an export."""

    path: Path | None = None
    """File, or folder with a file for each frame; None where no file was written."""
    files: tuple[Path, ...] = ()
    format: str
    measurements: int
    tracks: int
    left_out: Mapping[str, int] = field(default_factory=dict)
    """Number of measurements left out of the export, by reason."""
    is_simulated: bool


def export(
    session: Path, kind: Format, out: Path | None = None, options: ExportOptions | None = None
) -> ExportResult:
    """Write a session or a branch in another format; each file is written whole or not at all.

    ``out``: a file, or for ``fits`` and ``regions`` a folder; None: ``branches/exports`` in the
    session. Raises SessionError for a folder that is no session; ExportError for what cannot be
    exported, for files that exist (unless ``options.is_forced``) and where nothing can be written.
    """
    options = options or ExportOptions()
    if kind not in (*TEXT_FORMATS, *FRAME_FORMATS):
        formats = ", ".join((*TEXT_FORMATS, *FRAME_FORMATS))
        raise ExportError(
            f"{kind!r} is none of {formats}; html is made by notebook.report.render_report"
        )
    if kind in FRAME_FORMATS:
        return _export_frames(session, kind, out, options)  # type: ignore[arg-type]
    text, made = render(session, kind, options)  # type: ignore[arg-type]
    return save_text(session, text, made, out, is_forced=options.is_forced)


def save_text(
    session: Path, text: str, made: ExportResult, out: Path | None, *, is_forced: bool
) -> ExportResult:
    """Write an exported text to ``out``, or with None to the session's folder of exports.

    ``made``: summary of the export, returned with the path added; ``is_forced``: overwrite an
    existing file. Raises ExportError.
    """
    path = out
    if path is None:
        ending = _ENDINGS.get(made.format, made.format)
        path = session / FOLDER / f"{session.resolve().name}.{ending}"
    write_file(path, text.encode("utf-8"), is_forced=is_forced)
    return replace(made, path=path, files=(path,))


def render(session: Path, kind: TextFormat, options: ExportOptions) -> tuple[str, ExportResult]:
    """Return the text of an export and the export's summary, without writing a file.

    Raises as ``export`` does.
    """
    night = read_exported_night(session, everything=options.everything and kind not in MESSAGES)
    if kind in MESSAGES:
        return _messages(night, kind, options)
    texts = {
        "csv": lambda: to_csv(night.rows),
        "ecsv": lambda: to_ecsv(night),
        "jsonl": lambda: to_jsonl(night.rows),
    }
    made = ExportResult(
        format=kind,
        measurements=len(night.rows),
        tracks=len(night.tracks),
        is_simulated=night.is_simulated,
    )
    return texts[kind](), made


def write_file(path: Path, content: bytes, *, is_forced: bool) -> None:
    """Write a file whole or not at all; ``is_forced``: overwrite an existing one.

    Raises ExportError.
    """
    if path.is_dir():
        raise ExportError(f"{path} is a folder: name a file with --out")
    if path.exists() and not is_forced:
        raise ExportError(f"{path} is there already: --force writes it again, --out names another")
    with system_errors_as(
        ExportError, f"{path} cannot be written: ", "; name another place with --out"
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, content)


def _messages(night: ExportedNight, kind: str, options: ExportOptions) -> tuple[str, ExportResult]:
    """Message of what tracks took, without streaks cut by a frame's edge, and its summary."""
    tracks = night.tracks if options.track is None else (options.track,)
    if not set(tracks) <= set(night.tracks):
        known = ", ".join(map(str, night.tracks)) or "none"
        raise ExportError(f"the session has no track {options.track}; it has {known}")
    if options.target.is_known and len(tracks) > 1:
        raise ExportError(
            f"the session has {len(tracks)} tracks: --track says which of them has that number"
        )
    taken = [row for track in tracks for row in night.track_measurements(track)]
    sent = unclipped_rows(tuple(taken))
    if not sent:
        raise ExportError(
            "no track took anything in this session: there is nothing to report; "
            "csv, ecsv and jsonl carry measurements that no track took"
        )
    text = _text_of(night, kind, tracks, options)
    scored = scored_rows(sent) if kind == "score" else sent
    counted = {
        "without a magnitude in V": len(sent) - len(scored),
        "cut by the frame's edge": len(taken) - len(sent),
        "taken by no track": sum(row.track is None for row in night.rows),
        "of other tracks": sum(row.track is not None for row in night.rows) - len(taken),
    }
    made = ExportResult(
        format=kind,
        measurements=len(scored),
        tracks=len(tracks),
        left_out={words: number for words, number in counted.items() if number},
        is_simulated=night.is_simulated,
    )
    return text, made


def _text_of(
    night: ExportedNight, kind: str, tracks: tuple[int, ...], options: ExportOptions
) -> str:
    if kind == "iod":
        lines = to_iod(
            night, tracks, target=options.target, station=options.station, sky=options.sky
        )
        return site_line(night, options.station) + lines if options.site_line else lines
    if kind == "score":
        return to_score(night, tracks, target=options.target, options=options.score)
    if kind == "udl":
        return to_udl(night, tracks, target=options.target, source=options.originator)
    text = to_tdm(
        night,
        tracks,
        target=options.target,
        created_utc_ns=time.time_ns(),
        originator=options.originator,
    )
    return tdm_to_xml(text) if kind == "tdm-xml" else text


def _export_frames(
    session: Path, kind: FrameFormat, out: Path | None, options: ExportOptions
) -> ExportResult:
    night = read_exported_night(session)
    frames = on_record.frames_on_record(session, night.rows)
    numbers = on_record.selected_frames(frames, options.frames)
    left_out: dict[str, int] = {}
    if options.frames is None:
        usable = [n for n in numbers if kind == "regions" or frames[n].file is not None]
        left_out["pixels not kept"] = len(numbers) - len(usable)
        numbers = [n for n in usable if frames[n].solution is not None]
        left_out["not solved"] = len(usable) - len(numbers)
    if not numbers:
        why = ", ".join(f"{number} {words}" for words, number in left_out.items() if number)
        raise ExportError(
            f"the session has no frame to export ({why or 'it has none'});"
            " session.keep_frames says which frames keep their pixels"
        )
    folder = session / FOLDER / f"{session.resolve().name}-frames" if out is None else out
    paths = [folder / f"{number:06d}{_SUFFIXES[kind]}" for number in numbers]
    there = next((path for path in paths if path.exists()), None)
    if there is not None and not options.is_forced:
        raise ExportError(f"{there} is there already: --force writes it again, --out names another")
    if folder.exists() and not folder.is_dir():
        raise ExportError(f"{folder} is a file: --out names a folder for a file a frame")
    for number, path in zip(numbers, paths, strict=True):
        frame = frames[number]
        is_fits = kind == "fits"
        content = solved_fits(frame, night.config) if is_fits else to_regions(frame).encode()
        write_file(path, content, is_forced=True)
    return ExportResult(
        path=folder,
        files=tuple(paths),
        format=kind,
        measurements=sum(len(frames[number].rows) for number in numbers),
        tracks=len({row.track for n in numbers for row in frames[n].rows if row.track}),
        left_out={words: number for words, number in left_out.items() if number},
        is_simulated=night.is_simulated,
    )
