"""A night of chosen satellites: time, site and exposures in one JSON-compatible record.

For satellites that no named scenario has. The simulated observatory, a separate process, makes a
``Scenario`` from the plan and the same element files; every object in the files is in the simulated
sky.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, read_named_bytes
from rsoconsole.orbits import CatalogueEntry, Satellite, nearest_epoch_entries, parse_element_sets
from rsoconsole.records import Site
from rsoconsole.simulator.nights.scenarios import Scenario, ScenarioSatellite
from rsoconsole.sky import StarCatalogue
from rsoconsole.words import NAME_ELEMENTS

STANDARD_MAGNITUDE = {"GEO": 12.0, "MEO": 13.3, "HEO": 12.5, "LEO": 13.3}
"""Magnitude fully lit at 36,000 km, by orbit: common values, chosen, not measured."""


def satellite_from_entry(entry: CatalogueEntry) -> Satellite:
    """The satellite of a catalogue entry, with the typical brightness of its regime."""
    return Satellite(entry, STANDARD_MAGNITUDE[regime(entry)])


@dataclass(frozen=True, slots=True, kw_only=True)
class NightPlan:
    """All settings of a night of chosen satellites."""

    title: str
    t_start_utc_ns: int
    site: Site
    targets: tuple[int, ...]
    """Catalogue numbers of the targets; the telescope is pointed at the first."""
    names: tuple[str, ...]
    start_hour_angle_deg: float
    """Hour angle of date that the mount reports at the night's start."""
    start_declination_deg: float
    exposure_s: float
    cadence_s: float
    frames: int
    element_files: tuple[str, ...]
    star_file: str | None
    """Whole-sky index file whose stars are drawn; None: the shipped stars near the equator."""
    visible_s: float
    """Seconds from the start during which all targets can be seen, as far as it was searched."""
    leaps: bool = False
    """True where the first target is in a low orbit: the telescope follows it by leaps."""

    def to_table(self) -> dict[str, Any]:
        """The plan as a JSON table for another process; ``plan_of_table`` reads it back."""
        return asdict(self)


def plan_of_table(table: dict[str, Any]) -> NightPlan:
    """The plan of a table made by ``NightPlan.to_table``."""
    lists = {name: tuple(table[name]) for name in ("targets", "names", "element_files")}
    return NightPlan(**{**table, **lists, "site": Site(**table["site"])})


def regime(entry: CatalogueEntry) -> str:
    """Orbit regime of an entry: GEO (inclined too), MEO, HEO (Molniya, transfer) or LEO."""
    if entry.eccentricity > 0.2:
        return "HEO"
    if entry.revolutions_a_day > 6.4:
        return "LEO"
    return "GEO" if 0.9 <= entry.revolutions_a_day <= 1.1 else "MEO"


def scenario_from_plan(plan: NightPlan) -> Scenario:
    """Return the scenario of a plan; every object of its element files is in the sky.

    Of several element sets of one object, the nearest in epoch is used. Raises ConfigError for an
    unreadable file or one that lacks a target, OrbitError for invalid elements.
    """
    entries: list[CatalogueEntry] = []
    for name in plan.element_files:
        content = read_named_bytes(Path(name), ConfigError, NAME_ELEMENTS)
        entries.extend(parse_element_sets(content, name).entries)
    nearest = nearest_epoch_entries(entries, plan.t_start_utc_ns)
    if not set(plan.targets) <= {each.norad_id for each in nearest}:
        raise ConfigError("the element files have changed since the night was chosen: start again")
    return Scenario(
        name=plan.title,
        title=plan.title,
        description="satellites chosen by name",
        t_start_utc_ns=plan.t_start_utc_ns,
        satellites=tuple(
            ScenarioSatellite(element_set=each, standard_magnitude=STANDARD_MAGNITUDE[regime(each)])
            for each in nearest
        ),
        target_norad_id=plan.targets[0],
        target_hour_angle_deg=None,
        start_hour_angle_deg=plan.start_hour_angle_deg,
        start_declination_deg=plan.start_declination_deg,
        frames=plan.frames,
        site=plan.site,
    )


def load_stars_for_plan(plan: NightPlan) -> StarCatalogue:
    """Catalogue of the stars that are drawn in the plan's night."""
    if plan.star_file is None:
        return StarCatalogue.load()
    return StarCatalogue.load_whole_sky()


STREAK_PX, SHORT_STREAK_PX = 300.0, 60.0
"""Longest and shortest streak that the detector finds with certainty (measured)."""
USUAL_EXPOSURE_S, LONGEST_EXPOSURE_S, SHORTEST_EXPOSURE_S = 10.0, 30.0, 0.02
LONGEST_CADENCE_S, SHORTEST_CADENCE_S = 30.0, 6.0
PAUSE_S = 5.0
"""Least time from the end of an exposure to the start of the next."""
MOVES_FIELDS = 0.25
"""Largest motion of a target over the ground between exposures, in short sides of the field."""


def exposure_for_rate_s(rate_arcsec_s: float, scale_arcsec_px: float) -> float:
    """Exposure in seconds for a target of this rate, rounded down to two digits.

    10 s, but shorter where the streak would exceed ``STREAK_PX``, and up to 30 s where it would not
    reach ``SHORT_STREAK_PX``.
    """
    px_s = max(rate_arcsec_s / scale_arcsec_px, 1e-6)
    wanted_s = min(max(USUAL_EXPOSURE_S, SHORT_STREAK_PX / px_s), LONGEST_EXPOSURE_S)
    wanted_s = max(SHORTEST_EXPOSURE_S, min(wanted_s, STREAK_PX / px_s))
    step = 10.0 ** (math.floor(math.log10(wanted_s)) - 1)
    return round(math.floor(wanted_s / step + 1e-9) * step, 6)


def ground_rate_cadence_s(
    ground_rate_arcsec_s: float, short_side_deg: float, exposure_s: float = USUAL_EXPOSURE_S
) -> float:
    """Return the time between starts of exposures, s, for a target of this rate over ground.

    In that time the target moves by ``MOVES_FIELDS`` of the field's short side. The cadence is 6 to
    30 s, longer only for long exposures.
    """
    moves_s = MOVES_FIELDS * short_side_deg * 3600.0 / max(ground_rate_arcsec_s, 1e-6)
    wanted_s = min(LONGEST_CADENCE_S, max(SHORTEST_CADENCE_S, moves_s))
    if exposure_s > USUAL_EXPOSURE_S:
        wanted_s = max(wanted_s, exposure_s + PAUSE_S)
    return float(math.floor(wanted_s))
