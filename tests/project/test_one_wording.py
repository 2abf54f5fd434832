"""A sentence is built in one room: two rooms that say the same thing call the same words."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator

import pytest

from tests.pages.source_graph import ROOT

PACKAGE = ROOT / "rsoconsole"
WORDS = 5
"""A clause of so many words is no chance."""
_WORD = re.compile(r"[^\W\d_][\w']+")
_BETWEEN_CLAUSES = re.compile(r"[;:,()\n]|\. ")


def clauses(source: str) -> Iterator[str]:
    """What a file's strings say, clause by clause, without docstrings and figures."""
    tree = ast.parse(source)
    silent = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant | ast.JoinedStr)
        for part in ast.walk(node.value)
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in silent
        ):
            for clause in _BETWEEN_CLAUSES.split(node.value):
                words = _WORD.findall(clause)
                if len(words) >= WORDS:
                    yield " ".join(words)


def said_twice(files: dict[str, str]) -> dict[str, list[str]]:
    """Clauses that stand in files of more than one room, each with its files."""
    places: dict[str, set[str]] = defaultdict(set)
    for path, source in files.items():
        for clause in clauses(source):
            places[clause].add(path)
    return {
        clause: sorted(paths)
        for clause, paths in sorted(places.items())
        if len({path.partition("/")[0] for path in paths}) > 1
    }


def test_no_two_rooms_build_the_same_sentence() -> None:
    files = {
        path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8")
        for path in PACKAGE.rglob("*.py")
    }
    assert said_twice(files) == {}


@pytest.mark.parametrize(
    ("one", "other", "is_found"),
    [
        ('x = "the mount does not answer, it is cut off"', 'y = f"{n}: it is cut off"', False),
        ('x = f"the mount at {p} does not answer now"', 'y = f"does not answer now"', False),
        (
            'x = "wait: the mount does not answer now"',
            'y = f"the mount does not answer now; {n}"',
            True,
        ),
        ('"""the mount does not answer now"""', 'y = "the mount does not answer now"', False),
    ],
)
def test_one_that_is_built_twice_would_be_seen(one: str, other: str, *, is_found: bool) -> None:
    assert bool(said_twice({"cli/a.py": one, "engine/b.py": other})) is is_found
    assert said_twice({"cli/a.py": one, "cli/b.py": other}) == {}
