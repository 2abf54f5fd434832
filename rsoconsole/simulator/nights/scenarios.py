"""Named nights of the simulated observatory: site, time, satellites and weather.

Element sets: public catalogue as of 2023-06-22, transcribed into ``data/belt_20230622.tle``; every
geostationary satellite in it is in the sky of every night above the belt, except the empty one.
Magnitudes are typical values for such satellites, not measurements.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, resource_path
from rsoconsole.orbits import CatalogueEntry, ElementSet, parse_elements
from rsoconsole.records import Site
from rsoconsole.simulator.sky.brightness import BrightnessHistory, PeriodicFading
from rsoconsole.simulator.sky.clouds import CloudDeck
from rsoconsole.sky import iso_to_utc_ns

DAYTONA_BEACH = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
MOUNT_JOHN = Site(latitude_deg=-43.99, longitude_deg=170.46, elevation_m=1029.0)
PAPER_FIELD_DEG = 1.635
"""Field width of the paper's telescope: an ASI1600 behind 620 mm of focal length."""
CLEAR = CloudDeck(schedule=())
STEADY = BrightnessHistory()
NIGHT_FRAMES = 40
DEFAULT_SCENARIO = "intelsat-14"
BELT_MAGNITUDES = {
    36097: 12.2,
    39172: 11.9,
    38867: 12.4,
    42432: 11.9,
    49332: 14.5,
    41382: 12.3,
    32768: 12.5,
    42740: 12.0,
    38749: 12.1,
    39078: 12.2,
    35942: 12.6,
    42934: 12.3,
    40874: 12.4,
    36792: 12.1,
    39008: 11.8,
    41592: 12.3,
}
"""Standard magnitude of each geostationary satellite by catalogue number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioSatellite:
    """One satellite in the simulated sky."""

    element_set: ElementSet | CatalogueEntry
    standard_magnitude: float
    """Magnitude of the satellite fully lit at 36,000 km."""
    brightness: BrightnessHistory = STEADY


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One night's fixed settings, the same for every seed."""

    name: str
    title: str
    description: str
    t_start_utc_ns: int
    satellites: tuple[ScenarioSatellite, ...]
    target_norad_id: int | None
    """Catalogue number of the satellite to find; None: the scenario has no such satellite."""
    target_hour_angle_deg: float | None
    """Hour angle of date of the target, west positive; constant for a geostationary satellite."""
    start_hour_angle_deg: float
    """Hour angle of date of the first pointing, for the paper's field of view."""
    start_declination_deg: float
    frames: int = NIGHT_FRAMES
    """Number of exposures at the default cadence that cover all events of the night."""
    site: Site = DAYTONA_BEACH
    clouds: CloudDeck = CLEAR
    seeing_arcsec: float = 2.8
    """FWHM of the stars at the zenith, optics included."""
    sky_electrons_s: float = 13.2
    """Electrons per second from the sky in a pixel of 1.264 arcsec, at the zenith."""
    cosmic_rays_s: float = 0.15
    """Expected number of cosmic-ray tracks per second on the paper's sensor."""
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Settings of the program, by section, that this night needs beside the demo's own."""

    @property
    def target(self) -> ScenarioSatellite | None:
        """Satellite that the telescope is meant to find; None where the scenario has no such
        one.
        """
        wanted = self.target_norad_id
        return next((s for s in self.satellites if s.element_set.norad_id == wanted), None)

    def start_hour_angle_for(self, field_width_deg: float) -> float:
        """Return the first pointing's hour angle, deg, for a field of this width.

        Its offset from the target, in field widths, is as with the paper's field.
        """
        if self.target_hour_angle_deg is None:
            return self.start_hour_angle_deg
        ahead_deg = self.start_hour_angle_deg - self.target_hour_angle_deg
        return self.target_hour_angle_deg + ahead_deg * field_width_deg / PAPER_FIELD_DEG


def scenario_named(name: str) -> Scenario:
    """The scenario of this name; raises ConfigError that lists the valid names."""
    scenarios = all_scenarios()
    if name not in scenarios:
        known = ", ".join(scenarios)
        raise ConfigError(f"there is no scenario {name!r}: take one of {known}")
    return scenarios[name]


