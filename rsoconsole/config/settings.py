"""The configuration: what an operator may set, validated, with where each value came from.

Defaults describe the paper's telescope. Values come from, weakest first: the defaults, the TOML
file, the environment, the command line. Units are in the names.
"""

import functools
import json
import os
import stat
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, get_args, get_origin

import platformdirs
from pydantic import BaseModel, Field, ValidationError

from rsoconsole.base import (
    ConfigError,
    nearest_name,
    parse_toml,
    plain_fault,
    read_foreign_text,
    system_errors_as,
)
from rsoconsole.config.alerts import AlertsConfig
from rsoconsole.config.night import (
    AimConfig,
    CatalogueConfig,
    DetectorConfig,
    FilterConfig,
    LeapConfig,
    OrbitConfig,
    SearchConfig,
    SolverConfig,
)
from rsoconsole.config.observatory import (
    CalibrationConfig,
    ExposureConfig,
    IndiConfig,
    InstrumentsConfig,
    LimitsConfig,
    MountConfig,
    OpticsConfig,
    Section,
    SiteConfig,
    WaitsConfig,
)

PREFIX, BETWEEN = "RSOCONSOLE_", "__"
OTHERS = (
    "RSOCONSOLE_CONFIG",  # where the file is
    "RSOCONSOLE_AARCH64",  # of the tests
    "RSOCONSOLE_TEST_INDEX",
    "RSOCONSOLE_WRITE_SNAPSHOTS",
)
"""Variables that are no settings."""


class VariableError(ConfigError):
    """An environment variable that cannot be read; its value may be secret and is not shown."""

    def __init__(self, variable: str) -> None:
        super().__init__(f'{variable} is no JSON: a list is ["one", "two"], a table {{"name": 1}}')
        self.variable = variable


def environment_name(name: str) -> str:
    """Return a setting's environment variable, e.g. RSOCONSOLE_SITE__LATITUDE_DEG."""
    return PREFIX + name.replace(".", BETWEEN).upper()


def environment_settings(
    model: type[BaseModel], environ: Mapping[str, str]
) -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) of each setting in ``environ``, in the model's order.

    Raises VariableError for a value that is not valid JSON.
    """
    names = [name for name in _names(model) if environ.get(environment_name(name))]
    if not names:
        return
    # A sixth of a second, spent where somebody has set a variable.
    from pydantic_settings import EnvSettingsSource, SettingsError

    settings = _settings_of(model)
    for name in names:
        variable = environment_name(name)
        section, _, key = name.partition(".")
        source = EnvSettingsSource(
            settings, env_prefix=PREFIX, env_nested_delimiter=BETWEEN, env_parse_none_str="null"
        )
        text = environ[variable]
        if _is_list(model, section, key) and not text.lstrip().startswith("[") and text != "null":
            text = json.dumps([text])
        source.env_vars = {variable.lower(): None if text == "null" else text}
        try:
            value = source()[section][key]
        except (SettingsError, KeyError) as error:
            raise VariableError(variable) from error
        yield name, value


def overriding_variables(names: Iterable[str], environ: Mapping[str, str]) -> list[str]:
    """Return the environment variables set for these settings; they override the file."""
    return [each for each in map(environment_name, names) if environ.get(each)]


def environment_warnings() -> Iterator[str]:
    """Yield a line, with the likely name, for each unknown RSOCONSOLE_ variable."""
    known = {_plain(each): each for each in (*map(environment_name, _names(Config)), *OTHERS)}
    for variable in sorted(os.environ):
        if variable.startswith(PREFIX) and variable not in known.values():
            near = nearest_name(_plain(variable), known)
            meant = f"did you mean {known[near]}?" if near else "'rsoconsole config show' has all"
            yield f"the environment variable {variable} does nothing: {meant}"


def _plain(variable: str) -> str:
    return variable.removeprefix(PREFIX).replace(BETWEEN, ".").lower()


def section_classes(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """Return the classes of a configuration model's sections, by the sections' names."""
    return {
        name: info.annotation
        for name, info in model.model_fields.items()
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel)
    }


def _names(model: type[BaseModel]) -> Iterator[str]:
    for name, section in section_classes(model).items():
        yield from (f"{name}.{key}" for key in section.model_fields)


def _is_list(model: type[BaseModel], section: str, key: str) -> bool:
    annotation = section_classes(model)[section].model_fields[key].annotation
    options = get_args(annotation) if get_origin(annotation) is types.UnionType else (annotation,)
    return any(get_origin(each) in (tuple, list) for each in options)


@functools.cache
def _settings_of(model: type[BaseModel]) -> Any:
    """The same fields, as pydantic-settings reads variables into them."""
    from pydantic import create_model
    from pydantic_settings import BaseSettings

    fields: Any = {name: (info.annotation, None) for name, info in model.model_fields.items()}
    return create_model("Variables", __base__=BaseSettings, **fields)


APP = "rsoconsole"
INIT_WRITES = "'rsoconsole config init' writes one"


class ApproachAlertConfig(Section):
    """Close approaches of two satellites of which the operator is warned."""

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


class ConsoleConfig(Section):
    """How the console looks, and for which events it rings or notifies."""

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


class SessionConfig(Section):
    """Where sessions are kept, and which frames' pixels."""

    root: Path = Path(platformdirs.user_data_path(APP)) / "sessions"
    keep_frames: Literal["all", "detected", "last", "none"] = Field(
        "all", description="whose pixels are kept; last: of the last 12 frames alone"
    )


