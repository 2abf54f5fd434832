"""The configuration as a file: writing it, the origin of each value, its faults."""

import difflib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import tomlkit
from pydantic import ValidationError
from pydantic.fields import FieldInfo
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, Item, Key, Table, Whitespace

from rsoconsole.base import (
    ConfigError,
    parse_toml,
    plain_fault,
    read_foreign_text,
    system_errors_as,
    write_durably,
)
from rsoconsole.config.observatory import CalibrationConfig
from rsoconsole.config.settings import (
    Config,
    ConfigLayers,
    VariableError,
    default_config_path,
    every_setting,
    load_config,
    section_classes,
)

Origin = Literal["default", "file", "environment", "command line"]
_MAY_BE_SECRET = (
    "alerts.",
    "catalogue.sources",
    "catalogue.celestrak_url",
    "catalogue.space_track_url",
)
"""Settings whose values are never shown."""
_SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One setting in force: its value and the origin of the value."""

    name: str
    """Dotted, e.g. ``detector.tau``."""
    value: Any
    """The value as JSON carries it."""
    origin: Origin
    variable: str | None
    """Environment variable that it came from; None where it did not."""
    description: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigFault:
    """One thing that is wrong with a configuration."""

    name: str
    """Dotted name of the setting, or of its environment variable; empty: the file as a whole."""
    problem: str
    remedy: str


def config_to_toml(config: Config) -> str:
    """Every setting as TOML that ``load_config`` reads back to an equal configuration.

    A setting that is None is left out: TOML has no null.
    """
    lines: list[str] = []
    for section_name, section in config.model_dump(mode="json").items():
        lines.append(f"[{section_name}]")
        lines += [
            f"{key} = {toml_value(value)}" for key, value in section.items() if value is not None
        ]
        lines.append("")
    return "\n".join(lines)


def initial_config_text() -> str:
    """A configuration file with every setting, its default, its limits and its meaning."""
    lines = [
        "# Configuration of rsoconsole. Every line shows a default: take away the '#' before a",
        "# setting to change it. 'rsoconsole config check' tells whether the file is sound.",
    ]
    for section_name, section in section_classes(Config).items():
        lines += ["", f"# {(section.__doc__ or '').strip()}", f"[{section_name}]"]
        defaults = section().model_dump(mode="json")
        for key, info in section.model_fields.items():
            explanation = "; ".join(
                part for part in (info.description, allowed_words(info)) if part
            )
            if explanation:
                lines.append(f"# {explanation}")
            default = defaults[key]
            lines.append(
                f"# {key} is not set" if default is None else f"# {key} = {toml_value(default)}"
            )
    return "\n".join(lines) + "\n"


def write_initial_config(path: Path | None = None, *, force: bool = False) -> Path:
    """Write ``initial_config_text`` to ``path`` (None: the default path); return the path.

    Raises ConfigError when there is a file already and ``force`` is not given, or when the file
    cannot be written.
    """
    target = path or default_config_path()
    if target.exists() and not force:
        raise ConfigError(f"{target} exists already: --force writes over it")
    with system_errors_as(ConfigError, f"{target} cannot be written: "):
        target.parent.mkdir(parents=True, exist_ok=True)
        # It may come to hold an address with a password.
        write_durably(target, initial_config_text().encode(), mode=0o600)
    return target


def effective_settings(
    path: Path | None = None, overrides: Mapping[str, Any] | None = None
) -> tuple[Setting, ...]:
    """Every setting in force, in order, with its origin. Raises ConfigError as load_config does."""
    config = load_config(path, overrides)
    given = ConfigLayers.read(path, overrides)
    values = config.model_dump(mode="json")

    def origin(name: str) -> Origin:
        section, _, key = name.partition(".")
        if name in (overrides or {}):
            return "command line"
        if name in given.variables:
            return "environment" if key in given.table.get(section, {}) else "default"
        return "file" if key in given.in_file.get(section, {}) else "default"

    return tuple(
        Setting(
            name=name,
            value=values[name.partition(".")[0]][name.partition(".")[2]],
            origin=origin(name),
            variable=given.variables.get(name),
            description=description,
        )
        for name, _, description in every_setting(config)
    )


def config_faults(
    path: Path | None = None, overrides: Mapping[str, Any] | None = None
) -> tuple[ConfigFault, ...]:
    """All faults of a configuration, each with its remedy; empty for a sound one."""
    try:
        given = ConfigLayers.read(path, overrides)
    except VariableError as error:
        remedy = "set it so, or unset it"
        return (ConfigFault(name=error.variable, problem=str(error), remedy=remedy),)
    except ConfigError as error:
        remedy = "correct the file, or move it away and begin again"
        return (ConfigFault(name="", problem=str(error), remedy=remedy),)
    try:
        config = Config.model_validate(given.table)
    except ValidationError as error:
        return tuple(_fault(dict(fault), given.variables) for fault in error.errors())
    return tuple(_contradictions(config))


def _contradictions(config: Config) -> Iterator[ConfigFault]:
    """Values that are each allowed but do not go together."""
    if config.exposure.cadence_s < config.exposure.exposure_s:
        yield ConfigFault(
            name="exposure.cadence_s",
            problem=f"{config.exposure.cadence_s:g} s is shorter than one exposure",
            remedy=f"make it at least {config.exposure.exposure_s:g}",
        )
    if config.detector.model is not None and not config.detector.model.exists():
        yield ConfigFault(
            name="detector.model",
            problem=f"{config.detector.model} does not exist",
            remedy="name a .tflite file, or leave the setting out for the shipped network",
        )
    yield from _calibration_faults(config.calibration)


def _calibration_faults(calibration: CalibrationConfig) -> Iterator[ConfigFault]:
    for name, path in calibration.master_files:
        if not path.is_file():
            problem = "is no file" if path.exists() else "does not exist"
            yield ConfigFault(
                name=f"calibration.{name}",
                problem=f"{path} {problem}",
                remedy="name a FITS file, or leave the setting out",
            )
    if calibration.flat is not None and not calibration.darks and calibration.bias is None:
        yield ConfigFault(
            name="calibration.flat",
            problem="a flat alone would divide the camera's offset too, and is not used",
            remedy="name a dark in calibration.darks, or calibration.bias",
        )


def _fault(found: Mapping[str, Any], variables: Mapping[str, str]) -> ConfigFault:
    place = [str(part) for part in found["loc"]]
    name = ".".join(place)
    known = [setting for setting, _, _ in every_setting(Config())]
    if found["type"] == "extra_forbidden":
        names = known if len(place) > 1 else list(Config.model_fields)
        near = difflib.get_close_matches(name, names, n=1)
        remedy = (
            f"did you mean {near[0]}?" if near else "'rsoconsole config show' lists the settings"
        )
        return ConfigFault(name=name, problem=plain_fault(found["msg"]), remedy=remedy)
    given = found.get("input")
    shown_name = variables.get(name, name)
    info = _field(place)
    remedy = f"allowed: {allowed_words(info)}" if info is not None and allowed_words(info) else ""
    if info is not None:
        default = info.get_default(call_default_factory=True)
        remedy += ("; " if remedy else "") + f"the default is {default}"
    words = plain_fault(found["msg"])
    return ConfigFault(
        name=shown_name,
        problem=words if name.startswith(_MAY_BE_SECRET) else f"{given!r}: {words}",
        remedy=remedy or "see 'rsoconsole config init' for the form of the file",
    )


def _field(place: list[str]) -> FieldInfo | None:
    section = section_classes(Config).get(place[0]) if len(place) > 1 else None
    return None if section is None else section.model_fields.get(place[1])


def allowed_words(info: FieldInfo) -> str:
    """The allowed values in words, e.g. ``> 0, < 1`` or ``one of "fast", "paper"``."""
    if get_origin(info.annotation) is Literal:
        return "one of " + ", ".join(json.dumps(choice) for choice in get_args(info.annotation))
    return ", ".join(
        f"{sign} {getattr(limit, name):g}"
        for limit in info.metadata
        for name, sign in _SIGNS.items()
        if hasattr(limit, name)
    )


def toml_value(value: Any) -> str:
    """Return one value, which may be a date, as TOML.

    Raises TypeError for a type that TOML does not have.
    """
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, dict):
        # An inline table; TOML has no word for what is not there.
        pairs = (f"{key} = {toml_value(item)}" for key, item in value.items() if item is not None)
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, bool | int | str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        return repr(value)
    raise TypeError(f"TOML cannot carry a {type(value).__name__}")


_TABLES = (Table, AoT, OutOfOrderTableProxy)
"""Tables with lines of their own; an inline table is a value like any other."""
_Body = list[tuple[Key | None, Item]]
"""The lines of a table: settings, comments, empty lines."""


def write_settings(path: Path, settings: Mapping[str, Any], *, is_secret: bool = False) -> None:
    """Set settings, by dotted names such as ``catalogue.gate_deg``, in a configuration file.

    Values are of types that TOML has; None removes a setting. A sequence of mappings becomes
    ``[[section.key]]`` blocks at the end of the file, which replace the existing ones. A missing
    file is made, with every setting as a comment, readable by its owner alone. ``is_secret``:
    make an existing file readable by its owner alone too. Raises ConfigError, with the file
    unchanged, where it cannot be read, edited or written, and where the result would be no valid
    configuration.
    """
    try:
        before = read_foreign_text(path) if path.exists() else initial_config_text()
        after = toml_text_with_settings(before, settings)
        Config.model_validate(parse_toml(after))
    except ValidationError as error:
        fault = error.errors()[0]
        what = f"{'.'.join(map(str, fault['loc']))}: {plain_fault(fault['msg'])}"
        raise ConfigError(
            f"{path} is not sound, nothing is written: {what}; see 'rsoconsole config check'"
        ) from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be written to as it is: {error}") from error
    with system_errors_as(ConfigError, f"{path} cannot be written: "):
        _replace(path, after, is_secret=is_secret)


def _replace(path: Path, text: str, *, is_secret: bool) -> None:
    """Whole or not at all; a link stays a link, lines end as they did."""
    target = path.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    is_new = not target.exists()
    content = text.encode()
    if not is_new and b"\r\n" in target.read_bytes():
        content = content.replace(b"\n", b"\r\n")
    mode = 0o600 if is_new or is_secret else target.stat().st_mode & 0o777
    write_durably(target, content, mode)


def toml_text_with_settings(text: str, settings: Mapping[str, Any]) -> str:
    """Return the text of a TOML file with these settings changed; see ``write_settings``.

    Raises ValueError where the text is no TOML, and where a setting stands in a form that this
    function cannot change.
    """
    wanted = parse_toml(text)
    text = text.rstrip() + "\n"
    for name, value in settings.items():
        section, _, key = name.partition(".")
        table = wanted.setdefault(section, {})
        if not isinstance(table, dict):
            raise ValueError(f"{section} is no section")
        table.pop(key, None)
        if value is not None:
            table[key] = parse_toml(f"it = {toml_value(value)}")["it"]
    try:
        for name, value in settings.items():
            section, _, key = name.partition(".")
            text = _with_setting(text, section, key, value)
        is_right = _filled(parse_toml(text)) == _filled(wanted)
    except (ValueError, TOMLKitError, RecursionError):  # tomlkit gives up before tomllib does
        is_right = False
    if not is_right:
        names = " and ".join(settings)
        raise ValueError(f"{names} cannot be set in the form that the file has: edit it by hand")
    return text.rstrip() + "\n"


def _filled(table: dict[str, Any]) -> dict[str, Any]:
    """Without sections that hold nothing."""
    return {key: value for key, value in table.items() if value != {}}


def _with_setting(text: str, section: str, key: str, value: Any) -> str:
    document = tomlkit.parse(text)
    # A section may stand in several places: its header, its sub-sections, names with its dot.
    parts = [
        table
        for name, table in document.body
        if name is not None and name.key == section and isinstance(table, Table)
    ]
    for part in parts:
        is_line = key in part and not isinstance(part[key], _TABLES)
        if is_line and value is not None and not _is_blocks(value):
            part[key] = tomlkit.value(toml_value(value))
            return document.as_string()
        _take_away(part.value.body, key)
    if value is None:
        return document.as_string()
    home = next((part.value.body for part in parts if not part.is_super_table()), None)
    if home is None:
        begun = f"{document.as_string().rstrip()}\n\n[{section}]\n"
        return _with_setting(begun, section, key, value)
    if _is_blocks(value):
        blocks = [line for each in value for line in ("", *_block(section, key, each))]
        return "\n".join([document.as_string().rstrip(), *blocks, ""])
    home.insert(_place(home, key), (tomlkit.key(key), tomlkit.value(toml_value(value))))
    return document.as_string()


def _is_blocks(value: Any) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) > 0
        and all(isinstance(each, Mapping) for each in value)
    )


def _block(section: str, key: str, table: Mapping[str, Any]) -> Iterator[str]:
    yield f"[[{section}.{key}]]"
    for name, value in table.items():
        if value is not None:
            yield f"{name} = {toml_value(value)}"


def _take_away(body: _Body, key: str) -> None:
    """Comments in blocks of that name stay."""
    for place, (name, item) in enumerate(body):
        if name is not None and name.key == key:
            left = _comments(item)
            body[place] = (None, tomlkit.ws(left if left.strip() else ""))


def _comments(item: Item) -> str:
    """Those in a table or in blocks, with the empty lines about them."""
    if isinstance(item, Comment | Whitespace):
        return item.as_string()
    tables = item.body if isinstance(item, AoT) else [item] if isinstance(item, Table) else []
    return "".join(_comments(inner) for table in tables for _, inner in table.value.body)


def _place(body: _Body, key: str) -> int:
    """Below the comment that shows its default, else below the last setting."""
    shown = re.compile(rf"#\s*{re.escape(key)} (=|is not set)")
    commented = [
        place
        for place, (_, item) in enumerate(body)
        if isinstance(item, Comment) and shown.match(item.trivia.comment)
    ]
    stated = [
        place
        for place, (name, item) in enumerate(body)
        if name is not None and (name.is_dotted() or not isinstance(item, _TABLES))
    ]
    return max(commented or stated, default=-1) + 1