@lru_cache(maxsize=1)
def all_scenarios() -> dict[str, Scenario]:
    """Scenarios by name, the default first."""
    scenarios = (
        _intelsat_14(),
        _cluster(),
        _low_pass(),
        _ses_10(),
        _intelsat_21(),
        _cloud_bank(),
        _empty(),
    )
    return {scenario.name: scenario for scenario in scenarios}


def elements_path() -> Path:
    """Path of the element sets from which the scenarios' satellites are propagated."""
    return resource_path("simulator", "data", "belt_20230622.tle")


@lru_cache(maxsize=1)
def _element_sets() -> dict[int, ElementSet]:
    path = elements_path()
    sets = parse_elements(path.read_text(encoding="ascii"), path.name)
    return {element_set.norad_id: element_set for element_set in sets}


def _belt(
    brightness: Mapping[int, BrightnessHistory] | None = None,
) -> tuple[ScenarioSatellite, ...]:
    """Every geostationary satellite of the catalogue; ``brightness``: of those not steady."""
    return tuple(
        _satellite(norad_id, magnitude, (brightness or {}).get(norad_id, STEADY))
        for norad_id, magnitude in BELT_MAGNITUDES.items()
    )


def _satellite(
    norad_id: int, magnitude: float, brightness: BrightnessHistory = STEADY
) -> ScenarioSatellite:
    return ScenarioSatellite(
        element_set=_element_sets()[norad_id],
        standard_magnitude=magnitude,
        brightness=brightness,
    )


def _intelsat_14() -> Scenario:
    """The paper reports a handful of missed detections and of a loss in the last frames, under a
    clear sky, and does not say why. Here the satellite itself fades: once a slow turn shows
    a side darker by two and a half magnitudes, and after a quarter of an hour it dims for six
    minutes, as a panel does that leaves the mirror; every forty minutes all of it comes again.
    That is a stand-in: nobody measured it, and a satellite in service does not turn like this. A
    star under an end of the streak takes another frame.

    Real objects between 2 and 3 deg away (Intelsat 11, Intelsat 32e, WGS F3, SES 14) are left
    out, so that the sweep can meet only one; the neighbours kept lie beyond its ends.
    """
    fading = BrightnessHistory(
        schedule=((0.0, 0.0), (930.0, 0.0), (1110.0, 5.0), (1260.0, 5.0), (1440.0, 0.0)),
        # Steeper slopes would hide one end of a streak and shift its middle.
        turning=PeriodicFading(
            period_s=600.0, first_s=330.0, depth_mag=2.5, sharpness=3, jitter_s=20.0, last_s=400.0
        ),
        repeats_s=2400.0,
    )
    return Scenario(
        name="intelsat-14",
        title="Intelsat 14, a clear night",
        description="one satellite, found by a sweep of the belt; it fades, is gone, comes back",
        t_start_utc_ns=iso_to_utc_ns("2023-06-23T05:30:00Z"),
        satellites=_belt({36097: fading}),
        target_norad_id=36097,
        target_hour_angle_deg=-41.02,
        start_hour_angle_deg=-39.5,
        start_declination_deg=-4.70,
    )


def _cluster() -> Scenario:
    """Amazonas 2, 3 and 5 at 61.0 W and EchoStar 15, 16 and 18 at 61.3 to 61.8 W: 0.8 deg from the
    first to the last. The sweep's second field has them all.
    """
    return Scenario(
        name="cluster",
        title="Six satellites at 61 to 62 deg west",
        description="six satellites in one field, all of them followed at once",
        t_start_utc_ns=iso_to_utc_ns("2023-06-23T06:00:00Z"),
        satellites=_belt(),
        target_norad_id=41592,
        target_hour_angle_deg=-22.60,
        start_hour_angle_deg=-21.2,
        start_declination_deg=-4.83,
        settings={"aim": {"policy": "group"}},
    )


