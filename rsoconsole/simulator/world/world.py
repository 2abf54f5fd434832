"""Settings of a simulated night's imperfections, each with its name and unit.

A world without settings leaves the scenario unchanged, bit for bit. ``load_world`` and
``world_to_toml`` read and write worlds as TOML; ``world_laws.random_world`` draws them.
"""

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from rsoconsole.base import ConfigError
from rsoconsole.config import allowed_words, read_toml


def _setting(default: Any, unit: str, description: str, *, own: str = "", **limits: Any) -> Any:
    """A field with its unit; ``own``: what holds where it is not set, in words."""
    return Field(
        default, description=description, json_schema_extra={"unit": unit, "own": own}, **limits
    )


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class ShutterWorld(_Part):
    """Errors of the shutter's opening relative to DATE-OBS in the header."""

    scatter_s: float | None = _setting(
        None, "s", "one sigma of the opening from frame to frame", own="0.015", ge=0, le=10
    )
    latency_s: float = _setting(
        0.0,
        "s",
        "it opens this much after DATE-OBS; the demo's operator knows it to 0.1 s",
        ge=0,
        le=10,
    )
    bias_s: float = _setting(
        0.0, "s", "and this much later still, which nobody knows", ge=-10, le=10
    )
    line_time_us: float = _setting(
        0.0, "µs", "rolling shutter: each row is exposed so much after the row above", ge=0, le=1000
    )
    round_s: float = _setting(
        0.0,
        "s",
        "DATE-OBS is cut down to whole multiples of this; 1: a camera that writes whole seconds",
        ge=0,
        le=60,
    )


class SeeingWorld(_Part):
    """Blur and motion of the image by the air."""

    fwhm_arcsec: float | None = _setting(
        None, "arcsec", "of stars at the zenith, optics included", own="2.8", ge=0.5, le=30
    )
    drift_percent_h: float = _setting(
        0.0, "%/h", "how much wider the disc becomes in an hour", ge=-20, le=200
    )
    image_motion_arcsec: float = _setting(
        0.0,
        "arcsec",
        "one sigma on each axis by which the whole image dances; correlated over 0.05 s, so that"
        " long exposures average it",
        ge=0,
        le=20,
    )


class FocusWorld(_Part):
    """Defocus of the telescope."""

    ring_px: float = _setting(
        0.0, "px", "radius of the ring that a point out of focus becomes", ge=0, le=40
    )


class StarsWorld(_Part):
    """Tracking errors of the mount, which move stars and satellites alike."""

    drift_px: float = _setting(
        0.0, "px per 10 s", "polar error: every star trails so far", ge=0, le=200
    )
    drift_angle_deg: float = _setting(
        90.0, "deg", "which way it trails: 0 along the rows, 90 down the columns", ge=-360, le=360
    )
    periodic_arcsec: float = _setting(
        0.0, "arcsec", "amplitude of the worm's periodic error in right ascension", ge=0, le=300
    )
    periodic_s: float = _setting(480.0, "s", "its period", ge=1, le=7200)


class WindWorld(_Part):
    """Shaking of the telescope by the wind."""

    rms_px: float = _setting(
        0.0, "px", "on each axis; correlated over 0.3 s, shared by all that is seen", ge=0, le=30
    )


class SensorWorld(_Part):
    """Noise, defects and format of the camera's sensor."""

    row_noise_sigma: float = _setting(
        0.0, "pixel noises", "one sigma of an offset of each row, new in every frame", ge=0, le=20
    )
    column_noise_sigma: float = _setting(
        0.0,
        "pixel noises",
        "one sigma of an offset of each column, the same all night",
        ge=0,
        le=20,
    )
    glow_e_s: float = _setting(
        0.0,
        "e/s",
        "amplifier glow in the last pixel; falls to 1/e in a tenth of the diagonal",
        ge=0,
        le=1e5,
    )
    hot_fraction: float | None = _setting(
        None, "of all pixels", "hot pixels", own="0.000025", ge=0, le=0.05
    )
    gain_e_adu: float | None = _setting(
        None,
        "e/ADU",
        "electrons in a step of the converter",
        own="full well over all steps: 4.88 with 12 bits",
        gt=0,
        le=1000,
    )
    bits: int = _setting(12, "bits", "of the converter; stored shifted to 16", ge=8, le=16)
    bayer: bool = _setting(False, "", "a colour sensor, RGGB")
    binning: int = _setting(1, "px", "pixels joined on each axis", ge=1, le=4)


