"""Where picture and panel of a frame's screen lie, for a terminal of any size."""

from typing import Literal

from rsoconsole.console.drawing.pane_layout import Box

BESIDE_COLUMNS = 72
"""Columns from which on the panel stands beside the picture."""
PANEL_COLUMNS = (34, 46)
BELOW_ROWS = 24
"""Rows from which on it has a third of the screen below it; in fewer it is a summary."""
SUMMARY_ROWS = 2

Name = Literal["status", "alert", "picture", "panel", "keys"]


def sheet_boxes(
    width: int,
    height: int,
    *,
    has_status: bool = False,
    alert_rows: int = 0,
    keys_rows: int = 1,
    is_list_open: bool = False,
) -> dict[Name, Box]:
    """The box of each part that has room. ``is_list_open`` gives the panel the picture's too.

    ``keys_rows``: of the last line and what is said over it.
    """
    boxes: dict[Name, Box] = {}
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
