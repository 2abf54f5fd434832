"""The page on the program's JSON, read back: what it says of a verb's object."""

import re
from collections.abc import Mapping
from typing import Any

from rsoconsole.base import resource_path
from rsoconsole.cli.words.output import WITH_UNITS

PAGE = resource_path("cli", "JSON.md").read_text(encoding="utf-8")


def tables() -> list[list[tuple[str, str]]]:
    """The rows of each table, without head."""
    found: list[list[tuple[str, str]]] = [[]]
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            found.append([])
        elif not set(line) <= set("|-"):
            found[-1].append((cells[0], cells[1]))
    return [table[1:] for table in found if table]


def first_keys() -> dict[str, str]:
    """First key -> the one with its unit, as the page has them."""
    return {old.strip("`"): new.strip("`") for old, new in tables()[0]}


def keys_of(verb: str) -> set[str]:
    """What the page says that a verb's object has, all in all."""
    for verbs, keys in tables()[1]:
        if verb in re.findall(r"`([^`]+)`", verbs):
            named = {key.strip() for key in keys.strip("`").split(",")}
            return named | {WITH_UNITS[key] for key in named & WITH_UNITS.keys()} | {"schema"}
    raise AssertionError(f"JSON.md has no {verb}")


def expect_documented(verb: str, told: Mapping[str, Any]) -> None:
    """An object that a verb printed has the keys of the page, and no others."""
    assert set(told) == keys_of(verb), verb