class ClockWorld(_Part):
    """Error of the observatory's clock relative to UTC."""

    offset_s: float = _setting(
        0.0, "s", "true UTC minus the observatory's clock at the start", ge=-600, le=600
    )
    drift_ppm: float = _setting(0.0, "ppm", "by which that grows", ge=-10000, le=10000)


class OpticsWorld(_Part):
    """Deviations of the telescope from its configuration."""

    scale_error: float = _setting(
        0.0, "of the focal length", "true focal length is longer by this share", ge=-0.2, le=0.2
    )
    distortion: float = _setting(
        0.0,
        "of the radius",
        "a corner of the frame lies further out by this share; grows with the radius cubed",
        ge=-0.05,
        le=0.05,
    )
    camera_angle_deg: float | None = _setting(
        None, "deg", "position angle of the array's +y axis", own="1.7", ge=-360, le=360
    )
    rotation_deg_h: float = _setting(
        0.0, "deg/h", "field rotation, within exposures too", ge=-60, le=60
    )


class CatalogueWorld(_Part):
    """Displacements of the stars from their catalogue positions of 1991."""

    drift_arcsec: float = _setting(
        0.0, "arcsec", "by which all of them have moved together", ge=0, le=30
    )
    drift_angle_deg: float = _setting(
        90.0, "deg", "position angle of that: 0 north, 90 east", ge=-360, le=360
    )
    random_arcsec: float | None = _setting(
        None, "arcsec", "one sigma on each axis of each star's own", own="0.45", ge=0, le=30
    )


class MountWorld(_Part):
    """Errors of the mount's pointing after slews, and its sudden shifts."""

    settle_s: float = _setting(
        0.0, "s", "it says that it has arrived, and creeps on for so long", ge=0, le=60
    )
    settle_arcsec: float = _setting(
        60.0, "arcsec", "how far it creeps, both axes together", ge=0, le=3600
    )
    arrival_arcsec: float | None = _setting(
        None, "arcsec", "one sigma of the radial error of each slew", own="15", ge=0, le=3600
    )
    jump_arcsec: float = _setting(
        0.0, "arcsec", "sudden shifts, within exposures or between; they stay", ge=0, le=600
    )
    jump_every_s: float = _setting(600.0, "s", "mean time from one to the next", ge=1, le=86400)


class SatelliteWorld(_Part):
    """Brightness and flashing of all satellites of the night, fading of all or of one of them."""

    fainter_mag: float = _setting(0.0, "mag", "they are fainter than else", ge=-10, le=20)
    flash_period_s: float = _setting(
        0.0, "s", "they flash so often, each in its own phase; 0: steady", ge=0, le=3600
    )
    flash_duty: float = _setting(0.5, "of the period", "how long they are bright", gt=0, le=1)
    flash_depth_mag: float = _setting(5.0, "mag", "by which they are fainter else", ge=0, le=20)
    fade_mag_h: float = _setting(0.0, "mag/h", "they fade", ge=-10, le=60)
    fade_norad: int = _setting(
        0, "", "catalogue number of the only one that fades; 0: all of them", ge=0, le=999_999_999
    )


class CloudsWorld(_Part):
    """Passing banks of clouds; at a rate above 0 they replace the clouds of the scenario."""

    rate_h: float = _setting(0.0, "1/h", "how many banks an hour", ge=0, le=60)
    duration_s: float = _setting(120.0, "s", "how long each one stays", ge=10, le=7200)
    extinction_mag: float = _setting(3.0, "mag", "what each one takes away", ge=0, le=20)


class MoonWorld(_Part):
    """Moonlight in the sky background."""

    brightening_mag: float = _setting(0.0, "mag", "by which the whole sky is brighter", ge=0, le=8)
    gradient: float = _setting(
        0.0, "of the sky", "change of the sky from one side of the frame to the other", ge=0, le=1.5
    )
    gradient_angle_deg: float = _setting(
        0.0, "deg", "towards the Moon: 0 along the rows, 90 down the columns", ge=-360, le=360
    )


class TrafficWorld(_Part):
    """Numbers of aircraft and low satellites that cross the field."""

    aircraft_rate: float = _setting(
        0.0, "a frame", "aircraft: wide trails with strobes, mean number", ge=0, le=10
    )
    low_satellite_rate: float = _setting(
        0.0, "a frame", "low satellites from edge to edge, mean number", ge=0, le=10
    )


class FramesWorld(_Part):
    """Losses and delays of frames between camera and client."""

    dropped_rate: float = _setting(
        0.0, "of all frames", "never delivered, and the driver says nothing", ge=0, le=1
    )
    failed_rate: float = _setting(
        0.0, "of all frames", "not delivered, and the driver says so", ge=0, le=1
    )
    late_rate: float = _setting(0.0, "of all frames", "delivered late", ge=0, le=1)
    late_s: float = _setting(5.0, "s", "how late those are", ge=0, le=600)


