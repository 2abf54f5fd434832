"""Images of proposed lines of known truth, drawn once and kept on disk: what the verifier learns.

A shard is a pure function of (seed, number) and of the product's search for lines, which proposes
them; a shard that exists is not drawn again.
"""

import math
import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from models.frames import TrueTrail
from models.line_scenes import LineScene, draw_scene
from rsoconsole.config import DetectorConfig
from rsoconsole.records import FloatArray
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import Ends, FrameProposals, Network, ProposalSearch, WorkingFrame

FRAMES_PER_SHARD = 40
MAX_LINES = 36
_FINE_SHARE, _TRACED_SHARE = 0.75, 0.35
_AS_TRUE = 2
"""Number of lines that are drawn near each trail, whatever was proposed."""
_END_SIGMA, _MAX_END_SIGMA_PX, _ACROSS_SIGMA_FWHM = 0.06, 12.0, 0.3
_MIN_OVERLAP = 0.45
CODES = np.array([30.0, 24.0, 24.0, 120.0], dtype=np.float32)[:, None, None]
"""Steps of a byte in one unit, by channel of an image."""

Rng = np.random.Generator


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lines:
    """Lines of drawn frames, n in all."""

    images: npt.NDArray[np.int8]
    """(n, channels, rows, columns), in steps of ``CODES``."""
    figures: npt.NDArray[np.float32]
    labels: npt.NDArray[np.int8]
    """1: a streak; 0: none; -1: a piece of one, or what counts neither way."""
    snrs: npt.NDArray[np.float32]
    """Integrated SNR of its streak; 0: of none."""
    ends: npt.NDArray[np.float32]
    """(n, 4) true ends from the proposed ones, a and b, along and across, in columns and rows."""
    frames: npt.NDArray[np.int64]
    """Number of the frame of each line."""


def lines_of(detection: ProposalSearch, number: int, seed: int) -> Lines:
    """Draw one frame; return its proposed lines, some traced, and lines near its trails."""
    rng = np.random.default_rng([seed, number, 5])
    scene = draw_scene(number, seed)
    seen = detection.search(scene.frame)
    lines = np.array([*_proposed(seen, rng), *_as_true(scene, seen, rng)]).reshape(-1, 4)
    lines = lines[np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]) > 3.0]
    made = seen.images(lines)
    fwhm_px = seen.focus.fwhm_px * seen.working.side
    labels, snrs = np.zeros(len(lines), np.int8), np.zeros(len(lines), np.float32)
    ends = np.zeros((len(lines), 4), np.float32)
    for i, line in enumerate(lines.tolist()):
        in_frame = np.array([seen.working.to_original_px(at) for at in line])
        labels[i], index = label(in_frame, scene.trails, fwhm_px)
        if labels[i] == 0 and label(in_frame, scene.others, fwhm_px)[0] != 0:
            labels[i] = -1
        if index >= 0:
            snrs[i] = scene.trails[index].peak_snr
            ends[i] = _ends_from(tuple(line), scene.trails[index], seen.working, made.scales[i])
    return Lines(
        images=np.clip(np.rint(made.images * CODES), -127, 127).astype(np.int8),
        figures=made.figures,
        labels=labels,
        snrs=snrs,
        ends=ends,
        frames=np.full(len(lines), number),
    )


def _proposed(seen: FrameProposals, rng: Rng) -> list[Ends]:
    """Ends of the best proposals and of some others; a share of them as a trace measures them."""
    proposals = seen.ranked()
    half = MAX_LINES // 2
    if len(proposals) > MAX_LINES:
        others = rng.choice(len(proposals) - half, half, replace=False) + half
        proposals = proposals[:half] + [proposals[i] for i in others]
    measured = seen.candidates()
    found = []
    for each in proposals:
        ends = each.box.ends_px
        if rng.random() < _TRACED_SHARE:
            ends = measured.traced_ends(each) or ends
        found.append(ends)
    return found


def _as_true(scene: LineScene, seen: FrameProposals, rng: Rng) -> list[Ends]:
    """Lines as a good proposal gives them, near each trail."""
    found = []
    for trail in scene.trails:
        ends = _in_working_px(trail, seen.working)
        length = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
        dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
        for _ in range(_AS_TRUE):
            a, b = rng.normal(0.0, min(_END_SIGMA * length, _MAX_END_SIGMA_PX), 2)
            va, vb = rng.normal(0.0, _ACROSS_SIGMA_FWHM * seen.focus.fwhm_px, 2)
            found.append(
                (
                    ends[0] + a * dx - va * dy,
                    ends[1] + a * dy + va * dx,
                    ends[2] + b * dx - vb * dy,
                    ends[3] + b * dy + vb * dx,
                )
            )
    return found


