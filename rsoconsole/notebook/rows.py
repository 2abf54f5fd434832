"""A session's public views row by row, taken from the log's own records: every float exact.

Columns are those of ``sessions/README.md``; SQL may round their decimals in the last digit, these
are what the engine worked with.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rsoconsole.reason_text import text
from rsoconsole.reasons import BelowTau, Cause, Missed, NotTaken
from rsoconsole.records import (
    CycleTiming,
    Detections,
    Event,
    FollowedAgain,
    FrameTaken,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    ParameterChange,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.session.codec import to_json_value

Row = dict[str, Any]
Logged = tuple[int, int, Any]
"""(seq, t_utc_ns, record), as the reader gives it."""
Parts = Callable[[Any], Iterable[tuple[Any, Any]]]
"""The rows that one record makes: (number or key, what the columns are taken from)."""

HEAD = ("seq", "t_utc_ns", "frame_id")
FILES = ("file", "file_bytes", "not_kept_because", "preview", "file_sha256")
"""Of the view ``frames``: from the table of files, not from the log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """From which records a view's rows come, and which of their members its columns are."""

    kind: type
    columns: tuple[tuple[str, str], ...]
    """(column, path): members and indices joined by points; "#" is the part's number or key."""
    parts: Parts = lambda record: ((None, record),)
    is_followed_again: bool = False
    """Has ``is_superseded``: the operator's word had the frame followed again later."""


def _view(kind: type, columns: str, **other: Any) -> View:
    pairs = (word.partition("=") for word in columns.split())
    return View(kind=kind, columns=tuple((n, path or n) for n, _, path in pairs), **other)


_SHAPE = (
    "confidence x_px y_px x_a_px y_a_px x_b_px y_b_px length_px width_px snr sigma_along_px "
    "sigma_across_px is_clipped method x0_px=box_px.0 y0_px=box_px.1 x1_px=box_px.2 "
    "y1_px=box_px.3 unevenness"
)
_REJECTED = " ".join(
    f"{name}=detection.{path or name}"
    for name, _, path in (word.partition("=") for word in _SHAPE.split())
)

VIEWS: dict[str, View] = {
    "frames": _view(
        FrameTaken,
        "name t_start_utc_ns exposure_s width_px height_px pointing_ra_icrs_deg "
        "pointing_dec_icrs_deg",
    ),
    "detections": _view(
        Detections, f"number=# {_SHAPE}", parts=lambda record: enumerate(record.detections)
    ),
    "rejections": _view(
        Detections, f"number=# {_REJECTED} reason", parts=lambda record: enumerate(record.rejected)
    ),
    "solutions": _view(
        Solution,
        "ra_icrs_deg dec_icrs_deg scale_arcsec_px rotation_deg is_flipped matched rms_arcsec "
        "path ms wcs",
    ),
    "not_solved": _view(NotSolved, "reason ms"),
    "measurements": _view(
        Measurement,
        "t_mid_utc_ns ra_icrs_deg dec_icrs_deg x_px y_px confidence source is_clipped "
        "cov_ee_arcsec2=cov_sky_arcsec2.0 cov_en_arcsec2=cov_sky_arcsec2.1 "
        "cov_nn_arcsec2=cov_sky_arcsec2.2 ends_icrs_deg measurement_id",
    ),
    "not_followed": _view(
        NotFollowed,
        "ra_icrs_deg=measurement.ra_icrs_deg dec_icrs_deg=measurement.dec_icrs_deg reason "
        "measurement_id=measurement.measurement_id track_id",
        is_followed_again=True,
    ),
    "track": _view(
        TrackState,
        "step=kind t_state_utc_ns=t_utc_ns ra_icrs_deg=x.0 ra_rate_deg_s=x.1 dec_icrs_deg=x.2 "
        "dec_rate_deg_s=x.3 covariance=P nis innovation_east_arcsec=innovation_arcsec.0 "
        "innovation_north_arcsec=innovation_arcsec.1 "
        "sigma_east_arcsec=sigma_innovation_arcsec.0 "
        "sigma_north_arcsec=sigma_innovation_arcsec.1 misses foretold_by "
        "track_id measurement_id first_measurement_id=begun_with.0 is_lead",
        is_followed_again=True,
    ),
    "slews": _view(SlewCommand, "ra_icrs_deg dec_icrs_deg t_aim_utc_ns reason track_id"),
    "misses": _view(Miss, "reason track_id", is_followed_again=True),
    "states": _view(StateChange, "before after reason"),
    "parameters": _view(ParameterChange, "name before after by"),
    "actions": _view(OperatorAction, "verb arguments outcome by"),
    "events": _view(Event, "level text"),
    "timings": _view(
        CycleTiming,
        "stage=#.0 ms=#.1",
        parts=lambda record: ((item, None) for item in record.stage_ms.items()),
    ),
}


def columns_of(name: str) -> tuple[str, ...]:
    """The columns of a view, in order."""
    view = VIEWS[name]
    own = tuple(column for column, _ in view.columns)
    files = FILES if name == "frames" else ()
    return (*HEAD, *own, *files, *(("is_superseded",) if view.is_followed_again else ()))


def rows_of(name: str, log: Sequence[Logged], files: Iterable[Row] = ()) -> list[Row]:
    """The rows of a view, in the order of the log.

    ``files``: rows of the session's own view ``frames``, for what it knows of files.
    """
    view = VIEWS[name]
    rows = list(_rows(view, log))
    if view.is_followed_again:
        _mark_superseded(rows, log)
    if name == "frames":
        kept = {row["seq"]: row for row in files}
        for row in rows:
            row.update({column: kept.get(row["seq"], {}).get(column) for column in FILES})
    return rows


def _rows(view: View, log: Sequence[Logged]) -> Iterator[Row]:
    for seq, t_utc_ns, record in log:
        if type(record) is not view.kind:
            continue
        head = {
            "seq": seq,
            "t_utc_ns": t_utc_ns,
            "frame_id": getattr(record, "frame_id", None),
        }
        for number, part in view.parts(record):
            get = partial(_member, number, part)
            yield head | {column: _plain(get(path)) for column, path in view.columns}


def _member(number: Any, part: Any, path: str) -> Any:
    value = part
    for step in path.split("."):
        if step == "#":
            value = number
        elif value is None:
            return None
        else:
            value = value[int(step)] if step.isdigit() else getattr(value, step)
    return value


def _plain(value: Any) -> Any:
    """As it is; records and mappings as the JSON that the log has."""
    if value is None or isinstance(value, bool | int | float | str | tuple):
        return value
    if isinstance(value, BelowTau | NotTaken | Missed | Cause):
        return text(value)
    return json.dumps(to_json_value(value), separators=(",", ":"))


def _mark_superseded(rows: list[Row], log: Sequence[Logged]) -> None:
    last = {r.frame_id: seq for seq, _, r in log if isinstance(r, FollowedAgain)}
    for row in rows:
        row["is_superseded"] = last.get(row["frame_id"], 0) > row["seq"]
