"""Worlds as TOML files: read with every fault named, written so that they read back the same."""

import difflib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from rsoconsole.config import limits_of, read_toml
from rsoconsole.errors import ConfigError
from rsoconsole.simulator.world.world import World

_SETTINGS = "settings such as [stars] drift_px = 12"
WHERE = "rsoconsole/simulator/README.md lists all settings"


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldSetting:
    """One setting as the documentation tells it."""

    name: str
    """Dotted, e.g. ``stars.drift_px``."""
    unit: str
    default: str
    """In words; what holds where it is not set."""
    limits: str
    description: str


def load_world(path: Path) -> World:
    """The world of a TOML file. Raises ConfigError that names every fault and its remedy."""
    table = read_toml(
        path,
        f"name a TOML file with {_SETTINGS}, or take --world random",
        f": it holds sections and {_SETTINGS}",
    )
    return world_from(table, source=str(path))


def world_from(table: Mapping[str, Any], source: str = "the world") -> World:
    """A world from the settings that it names. Raises ConfigError."""
    try:
        return World.model_validate(table)
    except ValidationError as error:
        faults = "; ".join(_fault_words(dict(fault)) for fault in error.errors())
        raise ConfigError(f"{source}: {faults}") from error


def world_to_toml(world: World) -> str:
    """The settings that differ from their defaults, as TOML that ``load_world`` reads back."""
    lines: list[str] = []
    for section, settings in world.named().items():
        lines += [f"[{section}]", *(f"{key} = {_toml(value)}" for key, value in settings.items())]
        lines.append("")
    return "\n".join(lines)


def settings_of_worlds() -> Iterator[WorldSetting]:
    """Every setting there is, in order."""
    for section, section_field in World.model_fields.items():
        part = section_field.annotation
        assert isinstance(part, type)
        assert issubclass(part, BaseModel)
        for key, info in part.model_fields.items():
            extra = info.json_schema_extra
            assert isinstance(extra, dict)
            default = extra["own"] if info.default is None else _toml(info.default)
            yield WorldSetting(
                name=f"{section}.{key}",
                unit=str(extra["unit"]),
                default=str(default),
                limits=limits_of(info),
                description=info.description or "",
            )


def _toml(value: Any) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value)
    return (
        f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else repr(value)
    )


def _fault_words(fault: Mapping[str, Any]) -> str:
    place = [str(part) for part in fault["loc"]]
    name = ".".join(place)
    known = {setting.name: setting for setting in settings_of_worlds()}
    if fault["type"] == "extra_forbidden":
        return f"there is no {_kind(place)} {name!r}: {_nearest(place, list(known))}"
    if name not in known:
        return f"{name} is a section: write [{name}] above its settings"
    limits = known[name].limits
    allowed = f"allowed: {limits} {known[name].unit}".rstrip() if limits else fault["msg"]
    return f"{name} = {fault.get('input')!r} cannot be; {allowed}"


def _kind(place: list[str]) -> str:
    return "section" if len(place) == 1 else "setting"


def _nearest(place: list[str], known: list[str]) -> str:
    """The name that was meant; a setting in the wrong section is found by its own name."""
    if len(place) == 1:
        names = list(World.model_fields)
        at_top = [name for name in known if name.partition(".")[2] == place[0]]
        near = at_top or difflib.get_close_matches(place[0], names, n=1)
    else:
        elsewhere = [name for name in known if name.partition(".")[2] == place[1]]
        near = elsewhere or difflib.get_close_matches(".".join(place), known, n=1, cutoff=0.5)
    if not near:
        return WHERE
    section, _, key = near[0].partition(".")
    return f"did you mean [{section}]{' ' if key else ''}{key}? {WHERE}"
