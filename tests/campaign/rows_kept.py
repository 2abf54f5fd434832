"""Rows of a campaign on disk, one line of JSON each, so that it goes on where it was stopped."""

import argparse
import json
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, TypeAlias

PAGE = Path(__file__).with_name("README.md")
RESULTS = Path(__file__).with_name("results")
Row: TypeAlias = dict[str, Any]


def read(path: Path) -> list[Row]:
    """Rows that are known; of a line that a crash left unfinished none."""
    if not path.exists():
        return []
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def complete(path: Path, row_of: Callable[[int], Row], count: int, jobs: int) -> None:
    """Every row up to ``count`` that is not known, each on the disk as soon as it is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {row["number"] for row in read(path)}
    missing = [number for number in range(count) if number not in known]
    is_broken = path.exists() and path.read_bytes()[-1:] not in {b"", b"\n"}
    with path.open("a", encoding="utf-8") as out, ProcessPoolExecutor(jobs) as pool:
        if is_broken:
            out.write("\n")
        for row in pool.map(row_of, missing):
            out.write(json.dumps(row) + "\n")
            out.flush()


def keep(folder: Path, name: str) -> None:
    """Put a folder's rows beside the page: what later figures are compared with."""
    (RESULTS / name).mkdir(parents=True, exist_ok=True)
    for path in folder.glob("*.jsonl"):
        (RESULTS / name / path.name).write_bytes(path.read_bytes())


def put_into_page(name: str, text: str, page: Path = PAGE) -> None:
    """Replace what stands between ``<!-- name: begin -->`` and its end."""
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    whole = page.read_text(encoding="utf-8")
    before, after = whole.partition(begin)[0], whole.partition(end)[2]
    page.write_text(f"{before}{begin}{text}{end}{after}", encoding="utf-8")


def parser_of(name: str, words: str | None, count: int) -> argparse.ArgumentParser:
    """What all campaigns of frames are asked for."""
    parser = argparse.ArgumentParser(
        description=words, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=count, help="frames (of each family)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign", name))
    parser.add_argument("--write", action="store_true", help="into README.md and results/")
    return parser
