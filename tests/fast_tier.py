"""Which tests are left out of the fast tier (``pytest --fast``): those named in ``slow.txt``.

    .venv/bin/pytest -n 2 --durations=0 --durations-min=0.005 > durations.txt
    .venv/bin/python -m tests.fast_tier durations.txt --seconds 110

writes that list from what a whole run took (not of one with ``--fast``, which lacks what the list
has now): the slowest tests of it, until what is left takes so many seconds, of all processes
together. A test that is in no list is fast: new ones are run. A file whose tests share a slow
fixture is left out whole or not at all: without the first of them the next one would wait for it.
"""

import argparse
import re
from collections import Counter
from pathlib import Path

LIST = Path(__file__).with_name("slow.txt")
_LINE = re.compile(r"([\d.]+)s (setup|call|teardown)\s+tests/(\S+?)(?:\[.*\])?$")
_SHARED_S = 2.0
"""A setup that takes so long is taken for one that tests share."""


def slow_tests() -> frozenset[str]:
    """Files (``console/test_x.py``), and functions of others (``console/test_x.py::test_y``)."""
    lines = LIST.read_text(encoding="utf-8").splitlines() if LIST.exists() else []
    return frozenset(line for line in lines if line and not line.startswith("#"))


def is_slow(node_id: str, slow: frozenset[str]) -> bool:
    """``node_id`` as pytest has it, ``tests/console/test_x.py::test_y[case]``."""
    path, _, function = node_id.removeprefix("tests/").partition("::")
    return path in slow or f"{path}::{function.partition('[')[0]}" in slow


def chosen(text: str, seconds: float) -> list[str]:
    """What is to be left out, by the durations of a run.

    A file all of whose seconds are left out is named whole.
    """
    lines = [found for line in text.splitlines() if (found := _LINE.search(line.strip()))]
    shared = {
        each[3].partition("::")[0]
        for each in lines
        if each[2] == "setup" and float(each[1]) >= _SHARED_S
    }
    took: Counter[str] = Counter()
    for each in lines:
        path = each[3].partition("::")[0]
        took[path if path in shared else each[3]] += float(each[1])  # type: ignore[assignment]
    left, out = sum(took.values()), set[str]()
    for name, taken in took.most_common():
        if left <= seconds:
            break
        out.add(name)
        left -= taken
    kept = {name.partition("::")[0] for name in took.keys() - out}
    return sorted({n.partition("::")[0] if n.partition("::")[0] not in kept else n for n in out})


def main() -> None:
    """Write the list."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("durations", type=Path, help="what a whole run printed")
    parser.add_argument("--seconds", type=float, default=110.0, help="for all that is left")
    options = parser.parse_args()
    names = chosen(options.durations.read_text(encoding="utf-8"), options.seconds)
    head = "# Left out by 'pytest --fast'. Written by 'python -m tests.fast_tier', see there.\n"
    LIST.write_text(head + "".join(f"{name}\n" for name in names), encoding="utf-8")
    print(f"{len(names)} files and functions are left out")


if __name__ == "__main__":
    main()
