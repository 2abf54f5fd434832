"""Exposure and cadence for a track's rate, within configured bounds.

A streak of a few pixels has no direction, and a streak as long as the frame is often cut; an object
that crosses half the field between two exposures is lost where one prediction fails. Where the
night's settings would lead to that, others are used until the track ends, on record. A setting that
the operator changes in the meantime stays.
"""

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from rsoconsole.base import ConfigError
from rsoconsole.config import Config, every_setting, unknown_setting_words, with_setting
from rsoconsole.records import ParameterChange, TrackState
from rsoconsole.tracking import sky_rate_arcsec_s

_BY_SECTION = {
    "detector": ("tau", "centroid", "map_mode"),
    "filter": (
        *("preset", "sigma_arcsec", "q_arcsec2_s3", "q_multiplier", "q_ra_multiplier"),
        *("q_ra_rate_multiplier", "q_dec_multiplier", "q_dec_rate_multiplier", "r_multiplier"),
        *("r_ra_multiplier", "r_dec_multiplier", "max_3sigma_arcmin", "gate_nis", "max_coast_s"),
        "learning",
    ),
    "search": ("follow", "recentre", "pattern"),
    "orbit": ("guide", "prior", "wait_min"),
    "mount": ("meridian", "after_stop"),
    "aim": ("policy", "lead_s", "along_arcmin", "across_arcmin"),
    "exposure": ("exposure_s", "cadence_s"),
    "leap": (
        *("enabled", "stare_exposure_s", "least_rate_arcsec_s", "most_misses", "at_close"),
        *("learns_settle", "binning", "subframe", "pass_norad", "late_sigma_s", "waits"),
    ),
}
TUNABLE = {f"{section}.{key}" for section, keys in _BY_SECTION.items() for key in keys}


def config_with_setting(config: Config, name: str, value: float | str) -> Config:
    """Return the configuration with one setting changed.

    Raises ValueError, with the allowed values, where the value or the setting is not allowed.
    """
    check_tunable(name)
    try:
        return with_setting(config, name, value)
    except ConfigError as error:
        raise ValueError(str(error)) from error


def check_tunable(name: str) -> None:
    """Raise ValueError, with the remedy, for a setting that cannot change while the loop runs."""
    if name in TUNABLE:
        return
    if name in {each for each, _, _ in every_setting(Config())}:
        raise ValueError(
            f"{name} does not change while the engine runs: write it into the configuration file"
            " and start the engine again"
        )
    raise ValueError(unknown_setting_words(name, sorted(TUNABLE)))


def change_record(before: Config, after: Config, name: str, by: str) -> ParameterChange:
    """Return the record of a changed setting; ``by``: who or what changed it."""
    return ParameterChange(
        name=name, before=value_of(before, name), after=value_of(after, name), by=by
    )


def value_of(config: Config, name: str) -> Any:
    """Return a setting's value; ``name``: its section and key, with a dot."""
    return attrgetter(name)(config)


SHORTEST_PX = 40.0
"""Least length of a streak, px, whose direction is good to a degree or two."""
LONGEST_SHARE = 1.0 / 3.0
"""Greatest length of a streak, in units of the frame's shorter side."""
_INSIDE = 1.25
"""Factor by which a new exposure keeps inside these lengths, because the next rate differs."""
_WORTH_CHANGING = 0.2
FARTHEST_FIELDS = 0.5
"""Greatest path of a track between two exposures, in units of the field's shorter side."""
EXPOSURE, CADENCE = "exposure.exposure_s", "exposure.cadence_s"


def exposure_and_cadence_for(rate_arcsec_s: float, config: Config) -> tuple[float, float]:
    """Return exposure and cadence, s, for a rate on the sky.

    They are the configured ones where the streak's length and its path between exposures allow it.
    """
    exposure, optics = config.exposure, config.optics
    pixels_s = max(rate_arcsec_s / optics.scale_arcsec_px, 1e-6)
    longest_px = LONGEST_SHARE * min(optics.width_px, optics.height_px)
    exposure_s = exposure.exposure_s
    if pixels_s * exposure_s > longest_px:
        exposure_s = longest_px / _INSIDE / pixels_s
    elif pixels_s * exposure_s < SHORTEST_PX <= pixels_s * exposure.longest_s:
        # Where no exposure makes a streak of it a longer one would only collect more sky.
        exposure_s = _INSIDE * SHORTEST_PX / pixels_s
    if exposure_s != exposure.exposure_s:
        shortest_s = min(exposure.shortest_s, exposure.exposure_s)
        longest_s = max(exposure.longest_s, exposure.exposure_s)
        exposure_s = min(max(round_to_two_digits(exposure_s), shortest_s), longest_s)
    return exposure_s, _cadence_s(rate_arcsec_s, exposure_s, config)


