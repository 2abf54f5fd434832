"""Settings put into a configuration file; its comments, its order and all else in it stay.

What comes out must read as what went in with just these settings changed: a form that this cannot
handle is refused, never written over.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import ValidationError
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, Item, Key, Table, Whitespace

from rsoconsole.config.file import initial_config_text, toml_value
from rsoconsole.config.settings import Config
from rsoconsole.durable_files import write_durably
from rsoconsole.errors import ConfigError, said_as
from rsoconsole.fault_text import plain_fault
from rsoconsole.foreign_text import read_foreign, toml_of

_TABLES = (Table, AoT, OutOfOrderTableProxy)
"""What has lines of its own; an inline table is a value like any other."""
_Body = list[tuple[Key | None, Item]]
"""What stands in a table, line by line: settings, comments, empty lines."""


def write_settings(path: Path, settings: Mapping[str, Any], *, is_secret: bool = False) -> None:
    """Set ``settings``, by dotted names such as ``catalogue.gate_deg``, in a configuration file.

    A value is what TOML carries; a sequence of mappings becomes ``[[section.key]]`` blocks at the
    end of the file, in place of those that are there; None takes a setting away. A file that is not
    there is made, with every setting commented, for its owner alone. ``is_secret``: one that is
    there is its owner's alone from now on, too. Raises ConfigError where the file cannot be read,
    edited or written, and where the result is no sound configuration; it is as it was then.
    """
    try:
        before = read_foreign(path) if path.exists() else initial_config_text()
        after = with_settings(before, settings)
        Config.model_validate(toml_of(after))
    except ValidationError as error:
        fault = error.errors()[0]
        what = f"{'.'.join(map(str, fault['loc']))}: {plain_fault(fault['msg'])}"
        raise ConfigError(
            f"{path} is not sound, nothing is written: {what}; see 'rsoconsole config check'"
        ) from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be written to as it is: {error}") from error
    with said_as(ConfigError, f"{path} cannot be written: "):
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


def with_settings(text: str, settings: Mapping[str, Any]) -> str:
    """The text of a TOML file with these settings; see ``write_settings``.

    Raises ValueError where it is no TOML, and where a setting stands in a form that this cannot
    change.
    """
    wanted = toml_of(text)
    text = text.rstrip() + "\n"
    for name, value in settings.items():
        section, _, key = name.partition(".")
        table = wanted.setdefault(section, {})
        if not isinstance(table, dict):
            raise ValueError(f"{section} is no section")
        table.pop(key, None)
        if value is not None:
            table[key] = toml_of(f"it = {toml_value(value)}")["it"]
    try:
        for name, value in settings.items():
            section, _, key = name.partition(".")
            text = _with_setting(text, section, key, value)
        is_right = _filled(toml_of(text)) == _filled(wanted)
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
