"""Settings of a night: what is looked for, how it is followed, what is known of it."""

from datetime import date
from pathlib import Path
from typing import Literal, Self, TypeAlias, get_args

from pydantic import Field, field_serializer, field_validator, model_validator

from rsoconsole.config.observatory import Section
from rsoconsole.config.source_names import expect_web_address, split_source, without_secrets


class MeasuredErrorFactors(Section):
    """Multipliers of the assumed errors of elements, for one kind of orbit, with sigmas."""

    regime: Literal["GEO", "MEO", "LEO", "HEO"]
    along_at_epoch: float = Field(ge=0.01, le=100)
    along_at_epoch_sigma: float = Field(ge=0, le=1000)
    along_by_age: float = Field(ge=0.01, le=100)
    along_by_age_sigma: float = Field(ge=0, le=1000)
    across: float = Field(ge=0.01, le=100)
    across_sigma: float = Field(ge=0, le=1000)
    tracks: int = Field(ge=1, le=100_000_000)
    """Rows of the ledger that they were found from."""
    objects: int = Field(ge=1, le=100_000_000)
    oldest_days: float = Field(ge=0, le=1e5)
    """Largest age of the elements."""
    measured_on: date
    """Day of the last row (UTC)."""


class DetectorConfig(Section):
    """The streak detector."""

    tau: float = Field(0.10, gt=0, lt=1, description="confidence a detection must exceed")
    map_mode: Literal["fast", "paper"] = "fast"
    centroid: Literal["line", "box"] = "line"
    threads: int = Field(
        0, ge=0, le=16, description="that share a frame; 0: one a core, at most four"
    )
    model: Path | None = Field(None, description="another network; its .json lies beside it")


class SolverConfig(Section):
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


Preset: TypeAlias = Literal["adaptive", "tuned", "paper"]
"""Presets of the filter."""
PRESETS: tuple[Preset, ...] = get_args(Preset)

Learning: TypeAlias = Literal["auto", "on", "off"]
LEARNINGS: tuple[Learning, ...] = get_args(Learning)
"""Whether the filter goes on learning the noise of the night."""


class FilterConfig(Section):
    """The filter that estimates a track's motion (linear quadratic estimator)."""

    preset: Preset = Field(
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
    learning: Learning = Field(
        "auto",
        description="whether presets adaptive and tuned go on learning the noise of the night;"
        " auto: while every factor of Q and R is 1",
    )
    gate_nis: float = Field(11.83, gt=0, le=1e9)
    most_tracks: int = Field(
        12,
        ge=1,
        le=24,
        description="satellites followed at a time, by preset adaptive; 1: the lead alone",
    )
    most_ambiguous: int = Field(
        4,
        ge=1,
        le=1000,
        description="frames in a row whose streak fits two tracks alike, after which the likelier"
        " takes it, by preset adaptive",
    )
    max_coast_s: float = Field(7200.0, gt=0, le=86400, description="coasted longer, it is lost")
    max_3sigma_arcmin: float = Field(
        600.0, gt=0, le=600, description="less sure, it is lost; never beyond half the field"
    )

    @property
    def uses_filter_bank(self) -> bool:
        """True where the preset runs a bank of filters; else it runs one filter."""
        return self.preset == "adaptive"

    @property
    def has_factors(self) -> bool:
        """True where a factor of Q or R is not 1."""
        return any(getattr(self, name) != 1.0 for name in FACTORS)

    @property
    def is_noise_held(self) -> bool:
        """True where what the preset has learnt of the noise stays as it is."""
        return self.learning == "off" or (self.learning == "auto" and self.has_factors)


FACTORS = tuple(name for name in FilterConfig.model_fields if name.endswith("_multiplier"))
"""Names of the operator's factors of Q and R."""


class TargetConfig(Section):
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


class SearchConfig(Section):
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


class AimConfig(Section):
    """Where the telescope looks: at which of several tracks, and how far from the prediction."""

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
        """True where an offset from the predicted position is set."""
        return any((self.lead_s, self.along_arcmin, self.across_arcmin))


class LeapConfig(Section):
    """Low satellites: the telescope stares at one place, then leaps ahead of each it detects."""

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
    learns_settle: bool = Field(
        True,
        description="give the mount less time to settle than mount.settle_s where the stars of"
        " leaps stay as sharp, and more where that makes them sharper; false: as configured",
    )
    binning: int = Field(
        1,
        ge=0,
        le=4,
        description="pixels joined on each axis while it stares and leaps, where the camera can;"
        " 0: as many as leave a streak well measured",
    )
    subframe: float = Field(
        1.0,
        ge=0,
        le=1,
        description="share of each side of the sensor that is read out, about its middle, where a"
        " leap is sure to have the streak there and the camera can; 1: all of it; 0: half, where"
        " the whole keeps a leap waiting",
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


class OrbitConfig(Section):
    """The orbit of the followed object, determined while it is followed."""

    online: bool = Field(True, description="refine the orbit after each measurement")
    prior: Literal["auto", "none", "slot", "geo", "meo", "leo"] = Field(
        "auto", description="what is believed of an orbit beforehand; auto: only what is needed"
    )
    guide: Literal["when better", "never"] = Field(
        "when better",
        description="whether the telescope goes where the orbit says, where that predicts better"
        " than the filter, and looks there for what the filter has lost",
    )
    wait_min: float = Field(
        30.0, ge=0, le=1440, description="how long the telescope waits where a lost one's orbit is"
    )


class CatalogueConfig(Section):
    """Catalogues of orbits by which satellites are identified."""

    tle_files: tuple[Path, ...] = Field(
        (),
        description="element sets, as published: TLE, or OMM as XML, JSON, CSV or KVN; a folder:"
        " what 'rsoconsole catalogue update' keeps there",
    )
    sources: tuple[str, ...] = Field(
        (),
        description="whom 'rsoconsole catalogue update' asks, the one with precedence first:"
        " celestrak:GROUP, supgp:FILE, space-track:all, url:https://..., file:/...",
        repr=False,
    )
    celestrak_url: str = Field(
        "https://celestrak.org", repr=False, description="or a mirror of it in your network"
    )
    space_track_url: str = Field("https://www.space-track.org", repr=False)
    space_track_login: Path | None = Field(
        None, description="file of two lines, user name and password, that only you can read"
    )
    gate_deg: float = Field(
        0.2, gt=0, le=5, description="how far off its elements an object may be and be named"
    )
    error_factors: tuple[MeasuredErrorFactors, ...] = Field(
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
        return [without_secrets(text) for text in texts]

    @field_validator("celestrak_url", "space_track_url")
    @classmethod
    def _addresses_are_sound(cls, text: str) -> str:
        expect_web_address(text)
        return text

    @field_serializer("celestrak_url", "space_track_url", when_used="json")
    def _addresses_without_secrets(self, text: str) -> str:
        return without_secrets(text)

    @model_validator(mode="after")
    def _one_of_each_kind(self) -> Self:
        regimes = [each.regime for each in self.error_factors]
        twice = sorted({each for each in regimes if regimes.count(each) > 1})
        if twice:
            raise ValueError(f"error_factors has {twice[0]} twice: leave one of them out")
        return self
