"""The plan of a demo night of chosen satellites, made from their names as typed."""

from collections.abc import Sequence
from pathlib import Path

from rsoconsole.base import ConfigError, value_errors_as
from rsoconsole.cli.words.options import read_element_sets
from rsoconsole.config import Config
from rsoconsole.simulator import NightPlan
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import time_left_words, utc_text


def plan_targets(
    wanted: Sequence[str], config: Config, *, at: str | None, seed: int, frames: int
) -> NightPlan:
    """Plan of a night in which the named satellites of the configured element files are seen.

    ``wanted``: catalogue numbers or names. ``at``: UTC of the start as text; None: the first
    suitable time. Raises OrbitError for unknown or ambiguous names, ConfigError where the
    satellites cannot be seen or ``at`` is no time, SolverError where their sky has no stars.
    """
    from rsoconsole.orbits import find_object, nearest_epoch_entries
    from rsoconsole.simulator import choose_night, satellite_from_entry

    files = config.catalogue.tle_files
    at_utc_ns = None if at is None else _instant(at)
    entries = read_element_sets(files).entries
    sets = [find_object(entries, each) for each in wanted]
    numbers = [found[0].norad_id for found in sets]
    if len(set(numbers)) < len(numbers):
        raise ConfigError("one satellite is named twice: name each --target once")
    # Without a time the newest elements are used, around whose epoch a night is looked for.
    newest_ns = max(each.epoch_utc_ns for found in sets for each in found)
    near_ns = newest_ns if at_utc_ns is None else at_utc_ns
    chosen = [nearest_epoch_entries(found, near_ns)[0] for found in sets]
    return choose_night(
        [satellite_from_entry(each) for each in chosen],
        config,
        seed=seed,
        frames=frames,
        at_utc_ns=at_utc_ns,
        element_files=files,
        star_file=whole_sky_index_file(config),
    )


def whole_sky_index_file(config: Config) -> Path | None:
    """The installed whole-sky index file with the most stars; None where there is none."""
    from rsoconsole.instruments import folders_to_search, list_index_files
    from rsoconsole.sky import has_tycho2_stars

    files = list_index_files(folders_to_search(config.solver.index_dirs))
    whole = [each for each in files if each.is_healthy and each.is_whole_sky]
    # The smaller its quads, the more stars a file has.
    for each in sorted(whole, key=lambda file: file.quad_deg):
        if has_tycho2_stars(each.path):
            return each.path
    return None


def config_for_plan(config: Config, plan: NightPlan) -> Config:
    """Return the configuration with the plan's exposures and a search that stays in one place.

    Leaps are enabled where the plan asks for them (low satellites).
    """
    exposure = config.exposure.model_copy(
        update={"exposure_s": plan.exposure_s, "cadence_s": plan.cadence_s}
    )
    search = config.search.model_copy(update={"pattern": "stay"})
    leap = config.leap.model_copy(update={"enabled": plan.leaps})
    return config.model_copy(update={"exposure": exposure, "search": search, "leap": leap})


def plan_words(plan: NightPlan) -> str:
    """The plan in a sentence for people: objects, site, start, length, exposures."""
    return (
        f"{plan.title} from {plan.site.latitude_deg:+.2f} {plan.site.longitude_deg:+.2f},"
        f" {utc_text(plan.t_start_utc_ns, 'dated')},"
        f" to be seen for {time_left_words(plan.visible_s)};"
        f" {plan.exposure_s:g} s every {plan.cadence_s:g} s"
    )


def _instant(text: str) -> int:
    with value_errors_as(ConfigError, "--at: "):
        return iso_to_utc_ns(text)
