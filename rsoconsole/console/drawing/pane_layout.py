"""Layout of the console's panes for a terminal of any size.

Three layouts are designed: 80 x 24, 120 x 40 (with a close-up below the picture, a plot of the NIS,
the orbit) and 200 x 60 (a third column). Below 80 x 24 the plots shrink to a row each; in smaller
terminals the picture is left out, then the log. State, controller, target and STOP stay to the
last.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

FULL = (80, 24)
LARGE = (112, 36)
THREE_COLUMNS = (180, 50)
WITH_PICTURE = (60, 16)
ONE_LINE_TOP_COLUMNS = 74
LOW_LINES = 20
"""Rows of a terminal below which the time line has one row."""
TUNE_ROWS, OWN_TUNE_ROWS, SKY_ROWS = 26, 26, 18
TUNE_COLUMNS = 36
"""Least columns of the tuning pane beside plots."""
ORBIT_ROWS, ORBIT_COLUMNS = 8, 33
"""Least rows and columns of the orbit pane where it has a place of its own."""
PLOTS_SHARE = 0.53
"""Share of the columns of a large terminal that the plots have, at all rows: half the screen."""
MAX_ORBIT_ROWS = 37
"""Most rows of the orbit pane where it is opened over the plots."""
BANNER_ROWS = {"wide": 3, "narrow": 5}
WIDE_BANNER_COLUMNS = 72

MAX_ALERT_ROWS = 2
MIN_LOG_ROWS = 2

Name = Literal[
    "top",
    "alert",
    "frame",
    "closeup",
    "confidence",
    "east",
    "north",
    "axis",
    "nis",
    "orbit",
    "facts",
    "sky",
    "strip",
    "log",
    "timeline",
    "keys",
]


STRIPS: dict[Name, int] = {"confidence": 1, "east": 1, "north": 1}
"""Rows of each plot where there is little room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A rectangle of cells; (``x``, ``y``) is its upper left cell."""

    x: int
    y: int
    width: int
    height: int


def pane_boxes(
    width: int,
    height: int,
    *,
    alert_rows: int = 0,
    is_log_open: bool = False,
    timeline_rows: int = 0,
    aspect: float = 4 / 3,
) -> dict[Name, Box]:
    """Return the box of every pane that has room; panes without one are not shown.

    ``alert_rows``: rows of the alert.
    ``is_log_open``: True where the log takes the place of all panes.
    ``timeline_rows``: rows of the time line above the keys.
    ``aspect``: width over height of the camera's frames.
    """
    boxes: dict[Name, Box] = {}
    top_rows = 1 if width >= ONE_LINE_TOP_COLUMNS else 2
    y0 = top_rows + alert_rows
    y1 = max(height - 1 - timeline_rows, min(y0, height - 1))
    _put(boxes, "top", Box(x=0, y=0, width=width, height=min(top_rows, height)))
    _put(boxes, "alert", Box(x=0, y=top_rows, width=width, height=min(alert_rows, y1 - top_rows)))
    _put(boxes, "timeline", Box(x=0, y=y1, width=width, height=height - 1 - y1))
    if height - 1 >= top_rows:
        boxes["keys"] = Box(x=0, y=height - 1, width=width, height=1)
    if is_log_open:
        _put(boxes, "log", Box(x=0, y=y0, width=width, height=y1 - y0))
        return boxes
    facts_rows = min(3, max(0, y1 - y0))
    middle = Box(x=0, y=y0, width=width, height=max(0, y1 - y0 - facts_rows))
    if has_tuning_column(width, height):
        _three_columns(boxes, Box(x=0, y=y0, width=width, height=y1 - y0))
    elif width >= LARGE[0] and height >= LARGE[1]:
        _large(boxes, Box(x=0, y=y0, width=width, height=y1 - y0), aspect)
    elif width >= FULL[0] and height >= FULL[1]:
        _full(boxes, middle, facts_rows, aspect)
    elif width >= WITH_PICTURE[0] and height >= WITH_PICTURE[1]:
        _strips(boxes, middle, aspect)
        _put(boxes, "facts", Box(x=0, y=y1 - facts_rows, width=width, height=facts_rows))
    else:
        _bare(boxes, Box(x=0, y=y0, width=width, height=max(0, y1 - y0)), facts_rows)
    return boxes


def make_room_for_strip(boxes: dict[Name, Box]) -> None:
    """Give the log's first row to the strip of tracks, where the log keeps ``MIN_LOG_ROWS``."""
    log = boxes.get("log")
    if log is not None and log.height > MIN_LOG_ROWS:
        boxes["strip"] = replace(log, height=1)
        boxes["log"] = replace(log, y=log.y + 1, height=log.height - 1)


