"""The record of what each test file takes: its tiers, and a reason for each slow test."""

from pathlib import Path

import pytest

from tests.durations import HERE, SLOW_S, NodeTook, fast_files, part, read, reasons, write


def test_a_run_is_put_on_record_and_leaves_the_rest_as_it_was(tmp_path: Path) -> None:
    record = tmp_path / "durations.txt"
    here, words = "project/test_durations.py", "project/test_words.py"
    write(
        {f"tests/{here}::test_a[x]": NodeTook(7.0), f"tests/{here}::test_a[y]": NodeTook(9.0)},
        record,
    )
    write({f"tests/{here}::test_n": NodeTook(30.0, is_nightly=True)}, record)
    write({f"tests/{words}::test_b": NodeTook(0.5)}, record)
    took = read(record)
    assert (took[here].seconds, took[here].nightly_s, took[here].tests) == (16.0, 30.0, 2)
    assert took[here].slow == {"test_a": 9.0}
    assert took[words].seconds == 0.5
    assert fast_files(took, 1.0) == {words}
    assert fast_files(took, 17.0) == set(took)
    write({f"tests/{here}::test_a[x]": NodeTook(1.0)}, record)
    again = read(record)[here]
    assert (again.seconds, again.nightly_s, again.slow) == (1.0, 30.0, {})


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
