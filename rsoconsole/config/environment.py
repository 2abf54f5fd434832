"""Settings by environment variables: ``RSOCONSOLE_SITE__LATITUDE_DEG`` is ``site.latitude_deg``.

They count more than the configuration file and less than options. A variable that is set to nothing
is as if it were not set; a list is one value, or JSON (``["a", "b"]``); ``null`` takes a setting
of the file away.
"""

import functools
import json
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from rsoconsole.errors import ConfigError
from rsoconsole.fault_text import nearest

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


@dataclass(frozen=True, slots=True)
class Given:
    """One setting of the environment."""

    variable: str
    name: str
    """Dotted."""
    value: Any
    """Text, or what its JSON says."""


def variable_of(name: str) -> str:
    """The variable of a setting, of ``site.latitude_deg`` RSOCONSOLE_SITE__LATITUDE_DEG."""
    return PREFIX + name.replace(".", BETWEEN).upper()


def given_settings(model: type[BaseModel], environ: Mapping[str, str]) -> Iterator[Given]:
    """The settings that variables give, in the order of the model.

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
            settings,
            env_prefix=PREFIX,
            env_nested_delimiter=BETWEEN,
            env_parse_none_str="null",
        )
        text = environ[variable]
        if _is_list(model, section, key) and not text.lstrip().startswith("[") and text != "null":
            text = json.dumps([text])
        source.env_vars = {variable.lower(): None if text == "null" else text}
        try:
            value = source()[section][key]
        except (SettingsError, KeyError) as error:
            raise VariableError(variable) from error
        yield Given(variable, name, value)


def setting_variables(model: type[BaseModel], environ: Mapping[str, str]) -> list[str]:
    """Those that are set."""
    return hiding_variables(_names(model), environ)


def hiding_variables(names: Iterable[str], environ: Mapping[str, str]) -> list[str]:
    """Which of the settings' variables are set: what a file says of these does not count."""
    return [each for each in map(variable_of, names) if environ.get(each)]


def unknown_variables(model: type[BaseModel], environ: Mapping[str, str]) -> Iterator[str]:
    """For each variable with this program's prefix that it does not know, a line that says so."""
    known = {_plain(each): each for each in (*map(variable_of, _names(model)), *OTHERS)}
    for variable in sorted(environ):
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