def banner_box(width: int, height: int, *, alert_rows: int = 0) -> Box:
    """Return the box of a STOP's banner, below state, control and alert.

    The keys stay free; in a terminal of a few lines the banner covers the alert, then the keys.
    """
    boxes = pane_boxes(width, height, alert_rows=alert_rows)
    wanted = BANNER_ROWS["wide" if width >= WIDE_BANNER_COLUMNS else "narrow"]
    y = _rows_above(boxes)
    if height - 1 - y < wanted:
        y = boxes["top"].height
    y = max(min(y, height - 1), 0)
    return Box(x=0, y=y, width=width, height=max(min(wanted, height - 1 - y), 1))


def timeline_rows(height: int) -> int:
    """Return the rows of the time line in a terminal of that height."""
    if height < LOW_LINES:
        return 1
    return 2 if height < LARGE[1] else 3


def tune_box(
    width: int, height: int, *, alert_rows: int = 0, timeline_rows: int = 0, aspect: float = 4 / 3
) -> Box:
    """Return the box of the opened tuning pane: left of the plots, over the pictures.

    In the widest layout the pane has a place of its own; in a small terminal it takes all rows
    between the first line and the keys. Arguments as in ``pane_boxes``.
    """
    boxes = pane_boxes(
        width, height, alert_rows=alert_rows, timeline_rows=timeline_rows, aspect=aspect
    )
    y0, y1 = _rows_above(boxes), height - 1 - timeline_rows
    room = max(y1 - y0, 1)
    if has_tuning_column(width, height):
        sky = boxes["sky"]
        y = sky.y + sky.height
        return Box(x=sky.x, y=y, width=sky.width, height=max(min(OWN_TUNE_ROWS, y1 - y), 1))
    plots = boxes.get("confidence")
    columns = width if plots is None or not plots.x else max(plots.x - 1, TUNE_COLUMNS)
    return Box(x=0, y=y0, width=min(columns, width), height=min(TUNE_ROWS, room))


def orbit_box(
    width: int, height: int, *, alert_rows: int = 0, timeline_rows: int = 0, aspect: float = 4 / 3
) -> Box:
    """Return the box of the opened orbit pane: over the plots; picture, figures and log stay.

    In a small terminal the pane takes all rows between the first line and the keys. Arguments as in
    ``pane_boxes``.
    """
    boxes = pane_boxes(
        width, height, alert_rows=alert_rows, timeline_rows=timeline_rows, aspect=aspect
    )
    first = boxes.get("confidence")
    last = boxes.get("nis")
    if first is None or last is None:
        y0 = _rows_above(boxes)
        return Box(x=0, y=y0, width=width, height=max(height - 1 - timeline_rows - y0, 1))
    # Whole panes are covered: no plot is left without its title.
    others: tuple[Name, ...] = ("east", "north", "axis", "nis", "orbit")
    below = [box for name in others if (box := boxes.get(name)) and box.x == first.x]
    rows = [box.y + box.height - first.y for box in below]
    most = max((n for n in rows if n <= MAX_ORBIT_ROWS), default=max(rows))
    return Box(x=first.x, y=first.y, width=first.width, height=most)


def has_tuning_column(width: int, height: int) -> bool:
    """Return True where the terminal is so large that the tuning pane is always open."""
    return width >= THREE_COLUMNS[0] and height >= THREE_COLUMNS[1]


