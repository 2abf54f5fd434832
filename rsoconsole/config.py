"""The configuration: what an operator may set, validated, with where each value came from.

Defaults describe the paper's telescope. Values come from, weakest first: the defaults, the TOML
file, the command line. Units are in the names.
"""

import itertools
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, Self

import platformdirs
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_serializer,
    field_validator,
    model_validator,
)

from rsoconsole.alerts_config import AlertsConfig
from rsoconsole.element_error_config import MeasuredErrors
from rsoconsole.errors import ConfigError
from rsoconsole.fault_text import nearest, plain_fault
from rsoconsole.foreign_text import read_foreign, toml_of
from rsoconsole.indi_port import INDI_PORT
from rsoconsole.records import Site
from rsoconsole.shutter_config import CalibratedTiming
from rsoconsole.source_names import expect_url, shown, split_source

APP = "rsoconsole"


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _home_is_where_the_tilde_says(cls, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(part.expanduser() if isinstance(part, Path) else part for part in value)
        return value.expanduser() if isinstance(value, Path) else value


class SiteConfig(_Section):
    """Where the telescope stands (WGS84)."""

    name: str = "Daytona Beach"
    latitude_deg: float = Field(29.19, ge=-90, le=90)
    longitude_deg: float = Field(-81.05, ge=-180, le=360, description="east positive")
    elevation_m: float = Field(10.0, ge=-430, le=9000)

    def to_site(self) -> Site:
        """The record the rest of the program speaks; longitude in -180 to 180."""
        return Site(
            latitude_deg=self.latitude_deg,
            longitude_deg=(self.longitude_deg + 180.0) % 360.0 - 180.0,
            elevation_m=self.elevation_m,
        )


class OpticsConfig(_Section):
    """Telescope and sensor."""

    focal_length_mm: float = Field(620.0, gt=0, le=20000)
    pixel_um: float = Field(3.8, gt=0, le=100)
    width_px: int = Field(4656, ge=64, le=20000)
    height_px: int = Field(3520, ge=64, le=20000)

    @property
    def scale_arcsec_px(self) -> float:
        """Plate scale at the centre of the field."""
        return 206.264806 * self.pixel_um / self.focal_length_mm

    @property
    def field_deg(self) -> tuple[float, float]:
        """Width and height of the field."""
        s = self.scale_arcsec_px / 3600.0
        return self.width_px * s, self.height_px * s


class IndiConfig(_Section):
    """The INDI server and the names of the devices on it."""

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


class InstrumentsConfig(_Section):
    """Which protocols mount and camera speak; installed packages may bring others than INDI."""

    mount: str = Field("indi", min_length=1, description="INDI's, or an installed package's")
    camera: str = Field("indi", min_length=1, description="INDI's, or an installed package's")
    options: dict[str, str | int | float | bool] = Field(
        {}, description="settings of such a package"
    )


class WaitsConfig(_Section):
    """How long what is slow to start is waited for, by the wall clock; never longer than needed."""

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
    def connected_s(self) -> float:
        """At most, from the start of a device's process until the device is ready."""
        return self.process_s + 2.0 * self.device_s

    @property
    def order_s(self) -> float:
        """At most, for an order of several steps."""
        return 3.0 * self.answer_s + 5.0


class ExposureConfig(_Section):
    """One exposure and the pause to the next."""

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


class MountConfig(_Section):
    """How the mount is built, how long it is given, and what becomes of it after a stop."""

    type: Literal["german", "fork"] = Field(
        "german", description="a German mount changes the side of its pier at the meridian"
    )
    meridian: Literal["flip", "hold"] = Field(
        "flip", description="hold: no slew that would change sides while a track is followed"
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


class LimitsConfig(_Section):
    """Where the telescope must never look or turn, whoever wants it to."""

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


class CalibrationConfig(_Section):
    """Master frames of the camera, applied to every frame before anything is looked for."""

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
    def files(self) -> tuple[tuple[str, Path], ...]:
        """(name of the setting, file) of every master."""
        darks = [("darks", path) for path in self.darks]
        others = [("flat", self.flat), ("bias", self.bias)]
        return (*darks, *((name, path) for name, path in others if path is not None))


class DetectorConfig(_Section):
    """The streak detector."""

    tau: float = Field(0.10, gt=0, lt=1, description="confidence a detection must exceed")
    map_mode: Literal["fast", "paper"] = "fast"
    centroid: Literal["line", "box"] = "line"
    threads: int = Field(
        0, ge=0, le=16, description="that share a frame; 0: one a core, at most four"
    )
    model: Path | None = Field(None, description="another network; its .json lies beside it")


class SolverConfig(_Section):
    """The plate solver."""

    index_dirs: tuple[Path, ...] = ()
    radius_deg: float = Field(3.0, gt=0, le=180)
    scale_tolerance: float = Field(0.05, gt=0, lt=1)
    deadline_s: float = Field(10.0, gt=0, le=600, description="of all searches for one frame")
    blind_deadline_s: float = Field(
        60.0,
        gt=0,
        le=3600,
        description="where no position is known: of the first, second, fourth, eighth ... frame in"
        " a row that is not solved",
    )


class FilterConfig(_Section):
    """The linear quadratic estimator."""

    preset: Literal["adaptive", "tuned", "paper"] = Field(
        "adaptive",
        description="adaptive: motions weighed by their likelihood, learns how much a night"
        " scatters; tuned: constant rates in RA and Dec; paper: the paper's",
    )
    sigma_arcsec: float = Field(4.0, gt=0, le=600)
    q_arcsec2_s3: float = Field(1e-5, gt=0, le=1e3, description="white-noise acceleration")
    q_multiplier: float = Field(1.0, gt=0, le=1e6, description="of all of Q")
    q_ra_multiplier: float = Field(1.0, gt=0, le=1e6, description="of Q's term of RA alone")
    q_ra_rate_multiplier: float = Field(1.0, gt=0, le=1e6)
    q_dec_multiplier: float = Field(1.0, gt=0, le=1e6)
    q_dec_rate_multiplier: float = Field(1.0, gt=0, le=1e6)
    r_multiplier: float = Field(1.0, gt=0, le=1e6, description="of all of R")
    r_ra_multiplier: float = Field(1.0, gt=0, le=1e6, description="of R's term of RA alone")
    r_dec_multiplier: float = Field(1.0, gt=0, le=1e6)
    gate_nis: float = Field(11.83, gt=0, le=1e9)
    most_tracks: int = Field(
        12,
        ge=1,
        le=24,
        description="satellites followed at a time, by preset adaptive; 1: the lead alone",
    )
    initiation: Literal["chains", "pairs"] = Field(
        "chains",
        description="what begins a track, by preset adaptive; chains: two frames that agree, points"
        " without a direction by a line through five, and what a frame between has hidden; pairs:"
        " two successive frames alone",
    )
    max_coast_s: float = Field(7200.0, gt=0, le=86400, description="coasted longer, it is lost")
    max_3sigma_arcmin: float = Field(
        600.0, gt=0, le=600, description="less sure, it is lost; never beyond half the field"
    )


class TargetConfig(_Section):
    """One place to search: a belt slot, a direction fixed to the ground, or one in the sky."""

    name: str
    slot_longitude_deg: float | None = Field(
        None, ge=-180, le=360, description="of a geostationary satellite, east positive"
    )
    hour_angle_deg: float | None = Field(None, ge=-180, le=180)
    ra_icrs_deg: float | None = Field(None, ge=0, lt=360)
    declination_deg: float | None = Field(None, ge=-90, le=90)

    @model_validator(mode="after")
    def _says_one_place(self) -> Self:
        given = [self.slot_longitude_deg, self.hour_angle_deg, self.ra_icrs_deg]
        if sum(value is not None for value in given) != 1:
            raise ValueError("give one of slot_longitude_deg, hour_angle_deg, ra_icrs_deg")
        if self.ra_icrs_deg is not None and self.declination_deg is None:
            raise ValueError("ra_icrs_deg needs declination_deg")
        return self


class SearchConfig(_Section):
    """What the telescope does while it has no track."""

    pattern: Literal["stay", "belt", "targets"] = "belt"
    targets: tuple[TargetConfig, ...] = Field(
        (), description="places to visit in turn, for the pattern targets"
    )
    hour_angle_deg: float | None = Field(None, description="centre; null: where the mount points")
    declination_deg: float | None = None
    belt_step_fields: float = Field(0.75, gt=0, le=1)
    belt_fields: int = Field(7, ge=1, le=200)
    frames_per_field: int = Field(2, ge=1, le=20)
    follow: Literal["nearest", "most confident"] = Field(
        "nearest", description="which of several fitting detections the track takes"
    )
    recentre: Literal["when needed", "every"] = "when needed"
    recentre_fraction: float = Field(0.25, gt=0, lt=0.5)

    @model_validator(mode="after")
    def _targets_are_there(self) -> Self:
        if self.pattern == "targets" and not self.targets:
            raise ValueError("pattern 'targets' needs search.targets")
        return self


class AimConfig(_Section):
    """Where the telescope looks: at which of several tracks, and how far beside the prediction."""

    policy: Literal["lead", "most", "group"] = Field(
        "lead",
        description="of several satellites in the field: the lead in the middle, as many as"
        " possible, or all as long as they fit; preset paper looks at the lead",
    )
    lead_s: float = Field(
        0.0, ge=-600, le=600, description="ahead of the prediction, in time; below 0 behind it"
    )
    along_arcmin: float = Field(0.0, ge=-120, le=120, description="offset along the motion")
    across_arcmin: float = Field(
        0.0, ge=-120, le=120, description="offset to the left of the motion, seen on the sky"
    )

    @property
    def is_offset(self) -> bool:
        """Whether it looks beside the prediction by hand."""
        return any((self.lead_s, self.along_arcmin, self.across_arcmin))


class LeapConfig(_Section):
    """Low satellites: the telescope stares, and leaps ahead of what it catches."""

    enabled: bool = Field(
        False,
        description="stare where the telescope points, exposures back to back, and leap ahead of"
        " each low satellite that comes through, until it sets",
    )
    stare_exposure_s: float = Field(0.2, ge=0.001, le=60, description="while it stares")
    least_rate_arcsec_s: float = Field(
        150.0, ge=20, le=10000, description="slower on the sky, nothing is leapt after"
    )
    most_misses: int = Field(
        4, ge=1, le=50, description="leaps in a row without it, after which it is given up"
    )
    at_close: bool = Field(
        True,
        description="order the next slew as the shutter closes, once one frame more changes nothing"
        " of where it leads; false: when the frame has been read out and examined",
    )
    binning: int = Field(
        1,
        ge=0,
        le=4,
        description="pixels joined on each axis while it stares and leaps, where the camera can;"
        " 0: as many as leave a streak well measured",
    )
    pass_norad: int = Field(
        0,
        ge=0,
        le=999_999_999,
        description="catalogue number of the one whose passes are waited for; 0: whatever comes",
    )
    late_sigma_s: float = Field(
        10.0,
        ge=0.1,
        le=300,
        description="how early or late by its elements it may be, one sigma: it is waited for three"
        " to either side",
    )
    waits: bool = Field(
        False, description="wait for the next pass of what has been leapt after, by its own orbit"
    )


class OrbitConfig(_Section):
    """The orbit of what is followed, found while it is followed."""

    online: bool = Field(True, description="refine the orbit after each measurement")
    prior: Literal["auto", "none", "slot", "geo", "meo"] = Field(
        "auto", description="what is believed of an orbit beforehand; auto: only what is needed"
    )
    guide: Literal["when better", "never"] = Field(
        "when better",
        description="whether the telescope goes where the orbit says, where that foretells better"
        " than the filter, and looks there for what the filter has lost",
    )
    wait_min: float = Field(
        30.0, ge=0, le=1440, description="how long the telescope waits where a lost one's orbit is"
    )


class CatalogueConfig(_Section):
    """Which satellites are known by name."""

    tle_files: tuple[Path, ...] = Field(
        (),
        description="element sets, as published: TLE, or OMM as XML, JSON or CSV; a folder: what"
        " 'rsoconsole catalogue update' keeps there",
    )
    sources: tuple[str, ...] = Field(
        (),
        description="whom 'rsoconsole catalogue update' asks, the one with precedence first:"
        " celestrak:GROUP, supgp:FILE, space-track:all, url:https://..., file:/...",
        repr=False,
    )
    celestrak_url: str = Field(
        "https://celestrak.org", description="or a mirror of it in your network"
    )
    space_track_url: str = "https://www.space-track.org"
    space_track_login: Path | None = Field(
        None,
        description="file of two lines, user name and password, that only you can read",
    )
    gate_deg: float = Field(
        0.2, gt=0, le=5, description="how far off its elements an object may be and be named"
    )
    error_factors: tuple[MeasuredErrors, ...] = Field(
        (),
        description="by what the assumed errors of elements are multiplied, by kind of orbit, as"
        " 'rsoconsole calibrate-elements --write' measured it",
    )

    @field_validator("sources")
    @classmethod
    def _sources_are_sound(cls, texts: tuple[str, ...]) -> tuple[str, ...]:
        for text in texts:
            split_source(text)
        return texts

    @field_serializer("sources", when_used="json")
    def _sources_without_secrets(self, texts: tuple[str, ...]) -> list[str]:
        """As sessions, logs and 'config show' carry them."""
        return [shown(text) for text in texts]

    @field_validator("celestrak_url", "space_track_url")
    @classmethod
    def _addresses_are_sound(cls, text: str) -> str:
        expect_url(text)
        return text

    @model_validator(mode="after")
    def _one_of_each_kind(self) -> Self:
        regimes = [each.regime for each in self.error_factors]
        twice = sorted({each for each in regimes if regimes.count(each) > 1})
        if twice:
            raise ValueError(f"error_factors has {twice[0]} twice: leave one of them out")
        return self


class AlertConfig(_Section):
    """What the operator is warned of beside faults."""

    separation_arcsec: float = Field(
        30.0,
        ge=0,
        le=3600,
        description="two satellites of the field that are, or are more likely than not to come,"
        " nearer to each other on the sky; 0: no warning",
    )
    ahead_min: float = Field(
        120.0, ge=0, le=360, description="how long before its closest approach a pair is warned of"
    )


Graphics = Literal[
    "auto", "kitty", "sixel", "blocks", "octants", "sextants", "quadrants", "half-blocks"
]
Alert = Literal["acquisition", "loss", "limit", "fault", "approach"]


class ConsoleConfig(_Section):
    """How the console looks, and what it does to be noticed."""

    ascii: bool | None = Field(
        None, description="letters only; null: where the terminal's encoding is not UTF-8"
    )
    graphics: Graphics = Field(
        "auto",
        description="how pictures are drawn; auto: by the terminal's own graphics, if any; blocks:"
        " by the finest of its characters",
    )
    bell: tuple[Alert, ...] = Field(
        ("loss", "limit", "fault", "approach"), description="what the terminal's bell is rung for"
    )
    notify: tuple[Alert, ...] = Field(
        (), description="what the terminal is asked to show a notification for (OSC 9)"
    )


class SessionConfig(_Section):
    """Where sessions are kept and what of the frames."""

    root: Path = Path(platformdirs.user_data_path(APP)) / "sessions"
    keep_frames: Literal["all", "detected", "last", "none"] = Field(
        "all", description="whose pixels are kept; last: of the last 12 frames alone"
    )


class Config(_Section):
    """Everything an operator may set."""

    site: SiteConfig = SiteConfig()
    optics: OpticsConfig = OpticsConfig()
    indi: IndiConfig = IndiConfig()
    instruments: InstrumentsConfig = InstrumentsConfig()
    waits: WaitsConfig = WaitsConfig()
    exposure: ExposureConfig = ExposureConfig()
    mount: MountConfig = MountConfig()
    limits: LimitsConfig = LimitsConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    detector: DetectorConfig = DetectorConfig()
    solver: SolverConfig = SolverConfig()
    filter: FilterConfig = FilterConfig()
    search: SearchConfig = SearchConfig()
    aim: AimConfig = AimConfig()
    orbit: OrbitConfig = OrbitConfig()
    leap: LeapConfig = LeapConfig()
    catalogue: CatalogueConfig = CatalogueConfig()
    alert: AlertConfig = AlertConfig()
    alerts: AlertsConfig = AlertsConfig()
    session: SessionConfig = SessionConfig()
    console: ConsoleConfig = ConsoleConfig()


def default_config_path() -> Path:
    """``$RSOCONSOLE_CONFIG``, else ``config.toml`` in the user's configuration folder."""
    named = os.environ.get("RSOCONSOLE_CONFIG")
    return Path(named) if named else platformdirs.user_config_path(APP) / "config.toml"


def data_dir() -> Path:
    """The user's data folder: sessions, index files."""
    return platformdirs.user_data_path(APP)


def state_dir() -> Path:
    """The user's state folder, which outlives logins: who drives which mount."""
    return platformdirs.user_state_path(APP)


def runtime_dir() -> Path:
    """A folder that only its owner can enter, made if need be: the control socket lies there.

    In ``$XDG_RUNTIME_DIR`` where the system gives one, else in the user's cache: a shared
    temporary folder is nobody's. Raises ConfigError where neither can be written, and for a folder
    of another user, for root as well.
    """
    given = os.environ.get("XDG_RUNTIME_DIR")
    cache = Path(platformdirs.user_cache_path(APP)) / "run"
    path = Path(given) / APP if given else cache
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        path = cache
        try:
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(
                f"no folder for the engine's socket can be made ({path}: {error.strerror}): make "
                "~/.cache writable, or set XDG_RUNTIME_DIR to a folder of your own"
            ) from error
    _expect_own(path)
    path.chmod(0o700)
    return path


def _expect_own(path: Path) -> None:
    """Raises ConfigError where another user than root or this one could put something else."""
    for each, owners in ((path, {os.geteuid()}), (path.parent, {os.geteuid(), 0})):
        found = each.lstat() if each is path else each.stat()
        if found.st_uid not in owners or not stat.S_ISDIR(found.st_mode):
            raise ConfigError(
                f"{each} belongs to another user (uid {found.st_uid}): run this as that user, or"
                " set XDG_RUNTIME_DIR to a folder of your own"
                if stat.S_ISDIR(found.st_mode)
                else f"{each} is no folder: remove it, or set XDG_RUNTIME_DIR to one of your own"
            )


def load_config(path: Path | None = None, overrides: Mapping[str, Any] | None = None) -> Config:
    """Read and validate a configuration.

    ``path`` None means the default place, where a missing file is fine. ``overrides`` maps
    dotted names to values, e.g. ``{"detector.tau": 0.2}``. Raises ConfigError with every fault.
    """
    source = path or default_config_path()
    table: dict[str, Any] = {}
    if path is not None or source.exists():
        table = _read_toml(source)
    for dotted, value in (overrides or {}).items():
        section, _, key = dotted.partition(".")
        if isinstance(table.setdefault(section, {}), dict):
            table[section][key] = value
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(str(part) for part in fault['loc'])}: {plain_fault(fault['msg'])}"
            for fault in error.errors()
        )
        raise ConfigError(f"{source}: {faults}") from error