def _low_pass() -> Scenario:
    """The last stage of the rocket that took Vanguard 2 to orbit in 1959: twenty minutes over Mount
    John in New Zealand, all the way within the shipped stars. It comes by where the telescope
    stares after some 20 s.
    """
    return Scenario(
        name="low-pass",
        title="A rocket of 1959 passes over Mount John",
        description="a low satellite comes by; the telescope leaps ahead of it and waits there",
        t_start_utc_ns=iso_to_utc_ns("2023-06-23T16:31:20Z"),
        satellites=(_satellite(12, 13.3),),
        target_norad_id=12,
        target_hour_angle_deg=None,
        start_hour_angle_deg=11.09,
        start_declination_deg=8.11,
        frames=250,
        site=MOUNT_JOHN,
        settings={
            "exposure": {"exposure_s": 1.0, "cadence_s": 6.0},
            "search": {"pattern": "stay"},
            "leap": {"enabled": True},
        },
    )


def _ses_10() -> Scenario:
    """The paper takes the most confident of two detections. SES-17 is made so faint that its
    confidence is the lower one and not every frame shows it: two equally bright satellites would
    leave to chance which is locked. It begins after a star has passed under the streak of SES-10,
    which would leave the first frame to the rival.
    """
    return Scenario(
        name="ses-10",
        title="SES-10 with SES-17 beside it",
        description="two satellites 0.18 deg apart in one field, the fainter one a rival",
        t_start_utc_ns=iso_to_utc_ns("2023-06-22T07:01:00Z"),
        satellites=_belt(),
        target_norad_id=42432,
        target_hour_angle_deg=-16.26,
        start_hour_angle_deg=-14.8,
        start_declination_deg=-4.81,
    )


def _intelsat_21() -> Scenario:
    """A smooth veil thickens again and again until the confidence is near tau, and one thick
    patch hides the satellite some 150 s after lock.

    Amazonas 6, at the time 1.1 deg west of Intelsat 21, is left out.
    """
    return Scenario(
        name="intelsat-21",
        title="Intelsat 21 through thin clouds",
        description="20 min of thin clouds: up to 2 mag fainter, tracked on; hidden once",
        t_start_utc_ns=iso_to_utc_ns("2023-06-23T06:00:00Z"),
        satellites=_belt(),
        target_norad_id=38749,
        target_hour_angle_deg=-26.39,
        start_hour_angle_deg=-24.9,
        start_declination_deg=-4.80,
        clouds=CloudDeck(
            schedule=(
                (0.0, 0.15),
                (200.0, 0.25),
                (258.0, 0.7),
                (270.0, 7.0),
                (296.0, 7.0),
                (308.0, 0.6),
                (400.0, 1.2),
                (430.0, 2.28),
                (490.0, 2.28),
                (530.0, 0.9),
                (590.0, 0.4),
                (640.0, 2.25),
                (690.0, 2.25),
                (740.0, 0.3),
                (840.0, 1.5),
                (870.0, 2.3),
                (920.0, 2.3),
                (960.0, 0.8),
                (1080.0, 1.9),
                (1100.0, 1.9),
                (1200.0, 0.2),
            ),
            structure=0.03,
        ),
    )


def _cloud_bank() -> Scenario:
    """Intelsat 21 again, and an overcast of ten minutes that lets nothing through."""
    return replace(
        _intelsat_21(),
        name="cloud-bank",
        title="Intelsat 21 behind ten minutes of cloud",
        description="a bank of clouds hides stars and satellite for ten minutes after lock",
        frames=45,
        clouds=CloudDeck(
            schedule=(
                (0.0, 0.05),
                (400.0, 0.1),
                (420.0, 9.0),
                (1020.0, 9.0),
                (1040.0, 0.2),
                (1800.0, 0.1),
            ),
            structure=0.2,
        ),
    )


def _empty() -> Scenario:
    return Scenario(
        name="empty",
        title="Nothing there",
        description="a stretch of the belt without any satellite: nothing may be locked",
        t_start_utc_ns=iso_to_utc_ns("2023-06-23T05:30:00Z"),
        satellites=(),
        target_norad_id=None,
        target_hour_angle_deg=None,
        start_hour_angle_deg=-36.0,
        start_declination_deg=-4.75,
    )
