"""Make the systems, go through every step, print the table.

As root, with debootstrap and qemu-user-static, from an installed checkout:

    .venv/bin/python -m tests.aarch64 --folder DIR [--system bookworm] [--write]

Takes an hour or two: everything is emulated. What is compared with x86-64 is run here, too.
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from tests.aarch64 import steps
from tests.aarch64.steps import Step
from tests.aarch64.systems import KINDS, System

PAGE = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- table: begin -->\n", "<!-- table: end -->"


def rows(name: str, folder: Path) -> Iterator[Step]:
    """Every step on one system, as it is done."""
    log = folder / f"{name}.log"
    log.unlink(missing_ok=True)
    started_s = time.monotonic()
    system = System(KINDS[name], folder)
    made_s = time.monotonic() - started_s
    yield Step(name="debootstrap", is_green=True, seconds=made_s, found=system.kind.architecture)
    if system.kind.architecture == "armhf":
        steps.put_clone(system, log)
        yield steps.refusal(system, log, "this is a 32-bit system")
        return
    yield from steps.newcomer(system, log)


def table(found: dict[str, list[Step]]) -> str:
    """All steps as Markdown."""
    lines = ["| system | step | | seconds | what was seen |", "|---|---|---|---|---|"]
    for name, done in found.items():
        lines += [
            f"| {name} | {step.name} | {'ok' if step.is_green else '**FAILED**'} "
            f"| {step.seconds:.0f} | {step.found.replace('|', '/')} |"
            for step in done
        ]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Exit status 0 when every step on every system is green."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, required=True, help="where the systems are made")
    parser.add_argument("--system", action="append", choices=list(KINDS), help="default: all")
    parser.add_argument("--write", action="store_true", help="put the table into the README beside")
    chosen = parser.parse_args()
    if os.geteuid() != 0:
        parser.error("only root can make these systems: run it with sudo")
    folder = chosen.folder.resolve()
    found: dict[str, list[Step]] = {}
    for name in chosen.system or list(KINDS):
        found[name] = []
        for step in rows(name, folder):
            found[name].append(step)
            mark = "ok  " if step.is_green else "FAIL"
            print(f"{mark} {name:12} {step.seconds:7.0f} s  {step.name}: {step.found}", flush=True)
            if not step.is_green:
                break
    if chosen.write:
        page = PAGE.read_text(encoding="utf-8")
        head, tail = page.partition(BEGIN)[0], page.partition(END)[2]
        version = subprocess.run(
            ["qemu-aarch64-static", "--version"], capture_output=True, text=True, check=True
        ).stdout.splitlines()[0]
        about = f"{version}, on {platform.machine()} ({os.cpu_count()} cores)\n\n"
        PAGE.write_text(f"{head}{BEGIN}{about}{table(found)}{END}{tail}", encoding="utf-8")
    return 0 if all(step.is_green for done in found.values() for step in done) else 1


if __name__ == "__main__":
    sys.exit(main())
