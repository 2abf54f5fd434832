"""The sky over the site as a disc of cells: zenith in the middle, north up, east left."""

import math
from typing import TYPE_CHECKING

from rsoconsole.console.drawing.plot import Ink, Line, join_cells_by_key
from rsoconsole.console.words.words import draw_rule
from rsoconsole.sky import horizon_altitude_deg

if TYPE_CHECKING:
    from rsoconsole.config import Config
    from rsoconsole.pipeline import SkyOutlook

RIM_STEPS = 240
MOON, SUN, TARGET, MOUNT = "☾", "☼", "◆", "+"


def sky_lines(
    config: "Config | None", outlook: "SkyOutlook | None", width: int, rows: int
) -> list[Line]:
    """Draw limits, geostationary belt, Moon, Sun, the mount, the target and its path."""
    title = draw_rule("sky", "", width)
    if config is None or outlook is None or rows < 4 or width < 8:
        return [title]
    disc_rows = rows - 2
    cells: dict[tuple[int, int], tuple[str, Ink]] = {}

    def put(altaz_deg: tuple[float, float], sign: str, ink: Ink) -> None:
        at = sky_cell(altaz_deg, width, disc_rows)
        if at is not None:
            cells[at] = sign, ink

    azimuths_deg = [step * 360.0 / RIM_STEPS for step in range(RIM_STEPS)]
    for az in azimuths_deg:
        put((0.0, az), "·", "dim")
    for az in azimuths_deg:
        put((_lowest_deg(config, az), az), "·", "")
    for altaz_deg in outlook.belt_altaz_deg:
        put(altaz_deg, "∙", "dim")
    for altaz_deg in outlook.way_altaz_deg:
        put(altaz_deg, "•", "good")
    put((outlook.moon_altitude_deg, outlook.moon_azimuth_deg), MOON, "warn")
    put((outlook.sun_altitude_deg, outlook.sun_azimuth_deg), SUN, "alarm")
    if outlook.here_altaz_deg is not None:
        put(outlook.here_altaz_deg, MOUNT, "title")
    if outlook.way_altaz_deg:
        put(outlook.way_altaz_deg[0], TARGET, "good")
    for letter, az in (("N", 0.0), ("E", 90.0), ("S", 180.0), ("W", 270.0)):
        put((0.0, az), letter, "title")
    lines = [
        join_cells_by_key(cells.get((column, row), (" ", "")) for column in range(width))
        for row in range(disc_rows)
    ]
    legend = f" {TARGET} target • its way {MOUNT} mount ∙ belt {MOON} Moon · limits"
    return [title, *lines, [(legend[:width], "dim")]]


def sky_cell(altaz_deg: tuple[float, float], width: int, rows: int) -> tuple[int, int] | None:
    """Return the cell (column, row) of a direction (altitude, azimuth), degrees.

    None: below the horizon. ``width``, ``rows``: the disc in cells, each twice as high as wide.
    """
    alt, az = altaz_deg
    if alt < 0.0:
        return None
    radius = min((rows - 1) / 2.0, (width - 1) / 4.0) * (90.0 - alt) / 90.0
    x = -math.sin(math.radians(az)) * radius * 2.0
    y = -math.cos(math.radians(az)) * radius
    return round((width - 1) / 2.0 + x), round((rows - 1) / 2.0 + y)


def _lowest_deg(config: "Config", az_deg: float) -> float:
    """Return the lowest altitude allowed at an azimuth, degrees: the limit, or walls above it."""
    limits = config.limits
    if not limits.horizon:
        return limits.min_altitude_deg
    horizon_deg = horizon_altitude_deg(limits.horizon, az_deg)  # type: ignore[arg-type]
    return max(limits.min_altitude_deg, float(horizon_deg))
