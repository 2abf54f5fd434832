"""The detector beside its peers on plain and altered frames, at equal false positives.

    python -m tests.campaign.peers all --count 40 --write
    python -m tests.campaign.peers blur drift --count 3 --peers rsoconsole ASTRiDE

Run from the project's root in an environment that has ``requirements-peers.txt`` too. Every peer
sees the same frames, the slow ones the first few of each family, in a process of its own with a
time-out; a frame without an answer counts as one where nothing was found. Stop it when you like;
the same command goes on (``--folder``), and looks again at what a change of code or settings has
made void; commands for other families may run beside it. ``--write`` puts the table into README.md
and the rows into ``results/peers.jsonl``.
"""

import argparse
import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rsoconsole.records import Frame
from rsoconsole.simulator import Streak
from tests.bench.peers.child import Child
from tests.bench.peers.roster import PEERS, present
from tests.bench.peers.scoring import Candidate, Line, TrueStreak, judge
from tests.campaign import looks
from tests.campaign.families import FAMILIES, Truth, draw
from tests.campaign.pairs import Key, Look
from tests.campaign.peers_table import table

PAGE = Path(__file__).with_name("README.md")
RESULTS = Path(__file__).with_name("results") / "peers.jsonl"
BEGIN, END = "<!-- peers: begin -->\n", "<!-- peers: end -->"
TIMEOUT_S = 3600.0
"""On a machine full of other work; the child ends sooner by its own count."""
KEPT_FALSE = 30
"""Of one frame, the highest: what is left out can only make a peer's threshold lower."""


def look_of(answer: Mapping[str, Any], truth: Truth, others: Sequence[Streak]) -> Look:
    """A child's answer, judged: one that did not come has no candidates."""
    found = [
        Candidate(line=Line(x_a_px=a, y_a_px=b, x_b_px=c, y_b_px=d), score=score)
        for a, b, c, d, score in answer.get("candidates", [])
    ]
    line = Line(x_a_px=truth.x_a_px, y_a_px=truth.y_a_px, x_b_px=truth.x_b_px, y_b_px=truth.y_b_px)
    beside = [
        Line(
            x_a_px=float(each.x_px[0]),
            y_a_px=float(each.y_px[0]),
            x_b_px=float(each.x_px[-1]),
            y_b_px=float(each.y_px[-1]),
        )
        for each in others
    ]
    judged = judge(found, [TrueStreak(line=line, snr=truth.snr)], beside)
    _, score, off_px = judged.found[0]
    highest = sorted(judged.false_scores, reverse=True)[:KEPT_FALSE]
    cpu_s = answer.get("cpu_s")
    return Look(
        score=None if score is None else _short(score),
        off_px=None if off_px is None else _short(off_px),
        false=tuple(_short(each) for each in highest),
        false_count=len(judged.false_scores),
        cpu_s=None if cpu_s is None else _short(cpu_s),
        error=answer.get("error", ""),
    )


def _short(value: float) -> float:
    return float(f"{value:.6g}")


def missing(
    path: Path, names: Sequence[str], peers: Sequence[str], *, count: int, slow_count: int
) -> Iterator[tuple[Key, list[str]]]:
    """Frames with the peers that have not looked at them, the families in turn."""
    known = looks.read(path)
    for number in range(count):
        for name in names:
            left = [
                peer
                for peer in peers
                if (name, number) not in known.get(peer, {})
                and (number < slow_count or not PEERS[peer].is_slow)
            ]
            if left:
                yield (name, number), left


def run(
    path: Path, names: Sequence[str], peers: Sequence[str], *, count: int, slow_count: int
) -> None:
    """Every frame and peer that has no row yet."""
    path.parent.mkdir(parents=True, exist_ok=True)
    looks.end_line(path)
    made = {peer: looks.digest(peer) for peer in peers}
    log = path.with_suffix(".log")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        children = {
            peer: stack.enter_context(Child(peer, PEERS[peer].settings(), log)) for peer in peers
        }
        for key, left in missing(path, names, peers, count=count, slow_count=slow_count):
            frame, truth, others = draw(*key)
            frame_path = _pickled(folder, frame)
            for peer in left:
                look = look_of(children[peer].ask(frame_path, TIMEOUT_S), truth, others)
                looks.append(path, peer, made[peer], key, look)
            print(f"{key[0]}-{key[1]}: {len(left)} looked", flush=True)


def _pickled(folder: Path, frame: Frame) -> Path:
    path = folder / "frame.pickle"
    path.write_bytes(pickle.dumps(frame, protocol=5))
    return path


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("families", nargs="+", choices=[*FAMILIES, "all", "table"])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--slow-count", type=int, default=3, help="for the slow peers")
    parser.add_argument("--peers", nargs="+", default=list(PEERS), choices=list(PEERS))
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign/peers"))
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args()
    path = chosen.folder / "looks.jsonl"
    names = list(FAMILIES) if "all" in chosen.families else chosen.families
    names = [each for each in names if each in FAMILIES]
    if names:
        peers = present(chosen.peers)
        run(path, names, peers, count=chosen.count, slow_count=chosen.slow_count)
    known = looks.read(path)
    text = table({peer: known[peer] for peer in chosen.peers if peer in known})
    print(text, end="")
    if chosen.write:
        looks.write(RESULTS, known)
        page = PAGE.read_text(encoding="utf-8")
        before, after = page.partition(BEGIN)[0], page.partition(END)[2]
        PAGE.write_text(f"{before}{BEGIN}{text}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
