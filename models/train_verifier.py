"""From nothing to ``line_verifier.tflite``: draw, train, export. ``--help`` says how.

Every stage resumes where it stopped. 240 shards and 5,000 steps take two cores 70 minutes.
"""

import argparse
import hashlib
import json
import shutil
import sys
import time
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional

from models.line_net import LineNet
from models.line_scenes import SEED
from models.line_shards import CODES, FRAMES_PER_SHARD, Lines, read_lines, write_shards
from models.train import rate_at, show
from rsoconsole.vision import LINE_FIGURES, LINE_IMAGE_SHAPE, LINES_AT_ONCE, VERIFIER_NAME

RUN = Path("models/runs/verifier")
BATCH = 256
VERSION = "1"
AVERAGE_DECAY = 0.998
_HELD_EVERY = 12
"""Every twelfth shard is held back, to judge by."""
_MAX_END_ERROR, _END_WEIGHT = 12.0, 0.1
_BLANK_STARS, _SCALE = 0.1, 0.08
SNR_BANDS = ((6, 9), (9, 12), (12, 15), (15, 20), (20, 400))

Index = npt.NDArray[np.intp]


def examples(
    lines: Lines, index: Index, rng: np.random.Generator | None
) -> tuple[torch.Tensor, ...]:
    """Images, figures, labels and true ends of some lines; mirrored at random with ``rng``."""
    images = torch.from_numpy(lines.images[index]).float() / torch.from_numpy(CODES)
    images = images.to(memory_format=torch.channels_last)
    figures = torch.from_numpy(lines.figures[index])
    labels = torch.from_numpy((lines.labels[index] == 1).astype(np.float32))
    ends = torch.from_numpy(np.nan_to_num(lines.ends[index]))
    if rng is None:
        return images, figures, labels, ends

    def some(share: float) -> torch.Tensor:
        return torch.from_numpy(rng.random(len(index)) < share)

    mirrored = some(0.5)
    images[mirrored] = images[mirrored].flip(3)
    u_a, v_a, u_b, v_b = ends[mirrored].T
    ends[mirrored] = torch.stack([-u_b, v_b, -u_a, v_a], dim=1)
    turned = some(0.5)
    images[turned] = images[turned].flip(2)
    ends[turned, 1::2] *= -1.0
    scale = rng.uniform(1.0 - _SCALE, 1.0 + _SCALE, len(index)).astype(np.float32)
    images[:, 0] *= torch.from_numpy(scale)[:, None, None]
    blank = some(_BLANK_STARS)
    images[blank, 2] = images[blank, 2].clamp(max=0.0)
    return images, figures, labels, ends


