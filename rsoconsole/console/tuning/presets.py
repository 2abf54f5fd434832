"""Tunings by name, kept beside the configuration."""

import re
from collections.abc import Mapping
from pathlib import Path

from rsoconsole.config import Config, toml_value, with_setting
from rsoconsole.console.tuning.tuning_pane import NAMES, Value
from rsoconsole.durable_files import write_durably
from rsoconsole.errors import ConfigError, said_as
from rsoconsole.foreign_text import read_foreign, toml_of

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}")

NAMING = "letters, digits, blanks and . _ -"


def load_presets(path: Path) -> dict[str, dict[str, Value]]:
    """Every preset by its name; none without a file. Raises ConfigError for one that is no such."""
    try:
        table = toml_of(read_foreign(path))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    presets: dict[str, dict[str, Value]] = {}
    for name, settings in table.items():
        if not isinstance(settings, dict) or not set(settings) <= set(NAMES):
            raise ConfigError(f"{path}: preset {name!r} may only set {', '.join(NAMES)}")
        if not _NAME.fullmatch(name):
            raise ConfigError(f"{path}: {name!r} is no name for a preset: {NAMING}")
        for key, value in settings.items():
            _expect_value(path, name, key, value)
        presets[name] = settings
    return presets


def save_preset(path: Path, name: str, settings: Mapping[str, Value | None]) -> None:
    """Add one, or put it in the place of another of that name.

    Raises ConfigError for a name that cannot be, and where the file cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"{name!r} is no name for a preset: {NAMING}")
    presets = load_presets(path)
    presets[name] = {key: value for key, value in settings.items() if value is not None}
    lines: list[str] = []
    for each, values in sorted(presets.items()):
        lines.append(f'["{each}"]')
        lines += [f'"{key}" = {toml_value(value)}' for key, value in sorted(values.items())]
        lines.append("")
    with said_as(ConfigError, f"{path} cannot be written: "):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, "\n".join(lines).encode())


def _expect_value(path: Path, preset: str, name: str, value: object) -> None:
    """Raises ConfigError for a value that the setting cannot have."""
    if isinstance(value, bool):
        raise ConfigError(f"{path}: preset {preset!r}: {name} = {value} is no number")
    try:
        with_setting(Config(), name, value)
    except ConfigError as error:
        raise ConfigError(f"{path}: preset {preset!r}: {error}") from error