def _cadence_s(rate_arcsec_s: float, exposure_s: float, config: Config) -> float:
    exposure, mount = config.exposure, config.mount
    # What an exposure of this length needs beside itself, at the least.
    beside_s = exposure.start_latency_s + exposure.readout_s + mount.settle_s + 1.0
    cadence_s = exposure.cadence_s
    if exposure_s > exposure.exposure_s:
        cadence_s += exposure_s - exposure.exposure_s
    crossed_s = FARTHEST_FIELDS * 3600.0 * min(config.optics.field_deg) / max(rate_arcsec_s, 1e-6)
    if crossed_s < cadence_s:
        cadence_s = min(cadence_s, max(crossed_s, exposure_s + beside_s))
    return cadence_s if cadence_s == exposure.cadence_s else round(cadence_s, 1)


def round_to_two_digits(value_s: float) -> float:
    """Return a value rounded to two significant digits."""
    return float(np.format_float_positional(value_s, precision=2, fractional=False))


class Pace:
    """Sets exposure and cadence for a track's rate, and sets them back when the track ends."""

    def __init__(self) -> None:
        self._before: dict[str, float] = {}
        self._own: dict[str, float] = {}
        self._is_left_alone = False
        """True where the operator has set one of them since the track began."""

    def after(
        self, config: Config, track: TrackState | None
    ) -> tuple[Config, tuple[ParameterChange, ...]]:
        """Return the configuration for the next exposure, and the records of what has changed.

        ``track``: the lead track after the last frame; None without one.
        """
        for name, value in list(self._own.items()):
            if value_of(config, name) != value:
                self._is_left_alone = True
                self._before.pop(name)
                self._own.pop(name)
        if track is None or not _may_change(config):
            self._is_left_alone = False
            return self._changed_to(config, dict(self._before), "the end of the track")
        if self._is_left_alone or track.innovations < 1:
            return config, ()
        base = self.config_before_track(config)
        east, north = sky_rate_arcsec_s(track)
        rate = float(np.hypot(east, north))
        values = dict(zip((EXPOSURE, CADENCE), exposure_and_cadence_for(rate, base), strict=True))
        apart = {
            name: value
            for name, value in values.items()
            if value == value_of(base, name)
            or abs(value / value_of(config, name) - 1.0) > _WORTH_CHANGING
        }
        return self._changed_to(config, apart, f"the track's {rate:.0f} arcsec/s")

    def config_before_track(self, config: Config) -> Config:
        """Return the configuration with exposure and cadence as before the track."""
        for name, value in self._before.items():
            if value_of(config, name) == self._own.get(name):
                config = config_with_setting(config, name, value)
        return config

    def _changed_to(
        self, config: Config, values: dict[str, float], by: str
    ) -> tuple[Config, tuple[ParameterChange, ...]]:
        changes = []
        for name, value in values.items():
            if value == value_of(config, name):
                continue
            after = config_with_setting(config, name, value)
            changes.append(change_record(config, after, name, by))
            if self._before.setdefault(name, value_of(config, name)) == value:
                self._before.pop(name)
                self._own.pop(name, None)
            else:
                self._own[name] = value
            config = after
        return config, tuple(changes)


def _may_change(config: Config) -> bool:
    """True where exposures may vary from frame to frame.

    The paper's night has one exposure, and a dark frame without a bias fits one exposure only.
    """
    is_dark_fixed = bool(config.calibration.darks) and config.calibration.bias is None
    return config.exposure.automatic and config.filter.preset != "paper" and not is_dark_fixed


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loan:
    before: float | int | str
    frames: int


class TemporarySettings:
    """The settings that were changed for a number of frames only, with their former values."""

    def __init__(self, of_night: Callable[[Config], Config] = lambda config: config) -> None:
        """``of_night``: returns a configuration without the changes made for a track."""
        self._of_night = of_night
        self._loans: dict[str, _Loan] = {}

    def remember_setting(self, config: Config, name: str, frames: int) -> None:
        """Remember a setting's value before it is changed for ``frames`` frames.

        If the setting is changed again meanwhile, the value before the first change comes back at
        the end.
        """
        known = self._loans.get(name)
        before = value_of(self._of_night(config), name) if known is None else known.before
        self._loans[name] = _Loan(before=before, frames=frames)

    def keep(self, name: str) -> None:
        """Make a temporary setting permanent, so that it is not restored."""
        self._loans.pop(name, None)

    def frames_left(self) -> dict[str, int]:
        """Return the number of frames left for each temporary setting, by name."""
        return {name: loan.frames for name, loan in dict(self._loans).items()}

    def count(self, config: Config) -> tuple[Config, tuple[ParameterChange, ...]]:
        """Count one frame; return the configuration and the records of its changes.

        Settings whose frames are over are set back.
        """
        changes: list[ParameterChange] = []
        for name, loan in list(self._loans.items()):
            if loan.frames > 1:
                self._loans[name] = _Loan(before=loan.before, frames=loan.frames - 1)
                continue
            del self._loans[name]
            after = config_with_setting(config, name, loan.before)
            changes.append(change_record(config, after, name, "the end of its frames"))
            config = after
        return config, tuple(changes)
