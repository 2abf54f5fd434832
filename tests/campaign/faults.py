"""Nights with a fault every few frames, from a seeded list, and the table of what became of them.

    python -m tests.campaign faults --seeds 1-3
    python -m tests.campaign faults --seeds 1 --frames 200 --write

Each seed is one engine's night of 1,200 small frames with some 310 faults, 25 minutes of two
cores. Answers lie in ``--folder``: the same command goes on with the seeds that have none.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import astropy.units as u
import numpy as np
from astropy.time import Time

from tests.campaign.arguments import seeds_of
from tests.campaign.fault_growth import growing, growth_lines, slopes_of
from tests.campaign.fault_kinds import ENDS_IT, KINDS
from tests.campaign.fault_night import VERB_S, FaultNight, Row
from tests.rigs.stub_stage import SITE
from tests.rigs.whole_engine import wait_for

PAGE = Path(__file__).with_name("FAULTS.md")
RESULTS = Path(__file__).with_name("results") / "faults.json"
BEGIN, END = "<!-- table: begin -->\n", "<!-- table: end -->"
FRAMES, EVERY = 1200, 2
LAST_SHARE = 1.0 / 6.0
"""Of a night, for what ends an engine."""
GENTLE = "engine killed"
BETWEEN_S = 20.0
"""So long frames are waited for that go on anyhow."""
MIN_ALT_DEG = 15.0
"""Below which this engine's configuration sends no mount."""
ORDERED_MS, ANSWERED_MS = 200.0, 500.0
Answer = dict[str, Any]


def night(seed: int, frames: int, folder: Path, kinds: Sequence[str] = tuple(KINDS)) -> Answer:
    """One night to its figures."""
    begun_s = time.monotonic()
    with FaultNight(folder, seed) as running:
        rows = _rows(running, frames, kinds)
        running.engine.close()
        lost = sorted(set(running.acknowledged) - running.destroyed - running.kept())
        log = Path(running.engine.environment["XDG_STATE_HOME"])
        said = "".join(running.said) + (running.folder / "said.txt").read_text(errors="replace")
        return {
            "seed": seed,
            "frames": running.note_frame,
            "wall_s": round(time.monotonic() - begun_s, 1),
            "rows": [_row_json(row) for row in rows],
            "acknowledged": len(running.acknowledged),
            "destroyed": len(running.destroyed),
            "lost": lost,
            "unsafe_slews": _unsafe(running),
            "slews": len(running.wire.orders.slews),
            "tracebacks": said.count("Traceback (most recent call last)")
            + said.count("something broke"),
            "tracebacks_in_logs": sum(
                path.read_text(errors="replace").count("Traceback (most recent call last)")
                for path in log.rglob("*.log*")
            ),
            "slopes": slopes_of(running.samples),
        }


def _rows(running: FaultNight, frames: int, kinds: Sequence[str]) -> list[Row]:
    """Faults until so many frames are exposed: every kind once before any comes again."""
    rows: list[Row] = []
    names: list[str] = []
    alive = [kind for kind in kinds if kind not in ENDS_IT]
    frame, was_late = running.note_frame, False
    while frame < frames:
        is_late = frame >= frames * (1.0 - LAST_SHARE) or not alive
        is_first_of_late = is_late and not was_late
        if not names or is_late != was_late:
            was_late = is_late
            names = [kind for kind in kinds if kind in ENDS_IT] if is_late else [*alive]
            names = names or [*alive]
            running.random.shuffle(names)
            if is_first_of_late and GENTLE in names:
                # What the long life acknowledged must not be destroyed, but looked for.
                names.remove(GENTLE)
                names.append(GENTLE)
        row = Row(kind=names.pop(), frame=frame)
        running.note()
        try:
            KINDS[row.kind](running, row)
        except Exception as error:  # what a fault's own code meets is a finding
            row.wrong.append(f"{type(error).__name__}: {error}"[:200])
        running.recover(row)
        running.look(row)
        if row.slowest_verb_s > VERB_S:
            row.wrong.append(f"a verb took {row.slowest_verb_s:.0f} s")
        rows.append(row)
        if not running.is_living():
            break
        frame, begun_s = running.note_frame, time.monotonic()
        with suppress(AssertionError):
            wait_for(lambda goal=frame + EVERY - 1: running.frames() >= goal, "frames", BETWEEN_S)
        if not is_late and running.note_frame > frame:
            cycle_s = (time.monotonic() - begun_s) / (running.note_frame - frame)
            running.sample(running.note_frame, cycle_s)
        frame = running.note_frame
        words = "; ".join(row.wrong)
        print(f"{frame:5} {row.kind:30} {row.recovered_s:5.1f} s  {words}", flush=True)
    return rows