def with_setting(config: Config, name: str, value: Any) -> Config:
    """The configuration with one setting, by its dotted name, at another value.

    Raises ConfigError where there is no such setting, and where it cannot have that value.
    """
    table = config.model_dump()
    section, _, key = name.partition(".")
    if key not in table.get(section, {}):
        raise ConfigError(unknown_setting(name, (each for each, _, _ in walk(config))))
    table[section][key] = value
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        raise ConfigError(f"{name} = {value}: {plain_fault(error.errors()[0]['msg'])}") from error


def unknown_setting(name: str, known: Iterable[str]) -> str:
    """That there is none of this name, with the one that was probably meant."""
    near = nearest(name, known)
    remedy = f"did you mean {near}?" if near else "'rsoconsole config show' lists them"
    return f"there is no setting {name!r}: {remedy}"


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return toml_of(read_foreign(path))
    except FileNotFoundError as error:
        raise ConfigError(f"{path} does not exist: 'rsoconsole config init' writes one") from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read as TOML: {error}") from error


def walk(config: Config) -> Iterator[tuple[str, Any, str]]:
    """Every setting as (dotted name, value, description), in order."""
    for section_name in type(config).model_fields:
        section = getattr(config, section_name)
        for key, info in type(section).model_fields.items():
            yield f"{section_name}.{key}", getattr(section, key), info.description or ""
