"""Run the nights of a campaign that are not done yet, and keep the table.

    python -m tests.campaign all
    python -m tests.campaign worlds --seeds 1-100
    python -m tests.campaign gps molniya --jobs 1
    python -m tests.campaign table --write
    python -m tests.campaign faults --help
    python -m tests.campaign odd_mounts --help

A full-size frame costs two seconds of a core: 100 worlds of 40 frames take two hours of one.
Stop it when you like; the same command goes on. Answers lie in ``--folder``; remove it to begin
again.
"""

import argparse
import os
import sys
from pathlib import Path

from tests.campaign import faults, odd_mounts, runner
from tests.campaign.arguments import seeds_of
from tests.campaign.cases import ELEMENTS, GROUPS, Group
from tests.campaign.table import table

PAGE = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- table: begin -->\n", "<!-- table: end -->"


def run_group(
    group: Group, seeds: list[int] | None, folder: Path, jobs: int, sessions: Path | None = None
) -> bool:
    """Every night of the group that has no answer yet; whether all went well."""
    if group.needs_elements and not ELEMENTS.exists():
        print(f"{group.name}: left out, the independent element files are not there")
        return True
    fault = group.lacks()
    if fault is not None:
        print(f"{group.name}: left out, {fault}")
        return True
    cases, is_well = group.cases(seeds or group.seeds), True
    for case, answer in runner.run_missing(cases, folder, jobs, sessions):
        is_well &= "error" not in answer
        objects = answer.get("objects", [])
        words = answer.get("error") or "; ".join(
            f"{each['name']} visible {each['visible_frames']}, detected {each['detections']}, "
            f"TRACK {each['track_frames']}"
            for each in objects
            if each["visible_frames"]
        )
        print(
            f"{case.group:9} {case.name:22} {answer.get('wall_s', 0):6.0f} s  {words}", flush=True
        )
    return is_well


def main() -> int:
    """Exit status 0 when every night came to its end."""
    if sys.argv[1:2] == ["faults"]:
        return faults.main(sys.argv[2:])
    if sys.argv[1:2] == ["odd_mounts"]:
        return odd_mounts.main(sys.argv[2:])
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("groups", nargs="+", choices=[*GROUPS, "all", "table"], metavar="GROUP")
    parser.add_argument(
        "--seeds", type=seeds_of, help="such as 1-100 or 1,4,9; default: the group's"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="nights at a time")
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign"))
    parser.add_argument("--sessions", type=Path, help="where the nights' sessions stay; none do")
    parser.add_argument(
        "--write", action="store_true", help="put the table into the README, the answers beside it"
    )
    parser.add_argument(
        "--go-on",
        action="store_true",
        help="take the kept answers for known: the program is the same",
    )
    chosen = parser.parse_args()
    if chosen.go_on:
        runner.go_on(GROUPS, chosen.folder)
    names = list(GROUPS) if "all" in chosen.groups else [n for n in chosen.groups if n in GROUPS]
    is_well = True
    for name in names:
        is_well &= run_group(
            GROUPS[name], chosen.seeds, chosen.folder, chosen.jobs, chosen.sessions
        )
    found = {
        name: runner.answers(group.cases(chosen.seeds or group.seeds), chosen.folder)
        for name, group in GROUPS.items()
    }
    text = table(found)
    print(text)
    if chosen.write:
        for name, answers in found.items():
            runner.keep(name, answers)
        page = PAGE.read_text(encoding="utf-8")
        head, tail = page.partition(BEGIN)[0], page.partition(END)[2]
        PAGE.write_text(f"{head}{BEGIN}{text}{END}{tail}", encoding="utf-8")
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
