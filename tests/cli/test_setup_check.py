"""What the installation lacks is found before anything is compiled, with one line as the answer."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rsoconsole.base import setup_check
from rsoconsole.base.setup_check import (
    APT_LINE,
    Machine,
    installation_faults,
    must_compile_astrometry,
)
from rsoconsole.engine.doctor import doctor

ROOT = Path(__file__).resolve().parents[2]
PI = Machine(
    python=(3, 11),
    machine="aarch64",
    is_64_bit=True,
    is_glibc=True,
    has_venv=True,
    header_fault="",
    free_mb=20_000,
)


def test_a_pi_with_everything_has_no_fault() -> None:
    assert installation_faults(PI) == []


@pytest.mark.parametrize(
    ("machine", "words"),
    [
        (replace(PI, is_64_bit=False), "32-bit system on aarch64"),
        (replace(PI, machine="armv7l", is_64_bit=False), "32-bit system on armv7l"),
        (replace(PI, machine="riscv64"), "64-bit system on riscv64"),
        (replace(PI, is_glibc=False), "without glibc"),
        (replace(PI, python=(3, 9)), "this is Python 3.9, 3.11 is needed"),
        (replace(PI, has_venv=False), APT_LINE),
        (replace(PI, header_fault="Python.h is missing"), f"Python.h is missing: {APT_LINE}"),
        (replace(PI, free_mb=900), "900 MB are free"),
    ],
)
def test_each_thing_that_is_missing_is_said_with_its_remedy(machine: Machine, words: str) -> None:
    (fault,) = installation_faults(machine)
    assert words in fault


def test_a_32_bit_system_is_told_of_the_64_bit_one_and_of_nothing_else() -> None:
    (fault,) = installation_faults(replace(PI, is_64_bit=False, has_venv=False, free_mb=1))
    assert "Raspberry Pi OS Lite (64-bit)" in fault
    assert "apt install" not in fault


def test_only_where_no_wheel_is_published_is_anything_compiled() -> None:
    assert not must_compile_astrometry((3, 11), "x86_64")
    assert must_compile_astrometry((3, 11), "aarch64")
    assert must_compile_astrometry((3, 14), "x86_64")


def compiler(folder: Path, words: str) -> str:
    """A stand-in for the C compiler that says ``words`` and fails, or is content without any."""
    path = folder / "cc"
    path.write_text(f"#!/bin/sh\n[ -z '{words}' ] && exit 0\necho '{words}' >&2\nexit 1\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ("", ""),
        ("fatal error: Python.h: No such file or directory", "Python.h is missing"),
        ("fatal error: stdio.h: No such file or directory", "stdio.h: No such file"),
    ],
)
def test_the_headers_are_tried_with_the_compiler_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, fault: str
) -> None:
    monkeypatch.setenv("CC", compiler(tmp_path, words))
    found = setup_check.python_header_fault()
    assert found == "" if not fault else fault in found


def test_a_missing_compiler_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "no C compiler" in setup_check.python_header_fault()
    monkeypatch.setenv("CC", str(tmp_path / "none"))
    assert "does not run" in setup_check.python_header_fault()


@pytest.mark.skipif(not (ROOT / "README.md").exists(), reason="no checkout: no README here")
def test_the_line_to_paste_is_the_readmes_and_stands_before_the_first_command() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    first = "python3 rsoconsole/base/setup_check.py && python3 -m venv"
    assert 0 < readme.index(f"```bash\n{APT_LINE}\n```") < readme.index(first)


@pytest.mark.skipif(not (ROOT / "README.md").exists(), reason="no checkout: no script here")
def test_the_check_runs_without_anything_installed() -> None:
    done = subprocess.run(
        [sys.executable, "-I", "-S", ROOT / "rsoconsole" / "base/setup_check.py"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    expected = installation_faults(setup_check.probe_machine(ROOT))
    assert done.returncode == bool(expected), done.stderr
    assert done.stderr.count("cannot be installed here yet") == len(expected)


def test_the_doctor_asks_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup_check, "probe_machine", lambda _folder: PI)
    assert doctor.check_system().ok is True
    lacks = replace(PI, header_fault="Python.h is missing")
    monkeypatch.setattr(setup_check, "probe_machine", lambda _folder: lacks)
    check = doctor.check_system()
    assert check.ok is None
    assert "Python.h is missing" in check.detail
    assert check.remedy == APT_LINE
