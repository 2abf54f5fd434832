"""The README's first command on emulated Raspberry Pi systems; and the judge of its figures."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.aarch64.compare import largest_difference
from tests.aarch64.systems import KINDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.aarch64
@pytest.mark.timeout(6 * 3600)
@pytest.mark.parametrize("name", KINDS)
def test_a_newcomer_gets_through_on(name: str) -> None:
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        pytest.skip("needs root, debootstrap and qemu-user-static")
    folder = os.environ.get("RSOCONSOLE_AARCH64", "/var/tmp/rsoconsole-aarch64")
    command = [sys.executable, "-m", "tests.aarch64", "--folder", folder, "--system", name]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_two_machines_answers_are_compared_number_by_number() -> None:
    theirs = {"rms": 1.0, "ms": 3.0, "list": [{"a": 1}, {"a": 2}], "name": "x", "none": None}
    assert largest_difference(theirs, theirs | {"ms": 9.0}, {"ms"}) == 0.0
    more = theirs | {"rms": 1.001}
    assert largest_difference(theirs, more, {"ms"}) == pytest.approx(0.001 / 1.001)
    assert largest_difference(theirs, theirs | {"ms": 9.0}, set()) == pytest.approx(2.0 / 3.0)
    off = theirs | {"list": [{"a": 1}, {"a": 2.5}]}
    assert largest_difference(theirs, off, {"ms"}) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("ours", "where"),
    [
        ({"name": "y", "list": []}, "name: 'x' there, 'y' here"),
        ({"name": "x", "list": [1]}, "list: [] there, [1] here"),
        ({"name": "x"}, "list: [] there, None here"),
        ({"name": 1.0, "list": []}, "name: 'x' there, 1.0 here"),
    ],
)
def test_answers_that_differ_in_kind_are_told_by_place(ours: dict[str, object], where: str) -> None:
    assert largest_difference({"name": "x", "list": []}, ours, set()) == where
