"""A night of chosen satellites: when, where from, how exposed; as one table that can be written.

What is chosen by hand or by ``_visibility`` for satellites that no scenario names. The simulated
observatory, a process of its own, makes its scenario of it again: from the same files of element
sets, and every object in them is really there.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError
from rsoconsole.orbits import CatalogueEntry, Satellite, nearest_in_epoch_of_each, parse_catalogue
from rsoconsole.records import Site
from rsoconsole.simulator.nights.scenarios import Scenario, ScenarioSatellite
from rsoconsole.sky import StarCatalogue

STANDARD_MAGNITUDE = {"GEO": 12.0, "MEO": 13.3, "HEO": 12.5, "LEO": 13.3}
"""Magnitude fully lit at 36,000 km: common values, chosen, not measured. A navigation satellite of
12.0 at 20,200 km (12.7 half turned away), a rocket body of 4.7 and a low payload of 5.5 at
1,000 km."""


def satellite_of(entry: CatalogueEntry) -> Satellite:
    """A satellite as bright as those of its kind commonly are."""
    return Satellite(entry, STANDARD_MAGNITUDE[regime(entry)])


@dataclass(frozen=True, slots=True, kw_only=True)
class NightPlan:
    """Everything that a night of chosen satellites is made of."""

    title: str
    t_start_utc_ns: int
    site: Site
    targets: tuple[int, ...]
    """Catalogue numbers, the first one is pointed at."""
    names: tuple[str, ...]
    """Names of the targets."""
    start_hour_angle_deg: float
    """Hour angle of date that the mount reports when the night begins."""
    start_declination_deg: float
    exposure_s: float
    cadence_s: float
    frames: int
    """Number of exposures for which it was chosen."""
    element_files: tuple[str, ...]
    star_file: str | None
    """A whole-sky index file whose stars are drawn; None: the shipped belt's."""
    visible_s: float
    """Time for which the targets stay up, lit and in darkness, as far as was searched."""
    leaps: bool = False
    """True where the first target is a low satellite, which the telescope follows by leaps."""

    def to_table(self) -> dict[str, Any]:
        """The plan as a JSON table for another process; ``plan_of_table`` reads it back."""
        return asdict(self)


def plan_of_table(table: dict[str, Any]) -> NightPlan:
    """The plan that ``to_table`` wrote."""
    lists = {name: tuple(table[name]) for name in ("targets", "names", "element_files")}
    return NightPlan(**{**table, **lists, "site": Site(**table["site"])})


def regime(entry: CatalogueEntry) -> str:
    """GEO (inclined too), MEO, HEO (Molniya, transfer orbits) or LEO."""
    if entry.eccentricity > 0.2:
        return "HEO"
    if entry.revolutions_a_day > 6.4:
        return "LEO"
    return "GEO" if 0.9 <= entry.revolutions_a_day <= 1.1 else "MEO"


def scenario_of(plan: NightPlan) -> Scenario:
    """The scenario of a plan: every object of its files, each by the set nearest in epoch.

    Raises ConfigError for a file that has changed since, OrbitError for one that cannot be read.
    """
    entries: list[CatalogueEntry] = []
    for name in plan.element_files:
        try:
            entries.extend(parse_catalogue(Path(name).read_text(encoding="utf-8"), name))
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{name} cannot be read: {error}") from error
    nearest = nearest_in_epoch_of_each(entries, plan.t_start_utc_ns)
    usable = [each for each in nearest if not each.record.error]
    if not set(plan.targets) <= {each.norad_id for each in usable}:
        raise ConfigError("the element files have changed since the night was chosen: start again")
    return Scenario(
        name=plan.title,
        title=plan.title,
        description="satellites chosen by name",
        t_start_utc_ns=plan.t_start_utc_ns,
        satellites=tuple(
            ScenarioSatellite(element_set=each, standard_magnitude=STANDARD_MAGNITUDE[regime(each)])
            for each in usable
        ),
        target_norad_id=plan.targets[0],
        target_hour_angle_deg=None,
        start_hour_angle_deg=plan.start_hour_angle_deg,
        start_declination_deg=plan.start_declination_deg,
        frames=plan.frames,
        site=plan.site,
    )


def stars_of(plan: NightPlan) -> StarCatalogue:
    """The stars that the plan's sky is drawn of."""
    if plan.star_file is None:
        return StarCatalogue.load()
    return StarCatalogue.load_whole_sky()


STREAK_PX, SHORT_STREAK_PX = 300.0, 60.0
"""Lengths between which the detector is sure of a streak (measured)."""
USUAL_EXPOSURE_S, LONGEST_EXPOSURE_S, SHORTEST_EXPOSURE_S = 10.0, 30.0, 0.02
LONGEST_CADENCE_S, SHORTEST_CADENCE_S = 30.0, 6.0
PAUSE_S = 5.0
"""Least time from the end of an exposure to the next."""
MOVES_FIELDS = 0.25
"""Share of the field's short side that a target may move, over the ground, between exposures."""


def exposure_for(rate_arcsec_s: float, scale_arcsec_px: float) -> float:
    """Exposure, s: 10; shorter for a streak up to ``STREAK_PX``, longer for one that is not short.

    Two digits, so that it reads well.
    """
    px_s = max(rate_arcsec_s / scale_arcsec_px, 1e-6)
    wanted_s = min(max(USUAL_EXPOSURE_S, SHORT_STREAK_PX / px_s), LONGEST_EXPOSURE_S)
    wanted_s = max(SHORTEST_EXPOSURE_S, min(wanted_s, STREAK_PX / px_s))
    step = 10.0 ** (math.floor(math.log10(wanted_s)) - 1)
    return round(math.floor(wanted_s / step + 1e-9) * step, 6)


def cadence_for(
    ground_rate_arcsec_s: float, short_side_deg: float, exposure_s: float = USUAL_EXPOSURE_S
) -> float:
    """Cadence, start to start: the slowest for a target that leaves the field over the ground."""
    moves_s = MOVES_FIELDS * short_side_deg * 3600.0 / max(ground_rate_arcsec_s, 1e-6)
    wanted_s = min(LONGEST_CADENCE_S, max(SHORTEST_CADENCE_S, moves_s))
    if exposure_s > USUAL_EXPOSURE_S:
        wanted_s = max(wanted_s, exposure_s + PAUSE_S)
    return float(math.floor(wanted_s))
