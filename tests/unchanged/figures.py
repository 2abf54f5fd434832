"""Figures of seeded nights and what-ifs, as the program and the notebook give them.

    python -m tests.unchanged.figures          compares with what was written down
    python -m tests.unchanged.figures --write  writes it down
    python -m tests.unchanged.figures --words  shows which words differ, too

Nights of the simulated observatory, of measurements with known noise, and made-up ones with much
that comes to pass; of each what the verbs print with ``--json``, what is exported, and what
``open_session`` says of it.
"""

import csv
import dataclasses
import difflib
import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.library import render_report
from rsoconsole.library.notebook.session import open_session
from rsoconsole.night import FrameRow, Night, Quality, Summary
from rsoconsole.session import SessionReader, SessionWriter
from tests.nights import eight_tracks, eventful_night, measured_night
from tests.rigs.in_process import run_here
from tests.unchanged.transcripts import first_difference

KEPT = Path(__file__).with_name("figures.jsonl")
WORDS = Path(__file__).with_name("words.json")
DIGITS = 9
WALL = frozenset(("ms", "stage_ms", "latency_ms", "session", "folder", "path", "out", "digest"))
"""Members that are of the wall's time or of this folder."""
BINNED = "[sensor]\nbinning = 2\n"
DEMOS: Mapping[str, tuple[str, ...]] = {
    "intelsat-14 1": ("--scenario", "intelsat-14", "--seed", "1"),
    "intelsat-14 2 paper": ("--scenario", "intelsat-14", "--seed", "2", "--preset", "paper"),
    "ses-10 3": ("--scenario", "ses-10", "--seed", "3"),
    "intelsat-21 4 tuned": ("--scenario", "intelsat-21", "--seed", "4", "--preset", "tuned"),
    "cloud-bank 5": ("--scenario", "cloud-bank", "--seed", "5"),
}
WHAT_IFS: tuple[tuple[str, ...], ...] = (
    ("--gate", "6"),
    ("--q", "4", "--r", "0.5"),
    ("--preset", "tuned"),
    ("--tau", "0.6"),
)
FRAMES = 14
OF_THE_DAY = ("/tmp/", "data:image", " ms")
"""Lines with such are of this run."""
LONGEST = 300
DRAWN = re.compile(
    r"\s*(<(path|svg|g|use|defs|line|circle|rect|/)|[MLC] |\S*;base64|z|\"|[-\d.L ]+$)"
)


