"""What was in my frame, from pixels: simulated frames that low and high objects cross.

Run: ``python -m tests.bench.bench_field_frames [frames] [seed...]``. Catalogues of 30,000, objects
off their elements within the model; every frame is rendered, searched by the detector, solved and
compared. Each object that drew at least 15 pixels with a matched SNR above 15 is asked for.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rsoconsole.config import Config
from rsoconsole.instruments import read_frame
from rsoconsole.pipeline import CatalogueMatcher, PlateMode, open_field_reader
from rsoconsole.pipeline.field.field_frame import FieldReader, FrameMatches
from rsoconsole.simulator.camera.truth import FrameTruth, SatelliteTruth
from tests.truth.simulated_fields import OPTICS, crowd, frames_in

SHORTEST_PX, FAINTEST_SNR = 15.0, 15.0
_NEAR_PX = 8.0


def drawn_px(each: SatelliteTruth) -> np.ndarray:
    """(n, 2) of its path that lies in the frame."""
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    start = np.array([each.x_start_px, each.y_start_px])
    path = start + share * (np.array([each.x_end_px, each.y_end_px]) - start)
    size = np.array([OPTICS.width_px, OPTICS.height_px])
    return path[np.all((path > 0.0) & (path < size - 1.0), axis=1)]


def asked_for(truth: FrameTruth) -> Iterator[tuple[SatelliteTruth, np.ndarray]]:
    """Objects that should be seen, with what they drew."""
    for each in truth.satellites:
        path = drawn_px(each)
        length = float(np.hypot(*(path[-1] - path[0]))) if len(path) > 1 else 0.0
        if length > SHORTEST_PX and each.snr_matched > FAINTEST_SNR and each.lit_fraction > 0.5:
            yield each, path


def judged(answer: FrameMatches, truth: FrameTruth, low: frozenset[int]) -> Counter[str]:
    """Counts by kind and word."""
    counted: Counter[str] = Counter()
    of_object: set[int] = set()
    for each, path in asked_for(truth):
        kind = "low" if each.norad_id in low else "high"
        mine = [
            n
            for n, d in enumerate(answer.detections)
            if np.hypot(*(path - [d.x_px, d.y_px]).T).min() < _NEAR_PX
            and np.hypot(*(path - [d.x_a_px, d.y_a_px]).T).min() < _NEAR_PX
        ]
        of_object |= set(mine)
        if not mine:
            counted[f"{kind}: not detected"] += 1
            continue
        words = {_word(answer, n, each.norad_id) for n in mine}
        word = "right" if "right" in words else min(words)
        counted[f"{kind}: {word}"] += 1
        if word != "right":
            print(each.norad_id, [(answer.detections[n], answer.match.lines[n]) for n in mine])
    others = [n for n in range(len(answer.detections)) if n not in of_object]
    for n in others:
        counted[f"other streaks: {answer.match.lines[n].verdict}"] += 1
    counted["frames"] += 1
    counted["candidates"] += len(answer.candidates)
    return counted


def _word(answer: FrameMatches, n: int, number: int) -> str:
    matched = answer.match.lines[n]
    best = matched.choices[0].candidate
    if matched.verdict == "ambiguous":
        return "ambiguous"
    if best is None:
        return "called unknown"
    return "right" if answer.candidates[best].entry.norad_id == number else "wrong"


def answers(
    reader: FieldReader, run: CatalogueMatcher, paths: Sequence[Path]
) -> Iterator[tuple[Path, FrameMatches]]:
    """Of each frame."""
    for number, path in enumerate(paths, start=1):
        yield path, run.match_frame(reader.read(read_frame(path, number)))


def main() -> None:
    """Seeds over, the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    seeds = [int(each) for each in sys.argv[2:]] or [0, 1, 2]
    mode: PlateMode = "auto"
    config = Config()
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, open_field_reader(config, mode) as reader:
        for seed in seeds:
            many = crowd(seed)
            made = frames_in(many, Path(folder), seed, count)
            run = CatalogueMatcher(config, many.entries)
            for (_, truth, low), (path, answer) in zip(
                made, answers(reader, run, [path for path, _, _ in made]), strict=True
            ):
                found = judged(answer, truth, low)
                print(path.name, answer.frame.plate_from, dict(found), flush=True)
                total += found
    for word in sorted(total):
        print(f"{total[word]:6d} {word}")


if __name__ == "__main__":
    main()
