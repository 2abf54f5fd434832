"""The settings that may change while the loop runs, and the record of a change."""

from typing import Any

from rsoconsole.config import Config, unknown_setting, walk, with_setting
from rsoconsole.errors import ConfigError
from rsoconsole.records import ParameterChange

TUNABLE = {
    "detector.tau",
    "detector.centroid",
    "detector.map_mode",
    "filter.preset",
    "filter.sigma_arcsec",
    "filter.q_arcsec2_s3",
    "filter.q_multiplier",
    "filter.q_ra_multiplier",
    "filter.q_ra_rate_multiplier",
    "filter.q_dec_multiplier",
    "filter.q_dec_rate_multiplier",
    "filter.r_multiplier",
    "filter.r_ra_multiplier",
    "filter.r_dec_multiplier",
    "filter.max_3sigma_arcmin",
    "filter.gate_nis",
    "filter.max_coast_s",
    "search.follow",
    "search.recentre",
    "search.pattern",
    "orbit.guide",
    "orbit.prior",
    "orbit.wait_min",
    "mount.meridian",
    "mount.after_stop",
    "aim.policy",
    "aim.lead_s",
    "aim.along_arcmin",
    "aim.across_arcmin",
    "exposure.exposure_s",
    "exposure.cadence_s",
    "leap.enabled",
    "leap.stare_exposure_s",
    "leap.least_rate_arcsec_s",
    "leap.most_misses",
    "leap.at_close",
    "leap.learns_settle",
    "leap.binning",
    "leap.subframe",
    "leap.pass_norad",
    "leap.late_sigma_s",
    "leap.waits",
}
"""What may change while the loop runs."""


def changed(config: Config, name: str, value: float | str) -> Config:
    """The configuration with one tunable set. Raises ValueError naming what is allowed."""
    check_tunable(name)
    try:
        return with_setting(config, name, value)
    except ConfigError as error:
        raise ValueError(str(error)) from error


def check_tunable(name: str) -> None:
    """Raises ValueError, with the remedy, for what cannot be changed while the loop runs."""
    if name in TUNABLE:
        return
    if name in {each for each, _, _ in walk(Config())}:
        raise ValueError(
            f"{name} does not change while the engine runs: write it into the configuration file"
            " and start the engine again"
        )
    raise ValueError(unknown_setting(name, sorted(TUNABLE)))


def change_record(before: Config, after: Config, name: str, by: str) -> ParameterChange:
    """The change for the record."""
    return ParameterChange(
        name=name, before=value_of(before, name), after=value_of(after, name), by=by
    )


def value_of(config: Config, name: str) -> Any:
    """What a setting is there."""
    section, _, key = name.partition(".")
    return getattr(getattr(config, section), key)