def _unsafe(running: FaultNight) -> list[str]:
    """Orders to go below the limit, by the time that the observatory had."""
    wrong = []
    for slew in running.wire.orders.slews:
        if not slew.utc:
            continue
        sidereal = Time(slew.utc, scale="utc").sidereal_time("apparent", SITE.longitude_deg * u.deg)
        hour = np.radians((float(sidereal.hour) - slew.ra_date_hours) * 15.0)
        dec, latitude = np.radians(slew.dec_date_deg), np.radians(SITE.latitude_deg)
        alt = np.sin(dec) * np.sin(latitude) + np.cos(dec) * np.cos(latitude) * np.cos(hour)
        alt_deg = float(np.degrees(np.arcsin(alt)))
        if not alt_deg >= MIN_ALT_DEG:
            wrong.append(f"sent to altitude {alt_deg:.1f} deg")
    return wrong


def _row_json(row: Row) -> dict[str, Any]:
    return {name: getattr(row, name) for name in row.__dataclass_fields__}


def table(answers: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: the whole, and each kind."""
    rows = [row for answer in answers for row in answer["rows"]]
    ordered = [r["stop_ordered_ms"] for r in rows if r["stop_ordered_ms"] is not None]
    answered = [r["stop_answered_ms"] for r in rows if r["stop_answered_ms"] is not None]
    lines = [
        f"Seeds {', '.join(str(a['seed']) for a in answers)}: {len(rows)} faults of "
        f"{len({r['kind'] for r in rows})} kinds in {sum(a['frames'] for a in answers)} frames.",
        "",
        "| promised | seen |",
        "|---|---|",
        f"| acknowledged facts lost | {sum(len(a['lost']) for a in answers)} of "
        f"{sum(a['acknowledged'] - a['destroyed'] for a in answers)} |",
        f"| unsafe slews | {sum(len(a['unsafe_slews']) for a in answers)} of "
        f"{sum(a['slews'] for a in answers)} |",
        f"| tracebacks shown | {sum(a['tracebacks'] for a in answers)} |",
        f"| tracebacks in the logs | {sum(a['tracebacks_in_logs'] for a in answers)} |",
        f"| slowest verb | {max(r['slowest_verb_s'] for r in rows):.1f} s |",
        f"| faults after which something was wrong | {sum(bool(r['wrong']) for r in rows)} |",
    ]
    for words, values, bar in (
        ("ordered", ordered, ORDERED_MS),
        ("answered", answered, ANSWERED_MS),
    ):
        if values:
            late = sum(value > bar for value in values)
            lines.append(
                f"| STOP {words} | median {np.median(values):.0f} ms, worst {max(values):.0f} ms,"
                f" {late} of {len(values)} over {bar:.0f} ms |"
            )
    for answer in answers:
        lines += growth_lines(answer["slopes"], f"seed {answer['seed']}")
    lines += ["", "| fault | n | frames again after, median and worst | armed again | wrong |"]
    lines.append("|---|---|---|---|---|")
    for kind in KINDS:
        of_kind = [r for r in rows if r["kind"] == kind]
        if not of_kind:
            continue
        again = [r["recovered_s"] for r in of_kind]
        wrong = sorted({words for r in of_kind for words in r["wrong"]})
        lines.append(
            f"| {kind} | {len(of_kind)} | {np.median(again):.1f} s, {max(again):.1f} s |"
            f" {sum(r['armed_again'] for r in of_kind)} | {'; '.join(wrong)} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 0 where nothing was wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign faults",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", "--seed", type=seeds_of, default=[1], help="such as 1-3 or 1,4")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each night")
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign/faults"))
    parser.add_argument(
        "--kind", action="append", choices=[*KINDS], help="only this one (repeatable), not kept"
    )
    parser.add_argument("--write", action="store_true", help="put the table into FAULTS.md")
    chosen = parser.parse_args(arguments)
    if chosen.kind and chosen.write:
        parser.error("--write keeps the table of all kinds: leave --kind out")
    chosen.folder.mkdir(parents=True, exist_ok=True)
    answers = []
    for seed in chosen.seeds:
        path = chosen.folder / f"seed-{seed}-{chosen.frames}.json"
        if path.exists() and not chosen.kind:
            answers.append(json.loads(path.read_text(encoding="utf-8")))
            continue
        with tempfile.TemporaryDirectory(prefix="faults-") as scratch:
            answer = night(seed, chosen.frames, Path(scratch), chosen.kind or tuple(KINDS))
        answers.append(answer)
        if not chosen.kind:
            path.write_text(json.dumps(answer), encoding="utf-8")
    text = table(answers)
    print(text)
    if chosen.write:
        RESULTS.write_text(json.dumps(answers) + "\n", encoding="utf-8")
        page = PAGE.read_text(encoding="utf-8")
        head, tail = page.partition(BEGIN)[0], page.partition(END)[2]
        PAGE.write_text(f"{head}{BEGIN}{text}{END}{tail}", encoding="utf-8")
    return 0 if all(is_well(answer) for answer in answers) else 1


def is_well(answer: Mapping[str, Any]) -> bool:
    """Whether nothing was lost, unsafe, broken, growing or otherwise wrong in a night."""
    whole = ("lost", "unsafe_slews", "tracebacks", "tracebacks_in_logs")
    is_wrong = any(answer[name] for name in whole) or any(r["wrong"] for r in answer["rows"])
    return not is_wrong and not growing(answer["slopes"])


if __name__ == "__main__":
    sys.exit(main())
