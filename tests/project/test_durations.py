"""The record of what each test file takes: its tiers, and a reason for each slow test."""

from pathlib import Path

import pytest

from tests.durations import HERE, SLOW_S, fast_files, part, read, reasons, write


def test_a_run_is_put_on_record_and_leaves_other_files_lines(tmp_path: Path) -> None:
    record = tmp_path / "durations.txt"
    here = "project/test_durations.py"
    write({f"tests/{here}::test_a[x]": 7.0, f"tests/{here}::test_a[y]": 9.0}, record)
    write({"tests/project/test_words.py::test_b": 0.5}, record)
    took = read(record)
    assert (took[here].seconds, took[here].tests, took[here].slow) == (16.0, 2, {"test_a": 9.0})
    assert took["project/test_words.py"].seconds == 0.5
    assert fast_files(took, 1.0) == {"project/test_words.py"}
    assert fast_files(took, 17.0) == set(took)


def test_each_file_is_in_one_of_the_parts() -> None:
    seconds = {Path(f"test_{name}.py"): float(name) for name in range(12)}
    parts = [part(f"{k}/4", seconds, seconds.__getitem__) for k in (1, 2, 3, 4)]
    assert sorted(path for each in parts for path in each) == sorted(seconds)
    assert max(sum(map(seconds.__getitem__, each)) for each in parts) < 20.0
    with pytest.raises(ValueError, match="K from 1 to N"):
        part("5/4", seconds, seconds.__getitem__)


def test_a_slow_test_says_why() -> None:
    for name, took in read().items():
        if not took.slow or not (HERE / name).exists():
            continue
        why = reasons(HERE / name)
        silent = [
            each
            for each in took.slow
            if not why.get("") and not any(why.get(part) for part in each.split("::"))
        ]
        assert silent == [], f"{name}: over {SLOW_S:g} s; say why with pytest.mark.slow or nightly"
