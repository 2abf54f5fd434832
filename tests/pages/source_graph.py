"""The program's files, and which of them needs which: read from the source, nothing is run."""

import ast
import functools
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("rsoconsole", "models")


@dataclass(frozen=True)
class Import:
    """``from module import name``."""

    importer: str
    module: str
    name: str


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Every file by its dotted name; a package by its own."""
    found = {}
    for package in PACKAGES:
        for path in (root / package).rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def package_of(module: str, known: dict[str, Path]) -> str:
    """The package in whose folder a module lies; a package is its own."""
    return module if known[module].name == "__init__.py" else module.rpartition(".")[0]


@functools.cache
def door(package: Path) -> dict[str, str]:
    """What a package's front door hands on: each name with the file it comes from.

    A file that is handed on whole has its own name. Empty where there is no door.
    """
    stub = package.with_suffix(".pyi")
    if not stub.exists():
        return {}
    return {
        alias.name: node.module or alias.name
        for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def imports(module: str, path: Path) -> list[Import]:
    """Every one, also for types alone or within a function."""
    text = path.read_text(encoding="utf-8")
    return list(_imports(module, text, is_package=path.name == "__init__.py"))


@functools.cache
def _imports(module: str, text: str, *, is_package: bool) -> tuple[Import, ...]:
    found: list[Import] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            source = _source(node, module, is_package=is_package)
            found += [Import(module, source, alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            found += [Import(module, alias.name, "") for alias in node.names]
    return tuple(found)


def _source(node: ast.ImportFrom, module: str, *, is_package: bool) -> str:
    """What it imports from, by its whole name: one dot is the importer's own folder."""
    if not node.level:
        return node.module or ""
    parts = module.split(".")
    folder = parts[: len(parts) - node.level + is_package]
    return ".".join([*folder, *([node.module] if node.module else [])])


def needs(known: dict[str, Path]) -> dict[str, set[str]]:
    """Which files each needs; through a front door the file behind it."""
    doors = {name: door(path) for name, path in known.items() if path.name == "__init__.py"}
    found: dict[str, set[str]] = {}
    for module, path in known.items():
        found[module] = set()
        for each in imports(module, path):
            inside = f"{each.module}.{each.name}"
            behind = doors.get(each.module, {}).get(each.name)
            if behind is not None:
                inside = f"{each.module}.{behind}"
            found[module].add(inside if inside in known else each.module)
        found[module] &= known.keys()
    return found


def circle_in(graph: dict[str, set[str]]) -> list[str]:
    """One after another; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []
