"""Completion of words on the command line, requested by bash, zsh and fish when TAB is pressed.

Paths other than sessions are left to the shell, which completes folder by folder.
"""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config, every_setting, load_config

Completer = Callable[[Any, str], list[Any]]


def completer_from(find: Callable[[Any], Iterable[Any]]) -> Completer:
    """Return a completer for typer that offers what ``find`` returns.

    ``find`` gets typer's context and returns words or (word, help) pairs. Its errors give no
    completions: a message would disturb the line being typed.
    """

    @functools.wraps(find)
    def complete(ctx: Any, incomplete: str) -> list[Any]:
        try:
            found = list(find(ctx))
        except (RsoconsoleError, OSError, ValueError):
            return []
        return [
            each
            for each in found
            if (each if isinstance(each, str) else each[0]).startswith(incomplete)
        ]

    complete.__annotations__ = {"ctx": Any, "incomplete": str}
    del complete.__wrapped__  # typer looks at the signature
    return complete


def sessions(incomplete: str) -> list[str]:
    """Folders of sessions under the typed path, and those of ``session.root`` by full path."""
    found: list[str] = []
    typed = Path(incomplete)
    home = typed if incomplete.endswith("/") else typed.parent
    try:
        if incomplete:
            before = "" if home == Path() else incomplete[: len(incomplete) - len(typed.name)]
            before = incomplete if incomplete.endswith("/") else before
            found += [f"{before}{each.name}" for each in _sessions_in(home.expanduser())]
        root = load_config().session.root
        found += [str(each) for each in _sessions_in(root)]
    except (RsoconsoleError, OSError, ValueError, RuntimeError):
        return []
    words = dict.fromkeys(each for each in found if each.startswith(incomplete))
    # The shells split what comes at white space.
    return [each for each in words if not any(c.isspace() for c in each)]


def session_names(incomplete: str) -> list[str]:
    """Return matching names of sessions in ``session.root``, else what ``sessions`` returns."""
    try:
        names = [each.name for each in _sessions_in(load_config().session.root)]
    except (RsoconsoleError, OSError):
        names = []
    return [each for each in names if each.startswith(incomplete)] or sessions(incomplete)


presets = completer_from(lambda _: setting_choices("filter.preset"))
map_modes = completer_from(lambda _: setting_choices("detector.map_mode"))


@completer_from
def scenarios(_: Any) -> Iterable[tuple[str, str]]:
    """Scenarios of the demo, each with its title."""
    from rsoconsole.simulator import all_scenarios

    return [(each.name, each.title) for each in all_scenarios().values()]


@completer_from
def setting_names(_: Any) -> Iterable[tuple[str, str]]:
    """Names of all settings, each with its description."""
    return [(name, description) for name, _, description in every_setting(Config())]


@completer_from
def tunable_names(_: Any) -> Iterable[tuple[str, str]]:
    """Settings that can be changed while the engine runs, each with its description."""
    from rsoconsole.engine import TUNABLE

    return [(name, words) for name, _, words in every_setting(Config()) if name in TUNABLE]


@completer_from
def setting_values(ctx: Any) -> Iterable[str]:
    """Values of the setting that the preceding word of the command line names."""
    return setting_choices(str(ctx.params.get("name") or ""))


@completer_from
def checks(_: Any) -> Iterable[str]:
    """Names of the checks that the engine makes before arming."""
    from rsoconsole.engine import CHECKS

    return CHECKS


@completer_from
def branches(ctx: Any) -> Iterable[str]:
    """Branches of the sessions that the command line names so far."""
    found: list[str] = []
    for each in ctx.params.get("sessions") or ():
        found += [path.name for path in sorted((Path(each) / "branches").iterdir())]
    return found


def setting_choices(name: str) -> tuple[str, ...]:
    """Return a setting's allowed words, by dotted name; empty where it has no fixed choice."""
    section, _, key = name.partition(".")
    home = Config.model_fields.get(section)
    if home is None or not isinstance(home.annotation, type):
        return ()
    info = home.annotation.model_fields.get(key) if issubclass(home.annotation, BaseModel) else None
    if info is None:
        return ()
    if info.annotation is bool:
        return ("true", "false")
    kinds = [info.annotation, *get_args(info.annotation)]
    few = next((each for each in kinds if get_origin(each) is Literal), None)
    return tuple(map(str, get_args(few)))


def _sessions_in(folder: Path) -> list[Path]:
    from rsoconsole.session import DATABASE

    if not folder.is_dir():
        return []
    return sorted(each for each in folder.iterdir() if (each / DATABASE).is_file())