def _rows_above(boxes: dict[Name, Box]) -> int:
    """Return the rows of the first lines and the alert."""
    return boxes["top"].height + (boxes["alert"].height if "alert" in boxes else 0)


def _put(boxes: dict[Name, Box], name: Name, box: Box) -> None:
    if box.height > 0 and box.width > 0:
        boxes[name] = box


def _full(boxes: dict[Name, Box], middle: Box, facts_rows: int, aspect: float) -> None:
    """Lay out the picture left, plots right, then figures, then the log."""
    panes_rows = min(middle.height - 4, max(14, round(middle.height * 0.76)))
    frame_columns = _frame_columns(panes_rows - 2, aspect, int(middle.width * 0.56))
    boxes["frame"] = Box(x=0, y=middle.y, width=frame_columns, height=panes_rows)
    x, columns = frame_columns + 1, middle.width - frame_columns - 1
    each = (panes_rows - 1) // 3
    first = panes_rows - 2 - 2 * each
    plots: dict[Name, int] = {"confidence": first, "east": each, "north": each, "axis": 1, "nis": 1}
    y = _stacked(boxes, Box(x=x, y=middle.y, width=columns, height=panes_rows), plots)
    bottom = middle.y + middle.height + facts_rows
    below = Box(x=0, y=y, width=middle.width, height=bottom - y)
    _stacked(boxes, below, {"facts": facts_rows, "log": below.height - facts_rows})


def _large(boxes: dict[Name, Box], all_: Box, aspect: float) -> None:
    """Lay out the plots in the right half; close-up, field with orbit, figures and log left."""
    columns = round(all_.width * PLOTS_SHARE)
    left, x = all_.width - columns - 1, all_.width - columns
    confidence, nis = round(all_.height * 0.2), round(all_.height * 0.19)
    each = (all_.height - confidence - nis - 1) // 2
    plots: dict[Name, int] = {"confidence": all_.height - nis - 1 - 2 * each}
    plots |= {"east": each, "north": each, "axis": 1, "nis": nis}
    _stacked(boxes, Box(x=x, y=all_.y, width=columns, height=all_.height), plots)
    facts_rows, log_rows = 6, max(round(all_.height * 0.1), MIN_LOG_ROWS)
    field_rows = max(round(all_.height * 0.31), ORBIT_ROWS)
    closeup_rows = all_.height - facts_rows - log_rows - field_rows
    y = _stacked(boxes, Box(x=0, y=all_.y, width=left, height=0), {"closeup": closeup_rows})
    field = _frame_columns(field_rows - 2, aspect, left - ORBIT_COLUMNS - 1)
    _put(boxes, "frame", Box(x=0, y=y, width=field, height=field_rows))
    _put(boxes, "orbit", Box(x=field + 1, y=y, width=left - field - 1, height=field_rows))
    below = Box(x=0, y=y + field_rows, width=left, height=0)
    _stacked(boxes, below, {"facts": facts_rows, "log": log_rows})


def _three_columns(boxes: dict[Name, Box], all_: Box) -> None:
    """Lay out close-up, field and log, plots with the orbit, and a column for figures and sky."""
    left = int(all_.width * 0.42)
    log_rows, chart_rows = round(all_.height * 0.14), round(all_.height * 0.35)
    pictures: dict[Name, int] = {"closeup": all_.height - chart_rows - log_rows}
    pictures |= {"frame": chart_rows, "log": log_rows}
    _stacked(boxes, Box(x=0, y=all_.y, width=left, height=all_.height), pictures)
    middle = int((all_.width - left - 2) * 0.5)
    each, orbit_rows = round(all_.height * 0.21), round(all_.height * 0.25)
    plots: dict[Name, int] = {"confidence": each, "east": each, "north": each}
    plots["nis"] = all_.height - sum(plots.values()) - orbit_rows - 1
    plots["axis"] = 1
    plots["orbit"] = orbit_rows
    _stacked(boxes, Box(x=left + 1, y=all_.y, width=middle, height=all_.height), plots)
    x = left + middle + 2
    third = Box(x=x, y=all_.y, width=all_.width - x, height=all_.height)
    _stacked(boxes, third, {"facts": 14, "sky": SKY_ROWS})


