"""No two files need each other, not even for a type or within a function."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rsoconsole", "models")


def modules() -> dict[str, Path]:
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def needed_by(path: Path, known: dict[str, Path]) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inside = f"{node.module}.{alias.name}"
                yield inside if inside in known else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def circle_in(needs: dict[str, set[str]]) -> list[str]:
    """One after another; empty where there is none."""
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_files_need_each_other_in_no_circle() -> None:
    known = modules()
    assert len(known) > 500
    needs = {name: set(needed_by(path, known)) & known.keys() for name, path in known.items()}
    assert circle_in(needs) == []


@pytest.mark.parametrize(
    "closing", ["if TYPE_CHECKING:\n    from models.a import A", "def f():\n    import models.a"]
)
def test_one_would_be_seen(closing: str, tmp_path: Path) -> None:
    texts = {"models.a": "from models.b import B", "models.b": closing}
    known = {}
    for name, text in texts.items():
        known[name] = tmp_path / f"{name}.py"
        known[name].write_text(text, encoding="utf-8")
    needs = {name: set(needed_by(path, known)) & known.keys() for name, path in known.items()}
    assert set(circle_in(needs)) == {"models.a", "models.b"}
