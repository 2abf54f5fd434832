"""``--world random``: a world drawn by its seed from a published table of distributions."""

import math
import zlib
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.simulator.world.world import World, world_from

_STREAM = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingDistribution:
    """Distribution from which random worlds draw one setting."""

    name: str
    low: float
    high: float
    """Upper bound; equal to ``low`` for a constant."""
    kind: Literal["uniform", "log-uniform"] = "uniform"
    share: float = 1.0
    """Fraction of worlds in which the setting is drawn; in the rest it keeps its default."""
    group: str = ""
    """Name of a group of settings that are drawn in the same worlds; empty: drawn by itself."""

    def draw(self, seed: int) -> float | None:
        """Value of the setting in the world of this seed; None where it keeps its default.

        Each setting has its own random generator, so that a new line in the table changes no other.
        """
        chance = frame_rng(_STREAM, seed, 0, zlib.crc32((self.group or self.name).encode()))
        if chance.random() >= self.share:
            return None
        at = frame_rng(_STREAM, seed, 1, zlib.crc32(self.name.encode())).random()
        if self.kind == "log-uniform":
            value = math.exp(np.interp(at, (0.0, 1.0), (math.log(self.low), math.log(self.high))))
        else:
            value = self.low + at * (self.high - self.low)
        return float(f"{value:.4g}")


LAWS = (
    SettingDistribution(name="shutter.scatter_s", low=0.01, high=1.0, kind="log-uniform"),
    SettingDistribution(name="shutter.latency_s", low=0.0, high=1.0),
    SettingDistribution(name="shutter.line_time_us", low=0.0, high=25.0),
    SettingDistribution(name="seeing.fwhm_arcsec", low=1.5, high=7.0),
    SettingDistribution(name="seeing.drift_percent_h", low=-10.0, high=30.0),
    SettingDistribution(name="seeing.image_motion_arcsec", low=0.0, high=1.0),
    SettingDistribution(name="focus.ring_px", low=0.0, high=10.0, share=0.2),
    SettingDistribution(name="stars.drift_px", low=0.0, high=20.0),
    SettingDistribution(name="stars.drift_angle_deg", low=0.0, high=360.0),
    SettingDistribution(name="stars.periodic_arcsec", low=0.0, high=15.0),
    SettingDistribution(name="stars.periodic_s", low=200.0, high=600.0),
    SettingDistribution(name="wind.rms_px", low=0.0, high=4.0),
    SettingDistribution(name="sensor.row_noise_sigma", low=0.0, high=2.0),
    SettingDistribution(name="sensor.column_noise_sigma", low=0.0, high=0.5),
    SettingDistribution(name="sensor.glow_e_s", low=1.0, high=100.0, kind="log-uniform", share=0.2),
    SettingDistribution(name="sensor.hot_fraction", low=1e-5, high=1e-3, kind="log-uniform"),
    SettingDistribution(name="clock.offset_s", low=-2.0, high=2.0),
    SettingDistribution(name="clock.drift_ppm", low=-20.0, high=20.0),
    SettingDistribution(name="optics.scale_error", low=-0.04, high=0.04),
    SettingDistribution(name="optics.distortion", low=-0.001, high=0.001),
    SettingDistribution(name="optics.camera_angle_deg", low=-180.0, high=180.0),
    SettingDistribution(name="catalogue.drift_arcsec", low=0.0, high=0.3),
    SettingDistribution(name="catalogue.drift_angle_deg", low=0.0, high=360.0),
    SettingDistribution(name="mount.arrival_arcsec", low=15.0, high=120.0, kind="log-uniform"),
    SettingDistribution(name="mount.settle_s", low=0.0, high=4.0),
    SettingDistribution(name="mount.settle_arcsec", low=5.0, high=60.0, kind="log-uniform"),
    SettingDistribution(name="mount.jump_arcsec", low=5.0, high=60.0, share=0.1),
    SettingDistribution(
        name="satellite.flash_period_s",
        low=1.0,
        high=60.0,
        kind="log-uniform",
        share=0.1,
        group="flash",
    ),
    SettingDistribution(name="satellite.flash_duty", low=0.2, high=0.8, share=0.1, group="flash"),
    SettingDistribution(
        name="satellite.flash_depth_mag", low=1.0, high=5.0, share=0.1, group="flash"
    ),
    SettingDistribution(name="clouds.rate_h", low=1.0, high=6.0, share=0.1, group="clouds"),
    SettingDistribution(name="clouds.duration_s", low=30.0, high=300.0, share=0.1, group="clouds"),
    SettingDistribution(name="clouds.extinction_mag", low=0.5, high=4.0, share=0.1, group="clouds"),
    SettingDistribution(name="moon.brightening_mag", low=0.0, high=2.0, share=0.25, group="moon"),
    SettingDistribution(name="moon.gradient", low=0.0, high=0.3, share=0.25, group="moon"),
    SettingDistribution(
        name="moon.gradient_angle_deg", low=0.0, high=360.0, share=0.25, group="moon"
    ),
    SettingDistribution(name="traffic.low_satellite_rate", low=0.1, high=0.1),
    SettingDistribution(name="traffic.aircraft_rate", low=0.02, high=0.02),
    SettingDistribution(name="frames.failed_rate", low=0.0, high=0.03, share=0.1),
    SettingDistribution(name="frames.late_rate", low=0.0, high=0.1, share=0.1, group="late"),
    SettingDistribution(name="frames.late_s", low=1.0, high=20.0, share=0.1, group="late"),
)
"""The distribution. A camera's latency is known to its operator to 0.1 s in every world."""


def random_world(seed: int) -> World:
    """The random world of this seed, drawn from ``LAWS``; the same on every machine."""
    table: dict[str, dict[str, Any]] = {}
    for law in LAWS:
        value = law.draw(seed)
        if value is not None:
            section, _, key = law.name.partition(".")
            table.setdefault(section, {})[key] = value
    return world_from(table, source=f"the random world of seed {seed}")
