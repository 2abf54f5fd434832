"""Whether a commit moved code and did nothing else: what stands in files, wherever they lie.

    python -m tests.unchanged.moves BEFORE [AFTER] [--names old=new,...]

Takes every statement at the top of every file of the package, without imports, docstrings of files
and names of modules in strings, and compares both heaps. Prints what only one of them has.
"""

import argparse
import ast
import subprocess
from collections import Counter

from tests.unchanged.syntax import bare


def statements(commit: str) -> Counter[str]:
    """Each statement's tree with how often it is there."""
    listed = subprocess.run(
        ["git", "ls-tree", "-r", "--name-only", commit, "rsoconsole"],
        capture_output=True,
        text=True,
        check=True,
    )
    found: Counter[str] = Counter()
    for path in listed.stdout.split():
        if not path.endswith(".py") or path.endswith("__init__.py"):
            continue
        source = subprocess.run(
            ["git", "show", f"{commit}:{path}"], capture_output=True, text=True, check=True
        ).stdout
        body = ast.parse(source).body
        if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
            body = body[1:]
        for node in body:
            if not isinstance(node, ast.Import | ast.ImportFrom):
                found[bare(ast.unparse(node))] += 1
    return found


def main() -> None:
    """Prints how many statements there are and those that differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("after", nargs="?", default="HEAD")
    parser.add_argument("--names", default="", help="renamed on the way: old=new,old=new")
    given = parser.parse_args()
    before, after = statements(given.before), statements(given.after)
    for pair in filter(None, given.names.split(",")):
        old, _, new = pair.partition("=")
        before = Counter({text.replace(f"'{old}'", f"'{new}'"): n for text, n in before.items()})
        after = Counter({text.replace(f"'{old}'", f"'{new}'"): n for text, n in after.items()})
    gone, come = before - after, after - before
    print(f"{before.total()} statements before, {after.total()} after")
    for sign, heap in (("-", gone), ("+", come)):
        for text, count in sorted(heap.items()):
            print(sign, count, text[:300])


if __name__ == "__main__":
    main()
