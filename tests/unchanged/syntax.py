"""Whether two commits differ by imports and patch paths alone.

    python -m tests.unchanged.syntax BEFORE [AFTER] [FILE...]

Compares the syntax trees of the named files (all Python files that both have, by their names where
they were moved), without imports and with names of modules in strings left out. Prints the files
that differ in more.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

_MODULE = re.compile(r"\b(?:rsoconsole|tests)(?:\.\w+)+")


class _Bare(ast.NodeTransformer):
    """Without imports; names of modules in strings are all the same."""

    def visit_Import(self, node: ast.Import) -> None:
        """None."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """None."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """A path of a module as one name."""
        if isinstance(node.value, str):
            return ast.Constant(_MODULE.sub("MODULE", node.value))
        return node


def bare(source: str) -> str:
    """A file's tree, as text."""
    return ast.dump(_Bare().visit(ast.parse(source)))


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout


def _files(commit: str) -> dict[str, str]:
    if not commit:
        paths = [p for p in _git("ls-files", "*.py").split() if Path(p).exists()]
        return {p: Path(p).read_text(encoding="utf-8") for p in paths}
    paths = [p for p in _git("ls-tree", "-r", "--name-only", commit).split() if p.endswith(".py")]
    return {p: _git("show", f"{commit}:{p}") for p in paths}


def differing(before: str, after: str, names: Iterable[str] = ()) -> list[str]:
    """Files of the first commit that are not the same in the second; empty names: all."""
    wanted = set(names)
    old, new = _files(before), _files(after)
    by_name: dict[str, list[str]] = {}
    for path in new:
        by_name.setdefault(PurePosixPath(path).name, []).append(path)
    found = []
    for path, source in old.items():
        name = PurePosixPath(path).name
        if wanted and not wanted & {path, name}:
            continue
        there = [path] if path in new else by_name.get(name, [])
        if not any(bare(source) == bare(new[each]) for each in there):
            found.append(path if there else f"{path} (gone)")
    return found


def main() -> int:
    """As the module's text says."""
    commits = [each for each in sys.argv[1:] if not each.endswith(".py")]
    names = [each for each in sys.argv[1:] if each.endswith(".py")]
    found = differing(commits[0], commits[1] if len(commits) > 1 else "", names)
    print("\n".join(found) or "the same but for imports and patch paths")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