def plain(value: Any) -> Any:
    """As JSON has it: rounded, without the wall's time and names of folders."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain({each.name: getattr(value, each.name) for each in dataclasses.fields(value)})
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items() if key not in WALL}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value if value is None or isinstance(value, str | int | bool) else str(value)


def _printed(*words: str | Path) -> list[Any]:
    """What a verb prints as JSON; its exit code where it says no."""
    run = run_here(*words, "--json")
    lines = [plain(json.loads(line)) for line in run.stdout.splitlines() if line.startswith("{")]
    return [run.returncode, *lines]


def _exported(session: Path) -> list[Any]:
    run = run_here("export", session, "--format", "csv", "--out", "-")
    rows = csv.DictReader(io.StringIO(run.stdout))
    return [{name: _figure(cell) for name, cell in row.items()} for row in rows]


def _figure(cell: str) -> Any:
    try:
        return plain(float(cell))
    except ValueError:
        return cell


def _notebook(session: Path) -> dict[str, Any]:
    night = open_session(session)
    tables: dict[str, Any] = {}
    for name in night.table_names:
        rows = night.frame(name)
        numbers = rows.select_dtypes("number").drop(columns=["ms"], errors="ignore")
        sums = {str(column): float(numbers[column].sum()) for column in numbers}
        tables[name] = [len(rows), plain(sums)]
    tracks = {
        n: [len(t.states), len(t.measurements), t.name, *_quality(t.quality)]
        for n, t in night.tracks.items()
    }
    return {"summary": _summary(night.summary), "tracks": plain(tracks), "tables": tables}


def _quality(found: Quality) -> tuple[float | None, float | None]:
    return found.residual_rms_arcsec, found.nis_mean


def _summary(found: Summary) -> Any:
    """By the names that they had when they were written down, those alone."""
    names = ("frames", "followed", "updates", "locked_after_frames", "residual_rms_arcsec")
    names += ("nis_mean", "nis_band", "inside_3sigma")
    return plain({"missed": found.misses, **{name: getattr(found, name) for name in names}})


def _on_screen(session: Path) -> dict[str, Any]:
    """What the console shows of its end."""
    night = _folded(session)
    view = night.view()
    return {
        "rows": [{**plain(row), **_facts(row)} for row in view.rows],
        "tracks": [[t.number, len(t.rows), plain(t.residual_arcsec), t.snr] for t in view.tracks],
        "state": [view.state, view.tau, view.track_frame_id, plain(dict(view.changed))],
        "measured": plain(view.measured),
        "lines": [[line.level, line.frame_id, line.times] for line in view.log],
    }


def _facts(row: FrameRow) -> dict[str, Any]:
    """By the names that they had when they were written down."""
    names = ("star_count", "background_adu", "zero_point_mag")
    return plain({"fwhm_px": row.fwhm_px, **{name: row.facts.get(name) for name in names}})


def _folded(session: Path) -> Night:
    reader = SessionReader(session)
    night = Night(session, reader.about(), reader.config())
    for seq, t_utc_ns, record in reader.records():
        night.take(t_utc_ns, record, seq)
    return night


def words_of(session: Path) -> dict[str, list[str]]:
    """What people read of it."""
    told = {
        "console": [line.text for line in _folded(session).view().log],
        "report": render_report(session).html.splitlines(),
    }
    for words in (("orbit",), ("identify",), ("what-if", "--gate", "6", "--serial")):
        told[words[0]] = run_here(words[0], session, *words[1:]).stdout.splitlines()
    return {part: [line for line in lines if _is_prose(line)] for part, lines in told.items()}


def _is_prose(line: str) -> bool:
    """Neither of this run alone nor of a drawing."""
    return (
        len(line) <= LONGEST
        and not DRAWN.match(line)
        and not any(each in line for each in OF_THE_DAY)
        and re.search("[a-z]{3}", line) is not None
    )


def of_session(session: Path) -> dict[str, Any]:
    """All of one night."""
    found: dict[str, Any] = {
        "screen": _on_screen(session),
        "sessions": _printed("sessions", "verify", session),
        "orbit": _printed("orbit", session),
        "identify": _printed("identify", session),
        "export": _exported(session),
        "notebook": _notebook(session),
    }
    for words in WHAT_IFS:
        found[" ".join(("what-if", *words))] = _printed("what-if", session, *words, "--serial")
    return found


def nights(folder: Path) -> Iterator[tuple[str, Any]]:
    """Each by its name."""
    (folder / "world.toml").write_text(BINNED, encoding="utf-8")
    for name, words in DEMOS.items():
        session = folder / name.replace(" ", "-")
        here = ("--headless", "--frames", str(FRAMES), "--session", session)
        summary = _printed("demo", *here, *words, "--world", folder / "world.toml")
        yield name, {"demo": summary, **of_session(session)}
    for seed in range(4):
        preset = ("tuned", "adaptive")[seed % 2]
        session = measured_night.record_night(
            folder / f"measured-{seed}",
            frames=50,
            seed=seed,
            claimed_arcsec=(0.4, 0.3, 0.6, 0.4)[seed],
            missed=frozenset((11, 12, 30 + seed)),
            settings={"preset": preset},
        )
        yield f"measured {seed}", of_session(session)
    writer = eventful_night.write(folder / "eventful", 120)
    writer.close()
    yield "eventful", of_session(folder / "eventful")
    config = Config.model_validate({"filter": {"most_tracks": 12}})
    writer = SessionWriter.create(folder / "eight", config, {"title": "eight"})
    eight_tracks.write(writer, range(1, 30))
    writer.close()
    yield "eight", of_session(folder / "eight")


def _show_words(before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    for name, parts in before.items():
        for part, lines in parts.items():
            where = (f"{name}, {part}", "after")
            sys.stdout.writelines(
                f"{line}\n" for line in difflib.unified_diff(lines, after[name][part], *where, n=0)
            )


def main() -> int:
    """Write it down, or compare."""
    words: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        found = {}
        for name, night in nights(Path(folder)):
            found[name] = json.loads(json.dumps(night))
            words[name] = words_of(Path(folder) / name.replace(" ", "-"))
    if "--write" in sys.argv[1:]:
        lines = [json.dumps([name, night], separators=(",", ":")) for name, night in found.items()]
        KEPT.write_text("\n".join(lines) + "\n", encoding="utf-8")
        WORDS.write_text(json.dumps(words, indent=0, ensure_ascii=False), encoding="utf-8")
    if "--words" in sys.argv[1:]:
        _show_words(json.loads(WORDS.read_text(encoding="utf-8")), words)
    before = dict(map(json.loads, KEPT.read_text(encoding="utf-8").splitlines()))
    parted = 0
    for name, night in found.items():
        for part in before[name]:
            where = first_difference(before[name][part], night.get(part))
            if where is not None:
                parted += 1
                print(f"{name}, {part}: {where}")
    print(f"{len(found)} nights, {parted} parts differ")
    return int(parted > 0)


if __name__ == "__main__":
    sys.exit(main())
