"""The sky over the site as a disc of cells: zenith in the middle, north up, east left."""

import math
from typing import TYPE_CHECKING

from rsoconsole.console.drawing.plot import Ink, Line, joined
from rsoconsole.console.words.words import rule
from rsoconsole.sky import horizon_altitude_deg

if TYPE_CHECKING:
    from rsoconsole.config import Config
    from rsoconsole.pipeline import Outlook

Cells = dict[tuple[int, int], tuple[str, Ink]]
RIM_STEPS = 240
MOON, SUN, TARGET, MOUNT = "☾", "☼", "◆", "+"


def sky_lines(
    config: "Config | None", outlook: "Outlook | None", width: int, rows: int
) -> list[Line]:
    """Limits as a line, the geostationary belt, Moon, Sun, the mount, the target and its way."""
    title = rule("sky", "", width)
    if config is None or outlook is None or rows < 4 or width < 8:
        return [title]
    disc_rows = rows - 2
    cells: Cells = {}
    _draw_rim(cells, width, disc_rows)
    _draw_limits(cells, config, width, disc_rows)
    for alt, az in outlook.belt_altaz_deg:
        _put(cells, (alt, az), "∙", "dim", width, disc_rows)
    for alt, az in outlook.way_altaz_deg:
        _put(cells, (alt, az), "•", "good", width, disc_rows)
    moon = (outlook.moon_altitude_deg, outlook.moon_azimuth_deg)
    _put(cells, moon, MOON, "warn", width, disc_rows)
    _put(cells, (outlook.sun_altitude_deg, outlook.sun_azimuth_deg), SUN, "alarm", width, disc_rows)
    if outlook.here_altaz_deg is not None:
        _put(cells, outlook.here_altaz_deg, MOUNT, "title", width, disc_rows)
    if outlook.way_altaz_deg:
        _put(cells, outlook.way_altaz_deg[0], TARGET, "good", width, disc_rows)
    _draw_letters(cells, width, disc_rows)
    lines = [_row(cells, row, width) for row in range(disc_rows)]
    legend = f" {TARGET} target • its way {MOUNT} mount ∙ belt {MOON} Moon · limits"
    return [title, *lines, [(legend[:width], "dim")]]


def place(altaz_deg: tuple[float, float], width: int, rows: int) -> tuple[int, int] | None:
    """Column and row of a direction; None below the horizon. A cell is twice as high as wide."""
    alt, az = altaz_deg
    if alt < 0.0:
        return None
    radius = _radius_rows(width, rows) * (90.0 - alt) / 90.0
    x = -math.sin(math.radians(az)) * radius * 2.0
    y = -math.cos(math.radians(az)) * radius
    return round((width - 1) / 2.0 + x), round((rows - 1) / 2.0 + y)


def _radius_rows(width: int, rows: int) -> float:
    return min((rows - 1) / 2.0, (width - 1) / 4.0)


def _put(  # noqa: PLR0917 -- one call, each argument a different thing
    cells: Cells, altaz_deg: tuple[float, float], sign: str, ink: Ink, width: int, rows: int
) -> None:
    at = place(altaz_deg, width, rows)
    if at is not None:
        cells[at] = sign, ink


def _draw_rim(cells: Cells, width: int, rows: int) -> None:
    for step in range(RIM_STEPS):
        _put(cells, (0.0, step * 360.0 / RIM_STEPS), "·", "dim", width, rows)


def _draw_limits(cells: Cells, config: "Config", width: int, rows: int) -> None:
    """The lowest altitude that is allowed, all round: the limit, or walls above it."""
    limits = config.limits
    for step in range(RIM_STEPS):
        az = step * 360.0 / RIM_STEPS
        alt = limits.min_altitude_deg
        if limits.horizon:
            alt = max(alt, float(horizon_altitude_deg(limits.horizon, az)))  # type: ignore[arg-type]
        _put(cells, (alt, az), "·", "", width, rows)


def _draw_letters(cells: Cells, width: int, rows: int) -> None:
    for letter, az in (("N", 0.0), ("E", 90.0), ("S", 180.0), ("W", 270.0)):
        _put(cells, (0.0, az), letter, "title", width, rows)


def _row(cells: Cells, row: int, width: int) -> Line:
    return joined(cells.get((column, row), (" ", "")) for column in range(width))
