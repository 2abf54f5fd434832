"""Settings of the place and its instruments."""

import itertools
from datetime import date
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from rsoconsole.base import INDI_PORT
from rsoconsole.config.source_names import expand_home
from rsoconsole.records import Site

TimeSource = Literal["header", "gps"]


class Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _home_is_where_the_tilde_says(cls, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(expand_home(part) if isinstance(part, Path) else part for part in value)
        return expand_home(value) if isinstance(value, Path) else value


class CalibratedTiming(Section):
    """Calibrated timing of one camera mode; a camera setting of None was not recorded."""

    exposure_s: float | None = Field(None, gt=0, le=1e6)
    """None: of whatever length."""
    binning: str | None = Field(None, pattern=r"^\d{1,2}x\d{1,2}$")
    width_px: int | None = Field(None, ge=1, le=100_000)
    height_px: int | None = Field(None, ge=1, le=100_000)
    x0_px: int | None = Field(None, ge=0, le=100_000)
    """First column of a subframe on the sensor."""
    y0_px: int | None = Field(None, ge=0, le=100_000)
    gain: float | None = None
    time_by: TimeSource = "header"
    bias_s: float = Field(ge=-10, le=10)
    """True mid-exposure of the first row minus the header's."""
    bias_sigma_s: float = Field(ge=0, le=10)
    scatter_s: float = Field(ge=0, le=10)
    scatter_sigma_s: float = Field(ge=0, le=10)
    line_time_us: float = Field(0.0, ge=-1000, le=1000)
    line_time_sigma_us: float | None = Field(None, ge=0, le=1000)
    """None: it was not measured, and the bias holds with this one."""
    measured_on: date
    """Day of its last night (UTC)."""
    source: Literal["broadcast", "sp3"]
    tracks: int = Field(ge=1, le=1_000_000)
    measurements: int = Field(ge=1, le=100_000_000)

    @property
    def camera_mode(self) -> tuple[object, ...]:
        """Camera settings that distinguish this mode from others: exposure time, then the rest."""
        return (self.exposure_s, *self.read_out_mode)

    @property
    def read_out_mode(self) -> tuple[object, ...]:
        """The camera settings of this mode except the exposure time."""
        sides = (self.width_px, self.height_px, self.x0_px, self.y0_px)
        return (self.binning, *sides, self.gain, self.time_by)


class SiteConfig(Section):
    """Where the telescope stands (WGS84)."""

    name: str = "Daytona Beach"
    latitude_deg: float = Field(29.19, ge=-90, le=90)
    longitude_deg: float = Field(-81.05, ge=-180, le=360, description="east positive")
    elevation_m: float = Field(10.0, ge=-430, le=9000)

    @property
    def is_set(self) -> bool:
        """True where its coordinates were given, False for the default ones."""
        return {"latitude_deg", "longitude_deg"} <= self.model_fields_set

    def to_site(self) -> Site:
        """Return the site as a ``Site`` record, with longitude in -180 to 180."""
        return Site(
            latitude_deg=self.latitude_deg,
            longitude_deg=(self.longitude_deg + 180.0) % 360.0 - 180.0,
            elevation_m=self.elevation_m,
        )


class OpticsConfig(Section):
    """Telescope and sensor."""

    focal_length_mm: float = Field(620.0, gt=0, le=20000)
    pixel_um: float = Field(3.8, gt=0, le=100)
    width_px: int = Field(4656, ge=64, le=20000)
    height_px: int = Field(3520, ge=64, le=20000)

    @property
    def scale_arcsec_px(self) -> float:
        """Plate scale at the centre of the field, arcsec a pixel."""
        return 206.264806 * self.pixel_um / self.focal_length_mm

    @property
    def field_deg(self) -> tuple[float, float]:
        """Width and height of the field, degrees."""
        s = self.scale_arcsec_px / 3600.0
        return self.width_px * s, self.height_px * s


class IndiConfig(Section):
    """The INDI server and the names of the devices on it."""

    client: Literal["auto", "pyindi", "indipyclient"] = Field(
        "auto",
        description="library that speaks INDI; auto: pyindi-client where it is installed, else"
        " indipyclient",
    )
    host: str = "127.0.0.1"
    port: int = Field(INDI_PORT, ge=1, le=65535)
    mount: str = "Telescope Simulator"
    camera: str = "CCD Simulator"
    weather: str | None = Field(None, description="device whose WEATHER_STATUS ends the night")
    dome: str | None = Field(None, description="device whose shutter must be open")
    simulated: bool = Field(False, description="the server is rsoconsole's simulated observatory")
    simulated_latency_s: float = Field(
        0.5, ge=0, le=60, description="virtual time that processing a frame costs under simulation"
    )


class InstrumentsConfig(Section):
    """Protocols of mount and camera: INDI, or one that an installed package brings."""

    mount: str = Field("indi", min_length=1, description="INDI's, or an installed package's")
    camera: str = Field("indi", min_length=1, description="INDI's, or an installed package's")
    options: dict[str, str | int | float | bool] = Field(
        {}, description="settings of such a package"
    )


class WaitsConfig(Section):
    """Longest waits for processes and devices that are slow to start, by the wall clock."""

    process_s: float = Field(
        60.0, gt=0, le=3600, description="for a process of the program's own to start"
    )
    device_s: float = Field(
        45.0,
        gt=0,
        le=3600,
        description="for the INDI server to announce a device, and again for its properties",
    )
    quiet_s: float = Field(
        15.0,
        gt=0,
        le=3600,
        description="a server that has announced other devices and then nothing new for so long"
        " does not have the one asked for",
    )
    answer_s: float = Field(
        15.0, gt=0, le=50, description="for a device to take an order; STOP has its own limits"
    )

    @property
    def longest_connection_s(self) -> float:
        """Longest time from the start of a device's process until the device is ready, s."""
        return self.process_s + 2.0 * self.device_s

    @property
    def longest_order_s(self) -> float:
        """Longest time for an order of several steps to a device, s."""
        return 3.0 * self.answer_s + 5.0


class ExposureConfig(Section):
    """Exposure time, cadence, and timing of the shutter."""

    exposure_s: float = Field(10.0, ge=0.001, le=600)
    cadence_s: float = Field(30.0, ge=0.1, le=3600, description="start to start, at least")
    automatic: bool = Field(
        True,
        description="both follow the rate of the track where its streak would be too short to have"
        " a direction, too long for the frame, or out of the field at the next exposure",
    )
    shortest_s: float = Field(0.5, ge=0.001, le=600, description="of automatic exposures")
    longest_s: float = Field(30.0, ge=0.001, le=600, description="of automatic exposures")
    start_latency_s: float = Field(0.3, ge=0, le=10, description="command to shutter")
    header_latency_s: float = Field(
        0.0, ge=-10, le=10, description="true shutter opening minus DATE-OBS"
    )
    timing_sigma_s: float = Field(
        0.015, ge=0, le=10, description="how well the shutter's opening is known"
    )
    line_time_us: float = Field(
        0.0,
        ge=-1000,
        le=1000,
        description="rolling shutter: each row of the frame begins so much after the row above;"
        " below 0 where the frame stands on its head",
    )
    calibrated: tuple[CalibratedTiming, ...] = Field(
        (),
        description="the shutter by camera mode, as 'rsoconsole calibrate-time --write' measured"
        " it; where a frame's mode is among them, in place of header_latency_s, timing_sigma_s and"
        " line_time_us",
    )
    readout_s: float = Field(1.0, ge=0, le=60, description="shutter to the end of the read-out")
    frame_timeout_s: float = Field(
        30.0, gt=0, le=600, description="wall clock, beyond the exposure"
    )

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> Self:
        if self.shortest_s > self.longest_s:
            raise ValueError("shortest_s is above longest_s: give the shorter exposure first")
        return self


class MountConfig(Section):
    """Type of the mount, time limits of its motions, and what it does after a STOP."""

    type: Literal["german", "fork"] = Field(
        "german", description="a German mount changes the side of its pier at the meridian"
    )
    meridian: Literal["flip", "hold"] = Field(
        "flip", description="hold: no slew that would change sides while a track is followed"
    )
    pier_side: Literal["found", "driver", "reversed", "none"] = Field(
        "found",
        description="how the driver's side of the pier is read: as it says, the other way round,"
        " not at all, or as slews to both sides of the meridian show",
    )
    flip_hysteresis_deg: float = Field(
        0.5, ge=0, le=30, description="a slew changes sides that far past the meridian"
    )
    slew_rate_deg_s: float = Field(4.0, gt=0, le=60, description="of either axis at full speed")
    settle_s: float = Field(2.0, ge=0, le=60)
    slew_timeout_s: float = Field(120.0, gt=0, le=900)
    arrival_arcmin: float = Field(3.0, gt=0, le=60)
    after_stop: Literal["track", "stand still"] = Field(
        "track", description="what the mount does once STOP has ended its motion"
    )
    lease_s: float = Field(
        10.0, ge=2, le=600, description="a slew that nobody watches for so long is ended"
    )
    park_at_end: bool = Field(True, description="park at dawn, on bad weather, under a closed dome")


class LimitsConfig(Section):
    """Directions and axis positions that are forbidden to the telescope, for every controller."""

    min_altitude_deg: float = Field(15.0, ge=-5, le=85)
    horizon: tuple[tuple[float, float], ...] = Field(
        (), description="[azimuth, altitude] of walls and trees, degrees, straight lines between"
    )
    max_hour_angle_deg: float = Field(
        120.0, gt=0, le=180, description="either side of the meridian"
    )
    past_meridian_deg: float = Field(
        10.0, ge=0, le=90, description="how far a German mount may track beyond it without a flip"
    )
    sun_cone_deg: float = Field(40.0, ge=0, le=180)
    twilight_deg: float = Field(
        -12.0, ge=-90, le=90, description="the Sun's altitude above which the night is over"
    )

    @field_validator("horizon")
    @classmethod
    def _horizon_goes_round_once(
        cls, points: tuple[tuple[float, float], ...]
    ) -> tuple[tuple[float, float], ...]:
        azimuths = [azimuth for azimuth, _ in points]
        if any(not 0.0 <= azimuth < 360.0 for azimuth in azimuths):
            raise ValueError("every azimuth must be from 0 to below 360 deg")
        if any(b <= a for a, b in itertools.pairwise(azimuths)):
            raise ValueError("azimuths must rise from point to point")
        if any(not -5.0 <= altitude <= 90.0 for _, altitude in points):
            raise ValueError("every altitude must be from -5 to 90 deg")
        return points


class CalibrationConfig(Section):
    """Master frames of the camera, applied to every frame before detection."""

    darks: tuple[Path, ...] = Field(
        (),
        description="master darks, the camera's offset still in them: one for each exposure (and"
        " binning); FITS",
    )
    flat: Path | None = Field(
        None, description="master flat, its own dark or bias already taken off; any level"
    )
    bias: Path | None = Field(
        None, description="master bias: with it a dark is scaled to exposures that have none"
    )

    @property
    def master_files(self) -> tuple[tuple[str, Path], ...]:
        """The configured master frames, as (name of the setting, file)."""
        darks = [("darks", path) for path in self.darks]
        others = [("flat", self.flat), ("bias", self.bias)]
        return (*darks, *((name, path) for name, path in others if path is not None))