class World(_Part):
    """Imperfections of a simulated night, by section; the defaults change nothing."""

    shutter: ShutterWorld = ShutterWorld()
    seeing: SeeingWorld = SeeingWorld()
    focus: FocusWorld = FocusWorld()
    stars: StarsWorld = StarsWorld()
    wind: WindWorld = WindWorld()
    sensor: SensorWorld = SensorWorld()
    clock: ClockWorld = ClockWorld()
    optics: OpticsWorld = OpticsWorld()
    catalogue: CatalogueWorld = CatalogueWorld()
    mount: MountWorld = MountWorld()
    satellite: SatelliteWorld = SatelliteWorld()
    clouds: CloudsWorld = CloudsWorld()
    moon: MoonWorld = MoonWorld()
    traffic: TrafficWorld = TrafficWorld()
    frames: FramesWorld = FramesWorld()

    @property
    def known_latency_s(self) -> float:
        """The shutter's latency as known to the operator: rounded to 0.1 s."""
        return round(self.shutter.latency_s, 1)

    def non_default_settings(self) -> dict[str, dict[str, Any]]:
        """The settings that differ from their defaults, by section."""
        return self.model_dump(exclude_defaults=True)


DEFAULT_WORLD = World()


_SETTINGS = "settings such as [stars] drift_px = 12"
WHERE = "rsoconsole/simulator/README.md lists all settings"


def load_world(path: Path) -> World:
    """The world of a TOML file; raises ConfigError with every fault and its remedy."""
    table = read_toml(
        path,
        f"name a TOML file with {_SETTINGS}, or take --world random",
        f": it holds sections and {_SETTINGS}",
    )
    return world_from(table, source=str(path))


def world_from(table: Mapping[str, Any], source: str = "the world") -> World:
    """The world of a table of settings by section; raises ConfigError.

    ``source``: name of the table in error messages.
    """
    try:
        return World.model_validate(table)
    except ValidationError as error:
        faults = "; ".join(_fault_words(dict(fault)) for fault in error.errors())
        raise ConfigError(f"{source}: {faults}") from error


def world_to_toml(world: World) -> str:
    """The settings that differ from their defaults, as TOML that ``load_world`` reads back."""
    lines: list[str] = []
    for section, settings in world.non_default_settings().items():
        lines += [
            f"[{section}]",
            *(f"{key} = {value_to_toml(value)}" for key, value in settings.items()),
        ]
        lines.append("")
    return "\n".join(lines)


def settings_of_worlds() -> dict[str, FieldInfo]:
    """All settings of worlds in order, by dotted name, e.g. ``stars.drift_px``."""
    found: dict[str, FieldInfo] = {}
    for section, section_field in World.model_fields.items():
        part = section_field.annotation
        assert isinstance(part, type)
        assert issubclass(part, BaseModel)
        found |= {f"{section}.{key}": info for key, info in part.model_fields.items()}
    return found


def unit_of(setting: FieldInfo) -> str:
    """Unit of a setting; empty where it has none."""
    extra = setting.json_schema_extra
    assert isinstance(extra, dict)
    return str(extra["unit"])


def value_to_toml(value: Any) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value)
    return (
        f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else repr(value)
    )


def _fault_words(fault: Mapping[str, Any]) -> str:
    place = [str(part) for part in fault["loc"]]
    name = ".".join(place)
    known = settings_of_worlds()
    if fault["type"] == "extra_forbidden":
        kind = "section" if len(place) == 1 else "setting"
        return f"there is no {kind} {name!r}: {_nearest(place, list(known))}"
    if name not in known:
        return f"{name} is a section: write [{name}] above its settings"
    limits = allowed_words(known[name])
    allowed = f"allowed: {limits} {unit_of(known[name])}".rstrip() if limits else fault["msg"]
    return f"{name} = {fault.get('input')!r} cannot be; {allowed}"


def _nearest(place: list[str], known: list[str]) -> str:
    """The name that was meant; a setting in the wrong section is found by its own name."""
    same_end = [name for name in known if name.partition(".")[2] == place[-1]]
    is_section = len(place) == 1
    names, cutoff = (list(World.model_fields), 0.6) if is_section else (known, 0.5)
    near = same_end or difflib.get_close_matches(".".join(place), names, n=1, cutoff=cutoff)
    if not near:
        return WHERE
    section, _, key = near[0].partition(".")
    return f"did you mean [{section}]{' ' if key else ''}{key}? {WHERE}"