def _in_working_px(trail: TrueTrail, working: WorkingFrame) -> Ends:
    at = np.array([trail.x_a_px, trail.y_a_px, trail.x_b_px, trail.y_b_px])
    x_a, y_a, x_b, y_b = ((at + 0.5) / working.side - 0.5).tolist()
    return x_a, y_a, x_b, y_b


def label(line: FloatArray, trails: tuple[TrueTrail, ...], fwhm_px: float) -> tuple[int, int]:
    """Label of a line (x_a, y_a, x_b, y_b, px of the frame), and the index of its trail, or -1.

    ``fwhm_px``: of the stars. A streak where it lies on most of a trail and is not much longer.
    """
    x_a, y_a, x_b, y_b = line.tolist()
    length, touches = math.hypot(x_b - x_a, y_b - y_a), False
    angle_deg = math.degrees(math.atan2(y_b - y_a, x_b - x_a))
    near_px = max(2.0, 0.8 * fwhm_px)
    for index, trail in enumerate(trails):
        true_px = max(trail.length_px, 1.0)
        cos, sin = (trail.x_b_px - trail.x_a_px) / true_px, (trail.y_b_px - trail.y_a_px) / true_px
        off_x, off_y = (
            0.5 * (x_a + x_b) - trail.middle_px[0],
            0.5 * (y_a + y_b) - trail.middle_px[1],
        )
        along, across = abs(off_x * cos + off_y * sin), abs(off_y * cos - off_x * sin)
        turn = math.radians(line_angle_deg(angle_deg, math.degrees(math.atan2(sin, cos))))
        reach = 0.5 * length
        overlap = min(along + reach, 0.5 * true_px) - max(along - reach, -0.5 * true_px)
        if across + 0.5 * reach * math.sin(turn) < near_px and overlap > 0.0:
            if overlap > _MIN_OVERLAP * max(length, true_px):
                return 1, index
            touches = True
        elif overlap > -2.0 * fwhm_px and across < near_px + reach * math.sin(turn) + 3.0:
            touches = True
    return (-1, -1) if touches else (0, -1)


def _ends_from(
    line: Ends, trail: TrueTrail, working: WorkingFrame, scale: FloatArray
) -> tuple[float, ...]:
    """True ends from those of a line, along and across, in columns and rows of its image."""
    true = _in_working_px(trail, working)
    length = math.hypot(line[2] - line[0], line[3] - line[1])
    dx, dy = (line[2] - line[0]) / length, (line[3] - line[1]) / length
    places = sorted(
        (
            (true[k] - line[0]) * dx + (true[k + 1] - line[1]) * dy,
            (true[k + 1] - line[1]) * dx - (true[k] - line[0]) * dy,
        )
        for k in (0, 2)
    )
    _, column_px, row_px = scale.tolist()
    (u_a, v_a), (u_b, v_b) = places
    return u_a / column_px, v_a / row_px, (u_b - length) / column_px, v_b / row_px


_searches: dict[int, ProposalSearch] = {}


def _search(side_px: int) -> ProposalSearch:
    """Search of this process with cells of this side."""
    if not _searches:
        import cv2

        cv2.setNumThreads(1)
        network, settings = Network.load(None, 1), DetectorConfig(threads=1)
        for side in (2, 4):
            _searches[side] = ProposalSearch(network, settings, side_px=side)
    return _searches[side_px]


def shard_path(folder: Path, number: int) -> Path:
    """Path of one shard's file."""
    return folder / f"lines-{number:05d}.npz"


def write_shard(task: tuple[Path, int, int]) -> int:
    """Draw one shard (folder, seed, number) unless its file exists; return its number."""
    folder, seed, number = task
    path = shard_path(folder, number)
    if path.exists():
        return number
    rng = np.random.default_rng([seed, number, 9])
    first = number * FRAMES_PER_SHARD
    parts = [
        lines_of(_search(2 if rng.random() < _FINE_SHARE else 4), first + i, seed)
        for i in range(FRAMES_PER_SHARD)
    ]
    partial = path.with_suffix(".part.npz")
    np.savez(
        partial,
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in Lines.__dataclass_fields__
        },
    )
    partial.replace(path)
    return number


def write_shards(folder: Path, seed: int, count: int, processes: int) -> Iterator[tuple[int, int]]:
    """Draw all missing shards; yields (done, missing) after each."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [n for n in range(count) if not shard_path(folder, n).exists()]
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        tasks = [(folder, seed, number) for number in missing]
        for done, _ in enumerate(pool.imap_unordered(write_shard, tasks), start=1):
            yield done, len(missing)


def read_lines(folder: Path, count: int) -> Lines:
    """All lines of the first ``count`` shards."""
    parts = []
    for number in range(count):
        with np.load(shard_path(folder, number)) as shard:
            parts.append({name: shard[name] for name in Lines.__dataclass_fields__})
    return Lines(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