class Config(Section):
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
    alert: ApproachAlertConfig = ApproachAlertConfig()
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
    """Return the user's state folder, kept after logout: ledgers, rescues, mount locks."""
    return platformdirs.user_state_path(APP)


def runtime_dir() -> Path:
    """Return the folder of the control socket, made if missing; only its owner can enter it.

    It lies in ``$XDG_RUNTIME_DIR`` where that is set and writable, else in the user's cache; a
    shared temporary folder would be unsafe. Raises ConfigError where neither can be written, and
    where the folder belongs to another user, also when run as root.
    """
    given = os.environ.get("XDG_RUNTIME_DIR")
    cache = Path(platformdirs.user_cache_path(APP)) / "run"
    path = Path(given) / APP if given else cache
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        path = cache
        behind = "): make ~/.cache writable, or set XDG_RUNTIME_DIR to a folder of your own"
        with system_errors_as(
            ConfigError, f"no folder for the engine's socket can be made ({path}: ", behind
        ):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
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


def load_config(
    path: Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    environ: Mapping[str, str] | None = None,
) -> Config:
    """Read and validate a configuration.

    ``path`` None means the default path, where a missing file is fine. ``overrides`` maps dotted
    names to values, e.g. ``{"detector.tau": 0.2}``. ``environ``: environment variables, which
    override the file; None: the process's own; empty: the file alone. Raises ConfigError with
    every fault.
    """
    given = ConfigLayers.read(path, overrides, environ)
    try:
        return Config.model_validate(given.table)
    except ValidationError as error:
        faults = [
            (".".join(map(str, fault["loc"])), plain_fault(fault["msg"]))
            for fault in error.errors()
        ]
        said = "; ".join(f"{given.variables.get(name, name)}: {words}" for name, words in faults)
        is_of_environment = all(name in given.variables for name, _ in faults)
        where = "the environment" if is_of_environment else str(given.source)
        raise ConfigError(f"{where}: {said}") from error


@dataclass(frozen=True, slots=True)
class ConfigLayers:
    """Settings before validation, by origin: file, environment, overrides."""

    source: Path
    in_file: Mapping[str, Any]
    variables: Mapping[str, str]
    """Settings that the environment has the last word on, dotted: the variable of each."""
    table: dict[str, Any]
    """All together."""

    @classmethod
    def read(
        cls,
        path: Path | None,
        overrides: Mapping[str, Any] | None = None,
        environ: Mapping[str, str] | None = None,
    ) -> Self:
        """Read the layers, with the arguments of ``load_config``. Raises ConfigError."""
        source = path or default_config_path()
        in_file = read_toml(source) if path is not None or source.exists() else {}
        table = {k: dict(v) if isinstance(v, dict) else v for k, v in in_file.items()}
        given = environment_settings(Config, os.environ if environ is None else environ)
        of_environment = dict(given)
        for dotted, value in {**of_environment, **(overrides or {})}.items():
            section, _, key = dotted.partition(".")
            if not isinstance(table.setdefault(section, {}), dict):
                continue
            table[section][key] = value
            if value is None and dotted in of_environment:
                del table[section][key]
        variables = {
            name: environment_name(name) for name in of_environment if name not in (overrides or {})
        }
        return cls(source, in_file, variables, table)


def with_setting(config: Config, name: str, value: Any) -> Config:
    """Return the configuration with the setting ``name`` (dotted) at another value.

    Raises ConfigError where there is no such setting, and where it cannot have that value.
    """
    table = config.model_dump()
    section, _, key = name.partition(".")
    if key not in table.get(section, {}):
        raise ConfigError(
            unknown_setting_words(name, (each for each, _, _ in every_setting(config)))
        )
    table[section][key] = value
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        raise ConfigError(f"{name} = {value}: {plain_fault(error.errors()[0]['msg'])}") from error


def with_changes(config: Config, changes: Mapping[str, Any]) -> Config:
    """Return the configuration with several settings, by dotted names, at other values.

    Raises ConfigError as ``with_setting`` does.
    """
    for name, value in changes.items():
        config = with_setting(config, name, value)
    return config


def environment_overrides() -> list[str]:
    """Return the environment variables that override a setting in this process."""
    return overriding_variables(_names(Config), os.environ)


def unknown_setting_words(name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown setting, with the name that was probably meant."""
    near = nearest_name(name, known)
    remedy = f"did you mean {near}?" if near else "'rsoconsole config show' lists them"
    return f"there is no setting {name!r}: {remedy}"


def read_toml(path: Path, absent: str = INIT_WRITES, holds: str = "") -> dict[str, Any]:
    """Read a TOML file as a dict.

    Raises ConfigError; ``absent``: remedy in its message for a missing file, ``holds``: words on
    the expected content for an unreadable one.
    """
    try:
        return parse_toml(read_foreign_text(path))
    except FileNotFoundError as error:
        raise ConfigError(f"{path} does not exist: {absent}") from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read as TOML ({error}){holds}") from error


def every_setting(config: Config) -> Iterator[tuple[str, Any, str]]:
    """Every setting as (dotted name, value, description), in order."""
    for section_name in type(config).model_fields:
        section = getattr(config, section_name)
        for key, info in type(section).model_fields.items():
            yield f"{section_name}.{key}", getattr(section, key), info.description or ""