def _stacked(boxes: dict[Name, Box], where: Box, rows: dict[Name, int]) -> int:
    """Lay out panes one below the other, each with its rows; return the row below the last."""
    y = where.y
    for name, n in rows.items():
        _put(boxes, name, Box(x=where.x, y=y, width=where.width, height=n))
        y += n
    return y


def _strips(boxes: dict[Name, Box], middle: Box, aspect: float) -> None:
    """Lay out the picture left; one row for each plot and the log right of it."""
    frame_columns = _frame_columns(middle.height - 2, aspect, middle.width // 2)
    boxes["frame"] = Box(x=0, y=middle.y, width=frame_columns, height=middle.height)
    x, columns = frame_columns + 1, middle.width - frame_columns - 1
    rows = {**STRIPS, "log": middle.height - len(STRIPS)}
    _stacked(boxes, Box(x=x, y=middle.y, width=columns, height=middle.height), rows)


def _bare(boxes: dict[Name, Box], middle: Box, facts_rows: int) -> None:
    """Lay out one column: figures, a row for each plot, and the rest for the log."""
    left = middle.height - facts_rows
    strips = STRIPS if left >= len(STRIPS) else {}
    _stacked(boxes, middle, {"facts": facts_rows, **strips, "log": left - len(strips)})


def _frame_columns(picture_rows: int, aspect: float, at_most: int) -> int:
    """Return the columns of a picture of that many rows: a cell is about twice as high as wide."""
    return max(1, min(math.ceil(2 * picture_rows * aspect), at_most))


BESIDE_COLUMNS = 72
"""Columns of a terminal from which on a frame's panel stands beside its picture."""
PANEL_COLUMNS = (34, 46)
BELOW_ROWS = 24
"""Rows of a terminal from which on a panel below the picture has a third of them; else two rows."""
SUMMARY_ROWS = 2

SheetPart = Literal["status", "alert", "picture", "panel", "keys"]


def frame_screen_boxes(
    width: int,
    height: int,
    *,
    has_status: bool = False,
    alert_rows: int = 0,
    keys_rows: int = 1,
    is_list_open: bool = False,
) -> dict[SheetPart, Box]:
    """Return the box of each part of a frame's screen; parts without room are left out.

    ``has_status``: True where the first line shows the telescope's state.
    ``alert_rows``: rows of the alert.
    ``keys_rows``: rows of the keys with the notice above them.
    ``is_list_open``: True where the panel takes the picture's place too.
    """
    boxes: dict[SheetPart, Box] = {}
    top, bottom = 0, height - keys_rows
    if has_status:
        boxes["status"] = Box(x=0, y=0, width=width, height=1)
        top = 1
    if alert_rows and top + alert_rows < bottom:
        boxes["alert"] = Box(x=0, y=top, width=width, height=alert_rows)
        top += alert_rows
    if bottom >= 0:
        boxes["keys"] = Box(x=0, y=bottom, width=width, height=keys_rows)
    rows = bottom - top
    if rows <= 0:
        return boxes
    if is_list_open:
        boxes["panel"] = Box(x=0, y=top, width=width, height=rows)
    elif width >= BESIDE_COLUMNS:
        low, high = PANEL_COLUMNS
        panel = min(max(width // 3, low), high)
        boxes["picture"] = Box(x=0, y=top, width=width - panel, height=rows)
        boxes["panel"] = Box(x=width - panel, y=top, width=panel, height=rows)
    else:
        panel = height // 3 if height >= BELOW_ROWS else min(SUMMARY_ROWS, rows // 4)
        boxes["picture"] = Box(x=0, y=top, width=width, height=rows - panel)
        if panel:
            boxes["panel"] = Box(x=0, y=bottom - panel, width=width, height=panel)
    return boxes
