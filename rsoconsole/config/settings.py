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
    nearest,
    plain_fault,
    read_foreign,
    system_errors_as,
    toml_of,
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
    """A variable that cannot be read; its value may be a secret, and is not in the words."""

    def __init__(self, variable: str) -> None:
        super().__init__(f'{variable} is no JSON: a list is ["one", "two"], a table {{"name": 1}}')
        self.variable = variable


def variable_of(name: str) -> str:
    """The variable of a setting, of ``site.latitude_deg`` RSOCONSOLE_SITE__LATITUDE_DEG."""
    return PREFIX + name.replace(".", BETWEEN).upper()


def environment_settings(
    model: type[BaseModel], environ: Mapping[str, str]
) -> Iterator[tuple[str, Any]]:
    """(dotted name, value) of each setting that a variable gives, in the order of the model.

    Raises VariableError for JSON that is none.
    """
    names = [name for name in _names(model) if environ.get(variable_of(name))]
    if not names:
        return
    # A sixth of a second, spent where somebody has set a variable.
    from pydantic_settings import EnvSettingsSource, SettingsError

    settings = _settings_of(model)
    for name in names:
        variable = variable_of(name)
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


def active_variables(names: Iterable[str], environ: Mapping[str, str]) -> list[str]:
    """The variables of these settings that are set: what a file says of them does not count."""
    return [each for each in map(variable_of, names) if environ.get(each)]


def environment_warnings() -> Iterator[str]:
    """For each variable that looks like a setting and is none, a line with the one meant."""
    known = {_plain(each): each for each in (*map(variable_of, _names(Config)), *OTHERS)}
    for variable in sorted(os.environ):
        if variable.startswith(PREFIX) and variable not in known.values():
            near = nearest(_plain(variable), known)
            meant = f"did you mean {known[near]}?" if near else "'rsoconsole config show' has all"
            yield f"the environment variable {variable} does nothing: {meant}"


def _plain(variable: str) -> str:
    return variable.removeprefix(PREFIX).replace(BETWEEN, ".").lower()


def sections_of(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """The classes of its sections, by their names."""
    return {
        name: info.annotation
        for name, info in model.model_fields.items()
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel)
    }


def _names(model: type[BaseModel]) -> Iterator[str]:
    for name, section in sections_of(model).items():
        yield from (f"{name}.{key}" for key in section.model_fields)


def _is_list(model: type[BaseModel], section: str, key: str) -> bool:
    annotation = sections_of(model)[section].model_fields[key].annotation
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


class AlertConfig(Section):
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


class ConsoleConfig(Section):
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


class SessionConfig(Section):
    """Where sessions are kept and what of the frames."""

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

    ``path`` None means the default place, where a missing file is fine. ``overrides`` maps
    dotted names to values, e.g. ``{"detector.tau": 0.2}``. ``environ``: variables that count more
    than the file (see ``environment.py``); None: the process's own; empty: what the file says.
    Raises ConfigError with every fault.
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
    """The settings that are given, not yet validated, by where they come from."""

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
            name: variable_of(name) for name in of_environment if name not in (overrides or {})
        }
        return cls(source, in_file, variables, table)


def with_setting(config: Config, name: str, value: Any) -> Config:
    """The configuration with one setting, by its dotted name, at another value.

    Raises ConfigError where there is no such setting, and where it cannot have that value.
    """
    table = config.model_dump()
    section, _, key = name.partition(".")
    if key not in table.get(section, {}):
        raise ConfigError(unknown_setting(name, (each for each, _, _ in every_setting(config))))
    table[section][key] = value
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        raise ConfigError(f"{name} = {value}: {plain_fault(error.errors()[0]['msg'])}") from error


def with_changes(config: Config, changes: Mapping[str, Any]) -> Config:
    """The configuration with settings, by their dotted names, at other values.

    Raises ConfigError as ``with_setting`` does.
    """
    for name, value in changes.items():
        config = with_setting(config, name, value)
    return config


def variables_set() -> list[str]:
    """The environment variables that set something."""
    return active_variables(_names(Config), os.environ)


def unknown_setting(name: str, known: Iterable[str]) -> str:
    """The fault of a name that is no setting, with the name that was probably meant."""
    near = nearest(name, known)
    remedy = f"did you mean {near}?" if near else "'rsoconsole config show' lists them"
    return f"there is no setting {name!r}: {remedy}"


def read_toml(path: Path, absent: str = INIT_WRITES, holds: str = "") -> dict[str, Any]:
    """A TOML file as a dict. Raises ConfigError with what to do, and with what it should hold."""
    try:
        return toml_of(read_foreign(path))
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
