"""Settings put into a configuration file; its comments, its order and all else in it stay.

The file is changed by whole statements (a header, a setting with its value over however many
lines), and what comes out must read as what went in with just these settings changed: a form that
this cannot handle is refused, never written over.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rsoconsole.config.file import initial_config_text, toml_value
from rsoconsole.config.settings import Config
from rsoconsole.durable_files import write_durably
from rsoconsole.errors import ConfigError
from rsoconsole.fault_text import plain_fault
from rsoconsole.foreign_text import read_foreign, toml_of

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTES = ('"""', "'''", '"', "'")


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
    try:
        _replace(path, after, is_secret=is_secret)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror or error}") from error


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
    for name, value in settings.items():
        section, _, key = name.partition(".")
        table = wanted.setdefault(section, {})
        if not isinstance(table, dict):
            raise ValueError(f"{section} is no section")
        table.pop(key, None)
        if value is not None:
            table[key] = toml_of(f"it = {toml_value(value)}")["it"]
        text = _with_setting(text, section, key, value)
    if not _says(text, wanted):
        names = " and ".join(settings)
        raise ValueError(f"{names} cannot be set in the form that the file has: edit it by hand")
    return text


def _says(text: str, wanted: dict[str, Any]) -> bool:
    try:
        return _filled(toml_of(text)) == _filled(wanted)
    except ValueError:
        return False


def _filled(table: dict[str, Any]) -> dict[str, Any]:
    """Without sections that hold nothing."""
    return {key: value for key, value in table.items() if value != {}}


@dataclass(frozen=True, slots=True)
class _Statement:
    """Lines that belong together."""

    kind: str
    """``header``, ``setting`` or ``other``: a comment, an empty line."""
    table: tuple[str, ...]
    """The header that it stands under, or is."""
    key: str
    """Of a setting."""
    lines: tuple[str, ...]


def _statements(text: str) -> Iterator[_Statement]:
    lines = text.split("\n")
    table: tuple[str, ...] = ()
    place = 0
    while place < len(lines):
        line = lines[place]
        stripped = line.strip()
        end = place + 1
        if stripped.startswith("["):
            table = _names(stripped.strip("[ \t"))
            yield _Statement("header", table, "", (line,))
        elif not stripped or stripped.startswith("#"):
            yield _Statement("other", table, "", (line,))
        else:
            while end < len(lines) and _is_open("\n".join(lines[place:end])):
                end += 1
            key = ".".join(_names(stripped))
            yield _Statement("setting", table, key, tuple(lines[place:end]))
        place = end


def _names(text: str) -> tuple[str, ...]:
    """The parts of the dotted key that a text begins with."""
    found: list[str] = []
    while text:
        text = text.lstrip()
        if text[:1] in ('"', "'"):
            end = text.find(text[0], 1)
            if end < 0:
                break
            found.append(text[1:end])
            text = text[end + 1 :]
        elif (bare := _BARE.match(text)) is not None:
            found.append(bare[0])
            text = text[bare.end() :]
        text = text.lstrip()
        if not text.startswith("."):
            break
        text = text[1:]
    return tuple(found)


def _is_open(text: str) -> bool:
    """Whether a value goes on in the next line: a bracket or a string is not closed."""
    depth, place, _ = _scanned(text)
    return depth > 0 or place > len(text)


def _scanned(text: str) -> tuple[int, int, int]:
    """Brackets left open; the place reached, beyond the end inside a string; where a last comment
    begins, -1 without one."""
    depth, place, comment = 0, 0, -1
    while place < len(text):
        char = text[place]
        if char == "#":
            comment = place
            place = text.find("\n", place)
            if place < 0:
                break
            comment = -1
        quote = next((each for each in _QUOTES if text.startswith(each, place)), None)
        if quote is not None:
            place = _after_string(text, place + len(quote), quote)
            continue
        depth += (char in "[{") - (char in "]}")
        place += 1
    return depth, len(text) if place < 0 else place, comment


def _after_string(text: str, place: int, quote: str) -> int:
    """Where a string ends; beyond the text where it does not."""
    while place < len(text):
        if text[place] == "\\" and quote[0] == '"':
            place += 2
        elif text.startswith(quote, place):
            return place + len(quote)
        else:
            place += 1
    return len(text) + 1


def _with_setting(text: str, section: str, key: str, value: Any) -> str:
    kept = [each for each in _statements(text.rstrip("\n")) if not _is_of_block(each, section, key)]
    own = next((n for n, each in enumerate(kept) if _is_own(each, section, key)), None)
    if _is_blocks(value):
        if own is not None:
            del kept[own]
        kept = _with_section(kept, section)
        blocks = [line for each in value for line in ("", *_block(section, key, each))]
        return "\n".join([*_lines(kept), *blocks, ""])
    if value is None:
        if own is not None:
            del kept[own]
        return "\n".join([*_lines(kept), ""])
    if own is not None:
        kept[own] = _replaced(kept[own], value)
        return "\n".join([*_lines(kept), ""])
    kept = _with_section(kept, section)
    line = f"{key} = {toml_value(value)}"
    kept.insert(_place(kept, section, key), _Statement("setting", (section,), key, (line,)))
    return "\n".join([*_lines(kept), ""])


def _is_own(each: _Statement, section: str, key: str) -> bool:
    return each.kind == "setting" and ".".join((*each.table, each.key)) == f"{section}.{key}"


def _is_of_block(each: _Statement, section: str, key: str) -> bool:
    """Whether it is part of ``[[section.key]]``; comments there stay."""
    return each.table[:2] == (section, key) and (each.kind != "other" or not each.lines[0].strip())


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


def _with_section(kept: Sequence[_Statement], section: str) -> list[_Statement]:
    """With a header of that section, at the end where there was none."""
    if any(each.kind == "header" and each.table == (section,) for each in kept):
        return list(kept)
    return [
        *kept,
        _Statement("other", (), "", ("",)),
        _Statement("header", (section,), "", (f"[{section}]",)),
    ]


def _place(kept: Sequence[_Statement], section: str, key: str) -> int:
    """Below the comment that shows its default, else below the section's last setting."""
    shown = re.compile(rf"\s*#\s*{re.escape(key)} (=|is not set)")
    here = [n for n, each in enumerate(kept) if each.table == (section,)]
    commented = [n for n in here if kept[n].kind == "other" and shown.match(kept[n].lines[0])]
    stated = [n for n in here if kept[n].kind != "other"]
    return (commented or stated)[-1] + 1


def _replaced(old: _Statement, value: Any) -> _Statement:
    """Another value behind the same key; a comment behind it stays."""
    text = "\n".join(old.lines)
    at = text.index("=") + 1
    comment = _scanned(text[at:])[2]
    behind = "" if comment < 0 else "  " + text[at:][comment:]
    line = f"{text[:at]} {toml_value(value)}{behind}"
    return _Statement("setting", old.table, old.key, (line,))


def _lines(statements: Sequence[_Statement]) -> list[str]:
    lines = [line for each in statements for line in each.lines]
    while lines and not lines[-1].strip():
        lines.pop()
    return lines
