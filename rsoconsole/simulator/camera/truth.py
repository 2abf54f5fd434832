"""True content and timing of a simulated frame, for tests and summaries only."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Literal

from rsoconsole.simulator.world.world import World


@dataclass(frozen=True, slots=True, kw_only=True)
class SatelliteTruth:
    """One satellite in (or near) one frame; pixels 0-based, directions astrometric ICRS degrees."""

    name: str
    norad_id: int
    is_in_frame: bool
    """True where the satellite's position at mid-exposure lies on the sensor."""
    is_whole: bool
    """True where both ends of its streak lie on the sensor."""
    ra_icrs_deg: float
    """Right ascension at mid-exposure of header and known latency, taken for true UTC."""
    dec_icrs_deg: float
    ra_rate_deg_s: float
    """Rate of right ascension (the coordinate, not times cos dec) at the same instant."""
    dec_rate_deg_s: float
    x_px: float
    y_px: float
    x_start_px: float
    y_start_px: float
    x_end_px: float
    y_end_px: float
    magnitude: float | None
    """Magnitude of the mean flux over the exposure, outside the atmosphere; None when unlit."""
    lit_fraction: float
    """Fraction of the Sun's disc visible from the satellite, mean over the exposure."""
    transmission: float
    """Fraction of its light that the clouds transmit, mean along the streak."""
    electrons: float
    snr_peak_pixel: float
    """Peak SNR: the streak's brightest pixel over its noise."""
    snr_matched: float
    """Signal over noise of the whole streak, weighted by its shape; steady, straight, clear sky."""
    snr_integrated: float
    """Integrated SNR of the streak as rendered, pixel by pixel (``streak_snr.integrated_snr``)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficTruth:
    """Truth of an aircraft or low satellite that crossed the frame; ends as (x, y)."""

    kind: Literal["low satellite", "aircraft"]
    start_px: tuple[float, float]
    end_px: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTruth:
    """Complete truth of one exposure."""

    t_start_utc_ns: int
    """DATE-OBS: by the observatory's clock, rounded down where the world's camera does so."""
    t_place_utc_ns: int
    """Instant of the satellites' places: mid-exposure by header and the camera's known latency."""
    t_open_utc_ns: int
    """True opening of the first row, true UTC."""
    exposure_s: float
    boresight_ra_icrs_deg: float
    boresight_dec_icrs_deg: float
    wcs_cards: Mapping[str, str | int | float]
    fwhm_px: float
    sky_electrons_px: float
    cloud_transmission: float
    """Mean transmission of the clouds over the frame."""
    stars: int
    satellites: tuple[SatelliteTruth, ...]
    traffic: tuple[TrafficTruth, ...] = ()

    @property
    def t_mid_utc_ns(self) -> int:
        """Mid-exposure by the header: DATE-OBS plus half the exposure."""
        return self.t_start_utc_ns + round(self.exposure_s * 5e8)

    def to_json(self) -> str:
        """The truth as one line of JSON."""
        return json.dumps(asdict(self), allow_nan=False)


NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueExposureTiming:
    """True timing of an exposure."""

    t_open_utc_ns: int
    """Opening of the first row, true UTC."""
    line_time_s: float
    """Delay of each row's exposure after the exposure of the row above; 0: global shutter."""


def header_start_utc_ns(world: World, t_start_utc_ns: int) -> int:
    """DATE-OBS of an exposure that the driver began at this instant of its own clock."""
    step_ns = round(world.shutter.round_s * NS)
    return t_start_utc_ns if step_ns == 0 else t_start_utc_ns // step_ns * step_ns


def reported_start_utc_ns(world: World, t_start_utc_ns: int) -> int:
    """Return the shutter's opening as an operator computes it: DATE-OBS plus known latency."""
    return header_start_utc_ns(world, t_start_utc_ns) + round(world.known_latency_s * NS)


def clock_offset_s(world: World, t_utc_ns: int, t_night_utc_ns: int) -> float:
    """True UTC minus the observatory's clock at the instant when the clock shows ``t_utc_ns``.

    ``t_night_utc_ns``: the night's start, from which the clock's drift counts.
    """
    since_s = (t_utc_ns - t_night_utc_ns) / NS
    return world.clock.offset_s + world.clock.drift_ppm * 1e-6 * since_s


def true_exposure_timing(
    world: World, scatter_s: float, t_start_utc_ns: int, t_night_utc_ns: int
) -> TrueExposureTiming | None:
    """Return the true timing of the exposure begun at ``t_start_utc_ns``, observatory's clock.

    ``scatter_s``: random delay of this opening. None where all settings of clock and shutter have
    their defaults: the caller then applies the scatter as a shift along the streak.
    """
    shutter = world.shutter
    later_s = shutter.latency_s + shutter.bias_s
    later_s += clock_offset_s(world, t_start_utc_ns, t_night_utc_ns)
    is_plain = shutter.scatter_s is None and shutter.round_s == shutter.line_time_us == 0.0
    if is_plain and later_s == 0.0:
        return None
    return TrueExposureTiming(
        t_open_utc_ns=t_start_utc_ns + round((later_s + scatter_s) * NS),
        line_time_s=shutter.line_time_us * 1e-6,
    )
