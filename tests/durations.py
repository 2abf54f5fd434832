"""How long each test file takes, on record in ``durations.txt``; what the tiers are made of.

    .venv/bin/pytest -n 3 --dist loadfile --no-loadscope-reorder --all --write-durations

writes it on a machine that does nothing else; a run of some files writes the lines of those alone,
an ordinary run nothing. The slowest files are started first. ``--fast`` takes the files whose tests
are the quickest, until they fill its time; a file without a line is quick: new ones are run.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

HERE = Path(__file__).parent
RECORD = Path(__file__).with_name("durations.txt")
FAST_CORE_S = 50.0
"""The fast tier's seconds of all processes together, without those of reading its files."""
SLOW_S = 5.0
"""A test that takes longer says why."""
_HEAD = (
    "# Seconds of each file in the plain tier, of what it has nightly, tests of the plain tier;\n"
    "# one of these over 5 s below its file. See durations.py.\n"
)


@dataclass(slots=True)
class Took:
    """Of one file."""

    seconds: float = 0.0
    nightly_s: float = 0.0
    tests: int = 0
    """Of the plain tier, as ``seconds``."""
    slow: dict[str, float] = field(default_factory=dict)
    """Each of these over ``SLOW_S``, the slowest of its parameters."""


@dataclass(frozen=True, slots=True)
class NodeTook:
    """Of one test, with what was set up for it."""

    seconds: float
    is_nightly: bool = False


def read(record: Path = RECORD) -> dict[str, Took]:
    """Files, as ``console/test_console.py``, in order of names."""
    took: dict[str, Took] = {}
    for line in record.read_text(encoding="utf-8").splitlines() if record.exists() else []:
        match line.split():
            case ["#", *_]:
                pass
            case [seconds, nightly_s, tests, name]:
                took[name] = Took(float(seconds), float(nightly_s), int(tests))
            case [seconds, name]:
                path, _, test = name.partition("::")
                took[path].slow[test] = float(seconds)
    return took


def write(nodes: Mapping[str, NodeTook], record: Path = RECORD) -> None:
    """Put down a run, by the tests' node names; what was not run stays as it was on record."""
    took = {name: each for name, each in read(record).items() if (HERE / name).exists()}
    begun: set[tuple[str, bool]] = set()
    for node, test in nodes.items():
        path, _, name = node.removeprefix("tests/").partition("::")
        each, name = took.setdefault(path, Took()), name.partition("[")[0]
        if (path, test.is_nightly) not in begun:
            begun.add((path, test.is_nightly))
            took[path] = each = (
                replace(each, nightly_s=0.0) if test.is_nightly else Took(nightly_s=each.nightly_s)
            )
        if test.is_nightly:
            each.nightly_s += test.seconds
            continue
        each.seconds, each.tests = each.seconds + test.seconds, each.tests + 1
        if test.seconds > max(SLOW_S, each.slow.get(name, 0.0)):
            each.slow[name] = test.seconds
    lines = [_HEAD]
    for path, each in sorted(took.items()):
        lines.append(f"{each.seconds:8.1f} {each.nightly_s:8.1f} {each.tests:5} {path}\n")
        lines += [f"{seconds:8.1f}       {path}::{n}\n" for n, seconds in sorted(each.slow.items())]
    record.write_text("".join(lines), encoding="utf-8")


def fast_files(took: Mapping[str, Took], core_s: float = FAST_CORE_S) -> frozenset[str]:
    """Files on record that the fast tier runs: most tests in that time."""
    chosen: set[str] = set()
    plain = [(name, each) for name, each in took.items() if each.tests]
    for name, each in sorted(plain, key=lambda item: item[1].seconds / item[1].tests):
        core_s -= each.seconds
        if core_s < 0.0:
            break
        chosen.add(name)
    return frozenset(chosen)


def part(which: str, files: Iterable[Path], seconds_of: Callable[[Path], float]) -> set[Path]:
    """Files of the K-th of N parts that last about as long as each other; ``which``: "K/N"."""
    k, n = map(int, which.split("/"))
    if not 1 <= k <= n:
        raise ValueError(f"part {which}: K/N with K from 1 to N")
    parts: list[set[Path]] = [set() for _ in range(n)]
    loads = [0.0] * n
    for path in sorted(files, key=lambda path: (-seconds_of(path), path)):
        least = loads.index(min(loads))
        parts[least].add(path)
        loads[least] += max(seconds_of(path), 0.1)
    return parts[k - 1]


def reasons(path: Path) -> dict[str, str]:
    """Why tests of a file are slow or nightly: by function, "" for the whole file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found[node.name] = next((w for d in node.decorator_list for w in _marked(d)), "")
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            found[""] = next(_marked(node.value), "")
    return found


def _marked(node: ast.AST) -> Iterator[str]:
    for call in ast.walk(node):
        if isinstance(call, ast.Call) and ast.unparse(call.func) in (
            "pytest.mark.slow",
            "pytest.mark.nightly",
        ):
            yield str(ast.literal_eval(call.args[0]))