class Training:
    """The network in training, with the state that resumes it from any checkpoint."""

    def __init__(self, run: Path, seed: int, steps: int) -> None:
        torch.manual_seed(seed)
        self.run, self.seed, self.steps, self.step = run, seed, steps, 0
        self.net = LineNet().to(memory_format=torch.channels_last)
        self.average = deepcopy(self.net).eval()
        decayed = [p for p in self.net.parameters() if p.ndim > 1]
        plain = [p for p in self.net.parameters() if p.ndim <= 1]
        self.optimiser = torch.optim.AdamW(
            [{"params": decayed, "weight_decay": 1e-2}, {"params": plain, "weight_decay": 0.0}]
        )
        if self._checkpoint.exists():
            state = torch.load(self._checkpoint, weights_only=True)
            if state["steps"] != steps:
                raise SystemExit(f"{run} was begun with {state['steps']} steps, not {steps}")
            self.net.load_state_dict(state["net"])
            self.average.load_state_dict(state["average"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step = state["step"]

    @property
    def _checkpoint(self) -> Path:
        return self.run / "checkpoint.pt"

    def save(self) -> None:
        """Write a checkpoint, atomically."""
        partial = self._checkpoint.with_suffix(".part")
        state = {
            "net": self.net.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "steps": self.steps,
        }
        torch.save(state, partial)
        partial.replace(self._checkpoint)

    def one_step(self, lines: Lines, learnt: Index) -> float:
        """Train on one batch; return the loss of the labels."""
        self.net.train()
        for group in self.optimiser.param_groups:
            group["lr"] = rate_at(self.step, self.steps)
        turn, place = divmod(self.step, len(learnt) // BATCH)
        order = np.random.default_rng([self.seed, 11, turn]).permutation(learnt)
        index = np.sort(order[place * BATCH : (place + 1) * BATCH])
        rng = np.random.default_rng([self.seed, 7, self.step])
        images, figures, labels, ends = examples(lines, index, rng)
        answer = self.net(images, figures)
        loss = functional.binary_cross_entropy_with_logits(answer[:, 0], labels)
        wanted = ends.clamp(-_MAX_END_ERROR, _MAX_END_ERROR)
        wrong = functional.smooth_l1_loss(answer[:, 1:], wanted, reduction="none", beta=0.5)
        of_ends = (wrong.mean(dim=1) * labels).sum() / labels.sum().clamp(min=1.0)
        self.optimiser.zero_grad(set_to_none=True)
        (loss + _END_WEIGHT * of_ends).backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimiser.step()
        self.step += 1
        decay = min(AVERAGE_DECAY, self.step / (self.step + 50))
        with torch.no_grad():
            pairs = zip(
                self.average.state_dict().values(), self.net.state_dict().values(), strict=True
            )
            for kept, now in pairs:
                if kept.dtype.is_floating_point:
                    kept.lerp_(now, 1.0 - decay)
        return loss.item()


def judged(net: LineNet, lines: Lines, held: Index) -> dict[str, float]:
    """Figures of a network on lines that it has not learnt.

    Recall by band of SNR where 5 and 1 false lines in 100 frames are let through.
    """
    net.eval()
    answers, wanted = [], []
    with torch.inference_mode():
        for first in range(0, len(held), 1024):
            images, figures, _, ends = examples(lines, held[first : first + 1024], None)
            answers.append(net(images, figures).numpy())
            wanted.append(ends.numpy())
    answer, ends_of = np.concatenate(answers), np.concatenate(wanted)
    said, is_true, snr = answer[:, 0], lines.labels[held] == 1, lines.snrs[held]
    false = np.sort(said[~is_true])[::-1]
    frames = len(np.unique(lines.frames[held]))
    figures_of = {"loss": float(np.logaddexp(0.0, np.where(is_true, -said, said)).mean())}
    for share in (0.05, 0.01):
        least = false[min(int(share * frames), len(false) - 1)]
        for low, high in SNR_BANDS:
            band = is_true & (snr >= low) & (snr < high)
            name = f"recall_{low}_{high}_at_{share:g}"
            figures_of[name] = float((said[band] > least).mean()) if band.any() else -1.0
    clear = is_true & (snr > 20)
    away = np.abs(answer[clear, 1:] - ends_of[clear])
    figures_of["end_columns"] = float(np.median(away[:, ::2]))
    figures_of["end_rows"] = float(np.median(away[:, 1::2]))
    return {name: round(value, 4) for name, value in figures_of.items()}


def train(training: Training, lines: Lines, every: int) -> dict[str, Any]:
    """Train up to the last step; log a line of JSON every ``every`` steps, return the last."""
    is_held = lines.frames // FRAMES_PER_SHARD % _HELD_EVERY == 0
    learnt = np.flatnonzero((lines.labels >= 0) & ~is_held)
    held = np.flatnonzero((lines.labels >= 0) & is_held)
    started, first, losses = time.monotonic(), training.step, list[float]()
    line: dict[str, Any] = {"lines": len(learnt)} | judged(training.average, lines, held)
    while training.step < training.steps:
        losses.append(training.one_step(lines, learnt))
        pace = (training.step - first) / (time.monotonic() - started)
        left_min = (training.steps - training.step) / pace / 60
        show(training.step, training.steps, f"{losses[-1]:.4f}, {left_min:.0f} min left")
        if training.step % every == 0 or training.step == training.steps:
            line = {"step": training.step, "lines": len(learnt)}
            line |= {"learnt_loss": round(float(np.mean(losses)), 4)}
            line |= judged(training.average, lines, held)
            with (training.run / "log.jsonl").open("a", encoding="utf-8") as log:
                print(json.dumps(line), file=log, flush=True)
            training.save()
            print(json.dumps(line), flush=True)
            losses.clear()
    return line


def export(net: LineNet, folder: Path, figures: dict[str, Any]) -> None:
    """Write the network as TensorFlow Lite, with its card."""
    import litert_torch

    generator = torch.Generator().manual_seed(1)
    example = (
        torch.randn(LINES_AT_ONCE, *LINE_IMAGE_SHAPE, generator=generator),
        torch.randn(LINES_AT_ONCE, LINE_FIGURES, generator=generator),
    )
    net = net.eval().to(memory_format=torch.contiguous_format)
    converted = litert_torch.convert(net, example)
    path = folder / VERIFIER_NAME
    converted.export(str(path))
    with torch.inference_mode():
        away = np.abs(np.asarray(converted(*example)) - net(*example).numpy()).max()
    card = {
        "name": Path(VERIFIER_NAME).stem,
        "version": VERSION,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "input": {
            "images": [LINES_AT_ONCE, *LINE_IMAGE_SHAPE],
            "figures": [LINES_AT_ONCE, LINE_FIGURES],
        },
        "output": ["log-odds", "a along", "a across", "b along", "b across"],
        "parameters": sum(p.numel() for p in net.parameters()),
        "conversion_difference": float(away),
        "training": figures,
    }
    path.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")


def arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="python -m models.train_verifier", description=__doc__)
    parser.add_argument("--run", type=Path, default=RUN, help="its folder")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--shards", type=int, default=240, help="of 40 frames")
    parser.add_argument("--steps", type=int, default=5000, help=f"batches of {BATCH} lines")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--every", type=int, default=250, help="steps between checkpoints")
    parser.add_argument("--folder", type=Path, default=None, help="of the result; default: models")
    parser.add_argument("--only-draw", action="store_true", help="stop after drawing")
    return parser.parse_args()


def main() -> None:
    """Run the command line: draw missing shards, train the remaining steps, export."""
    args = arguments()
    folder = args.folder or Path(__file__).parent
    torch.set_num_threads(args.threads)
    for done, missing in write_shards(args.run / "lines", args.seed, args.shards, args.threads):
        show(done, missing, f"drawn {done} of {missing} shards")
    if sys.stderr.isatty():
        print(file=sys.stderr)
    if args.only_draw:
        return
    training = Training(args.run, args.seed, args.steps)
    figures = train(training, read_lines(args.run / "lines", args.shards), args.every)
    export(training.average, folder, figures)
    shutil.copyfile(args.run / "log.jsonl", folder / "line_verifier_log.jsonl")


if __name__ == "__main__":
    main()
