"""From nothing to ``streak_ssd.tflite``: draw, train, calibrate, export. ``--help`` says how.

Every stage resumes where it stopped, to the same bits as if it had not; the same seed and number
of threads on the same machine give the same network.
"""

import argparse
import json
import sys
import time
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch

from models.batches import BATCH, CROP_CELLS, batch, read_fields
from models.dataset import RUN, SEED, SHARDS, real_shards, write_shards
from models.fields import Field
from models.loss import loss_of
from models.scoring import Score, score
from models.streak_net import StreakNet
from rsoconsole.vision import ByteArray

PEAK_RATE = 3e-3
WARM_UP_STEPS = 300
AVERAGE_DECAY = 0.998
_JUDGED_EVERY = 5
"""Every fifth calibration field is evaluated during training."""


def rate_at(step: int, steps: int) -> float:
    """Learning rate at a step: a linear ramp, then half a cosine down to 1 % of the peak."""
    if step < WARM_UP_STEPS:
        return PEAK_RATE * (step + 1) / WARM_UP_STEPS
    share = (step - WARM_UP_STEPS) / max(1, steps - WARM_UP_STEPS)
    return PEAK_RATE * (0.01 + 0.99 * 0.5 * (1.0 + float(np.cos(np.pi * min(share, 1.0)))))


def answer_with(net: StreakNet) -> Any:
    """The network as a function from a NumPy map of bytes (h, w) to NumPy answers."""
    net.eval()

    def answer(values: ByteArray) -> Any:
        with torch.inference_mode():
            x = torch.from_numpy(values.astype(np.float32) / np.float32(255))[None, None]
            return net(x.to(memory_format=torch.channels_last))[0].numpy()

    return answer


class Training:
    """The network in training, with the state that resumes it from any checkpoint."""

    def __init__(
        self,
        run: Path,
        seed: int,
        steps: int,
        *,
        side: int = CROP_CELLS,
        is_bfloat16: bool = False,
        real_shards: int = 0,
    ) -> None:
        torch.manual_seed(seed)
        torch.use_deterministic_algorithms(True)
        torch.utils.deterministic.fill_uninitialized_memory = False
        self.run, self.seed, self.steps, self.step = run, seed, steps, 0
        self.side, self.is_bfloat16, self.real_shards = side, is_bfloat16, real_shards
        self.net = StreakNet().to(memory_format=torch.channels_last)
        self.average = deepcopy(self.net).eval()
        decayed = [p for p in self.net.parameters() if p.ndim > 1]
        plain = [p for p in self.net.parameters() if p.ndim <= 1]
        groups = [
            {"params": decayed, "weight_decay": 1e-3},
            {"params": plain, "weight_decay": 0.0},
        ]
        self.optimiser = torch.optim.AdamW(groups, lr=PEAK_RATE, fused=True)
        if self._checkpoint.exists():
            state = torch.load(self._checkpoint, weights_only=True)
            if state["settings"] != self._settings:
                raise SystemExit(
                    f"{run} was begun with {state['settings']}, not {self._settings}: "
                    "go on with those, or name another --run"
                )
            self.net.load_state_dict(state["net"])
            self.average.load_state_dict(state["average"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step = state["step"]
        pairs = [
            (kept, now)
            for kept, now in zip(
                self.average.state_dict().values(), self.net.state_dict().values(), strict=True
            )
            if kept.dtype.is_floating_point
        ]
        self._kept, self._now = [kept for kept, _ in pairs], [now for _, now in pairs]

    @property
    def _settings(self) -> dict[str, int | bool]:
        """Settings that a resumed run must share with its beginning."""
        return {
            "seed": self.seed,
            "steps": self.steps,
            "side": self.side,
            "bfloat16": self.is_bfloat16,
            "real_shards": self.real_shards,
        }

    @property
    def _checkpoint(self) -> Path:
        return self.run / "checkpoint.pt"

    def save(self) -> None:
        """Write a checkpoint, atomically."""
        partial = self._checkpoint.with_suffix(".part")
        torch.save(
            {
                "net": self.net.state_dict(),
                "average": self.average.state_dict(),
                "optimiser": self.optimiser.state_dict(),
                "step": self.step,
                "settings": self._settings,
            },
            partial,
        )
        partial.replace(self._checkpoint)

    def one_step(self, fields: list[Field]) -> tuple[float, float]:
        """Train on one batch; return the losses of confidence and of regression."""
        self.net.train()
        for group in self.optimiser.param_groups:
            group["lr"] = rate_at(self.step, self.steps)
        inputs, targets = batch(fields, BATCH, self.seed, self.step, self.side)
        x = torch.from_numpy(inputs).to(memory_format=torch.channels_last)
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.is_bfloat16):
            answer = self.net(x)
        confidence, regression = loss_of(answer.float(), torch.from_numpy(targets))
        self.optimiser.zero_grad(set_to_none=True)
        (confidence + regression).backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimiser.step()
        self.step += 1
        self._average()
        return confidence.item(), regression.item()

    def _average(self) -> None:
        decay = min(AVERAGE_DECAY, self.step / (self.step + 100))
        with torch.no_grad():
            torch._foreach_lerp_(self._kept, self._now, 1.0 - decay)


def summary(result: Score) -> dict[str, float]:
    """Figures for the training log, at one false candidate in 2 million cells."""
    logit = result.logit_for_false(int(result.cells / 2e6))
    bands = {"1.5-2": (1.5, 2), "2-3": (2, 3), "3-5": (3, 5), "5+": (5, 1e9)}
    figures = {f"recall_{name}": result.recall(logit, band) for name, band in bands.items()}
    figures["recall_short"] = result.recall(logit, (5, 1e9), (0.0, 8.0))
    figures |= {"logit": logit, "false": float(len(result.false_logits))}
    figures["middle_cells"] = (
        float(np.median(result.middle_errors)) if len(result.middle_errors) else -1
    )
    return {name: round(value, 4) for name, value in figures.items()}


def train(training: Training, fields: list[Field], judged: list[Field], every: int) -> None:
    """Train up to the last step, logging a line of JSON every ``every`` steps.

    ``judged``: fields for the logged figures.
    """
    path = training.run / "log.jsonl"
    _forget_after(path, training.step)
    sums, since, started, first = np.zeros(2), 0, time.monotonic(), training.step
    begun = started
    while training.step < training.steps:
        sums += training.one_step(fields)
        since += 1
        if training.step % 20 == 0:
            pace = (training.step - first) / (time.monotonic() - begun)
            left_min = (training.steps - training.step) / pace / 60
            show(training.step, training.steps, f"{sums[0] / since:.4f}, {left_min:.0f} min left")
        if training.step % every == 0 or training.step == training.steps:
            line = {
                "step": training.step,
                "rate": round(rate_at(training.step - 1, training.steps), 7),
                "confidence_loss": round(sums[0] / since, 5),
                "regression_loss": round(sums[1] / since, 5),
                "crops_per_s": round(BATCH * since / (time.monotonic() - started), 1),
            } | summary(score(judged, answer_with(training.average)))
            with path.open("a", encoding="utf-8") as log:
                print(json.dumps(line), file=log, flush=True)
            training.save()
            print(json.dumps(line), flush=True)
            sums, since, started = np.zeros(2), 0, time.monotonic()


def _forget_after(path: Path, step: int) -> None:
    """Drop the lines of a log that a kill left without their checkpoint."""
    if not path.exists():
        return
    lines = path.read_text(encoding="utf-8").splitlines()
    kept = [
        line for line in lines if line.endswith("}") and json.loads(line).get("step", 0) <= step
    ]
    path.write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")


def show(done: int, of: int, words: str) -> None:
    """Show a progress bar on stderr where that is a terminal."""
    if sys.stderr.isatty():
        bar = "#" * int(40 * done / max(of, 1))
        print(f"\r[{bar:<40}] {done / max(of, 1):6.1%} {words} \033[K", end="", file=sys.stderr)


def arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="python -m models.train", description=__doc__)
    parser.add_argument("--run", type=Path, default=RUN, help="its folder")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--steps", type=int, default=16000, help=f"batches of {BATCH} crops")
    parser.add_argument("--shards", type=int, default=SHARDS["train"], help="of 50 fields")
    parser.add_argument("--side", type=int, default=CROP_CELLS, help="of a crop, in cells")
    parser.add_argument(
        "--backgrounds",
        type=Path,
        default=None,
        metavar="DIR",
        help="pictures of the real sky to draw fields on too (models/backgrounds.py)",
    )
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--every", type=int, default=500, help="steps between checkpoints")
    parser.add_argument("--bfloat16", action="store_true", help="half the digits, faster")
    parser.add_argument("--folder", type=Path, default=None, help="of the result; default: models")
    parser.add_argument("--only-draw", action="store_true", help="stop after drawing")
    parser.add_argument("--no-export", action="store_true", help="stop after training")
    return parser.parse_args()


def main() -> None:
    """Run the command line: draw missing fields, train the remaining steps, export."""
    args = arguments()
    args.run.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(args.threads)
    data = args.run / "data"
    real = real_shards(args.backgrounds)
    counts = SHARDS | {"train": args.shards} | real
    drawing = write_shards(data, args.seed, counts, args.threads, args.backgrounds)
    for done, missing in drawing:
        show(done, missing, f"drawn {done} of {missing} shards")
    if sys.stderr.isatty():
        print(file=sys.stderr)
    if args.only_draw:
        return
    fields = read_fields(data, "train", args.shards)
    fields += read_fields(data, "real-train", real.get("real-train", 0))
    judged = read_fields(data, "calibrate", SHARDS["calibrate"])[::_JUDGED_EVERY]
    training = Training(
        args.run,
        args.seed,
        args.steps,
        side=args.side,
        is_bfloat16=args.bfloat16,
        real_shards=real.get("real-train", 0),
    )
    train(training, fields, judged, args.every)
    if not args.no_export:
        from models.export import export

        export(args.run, args.seed, args.threads, args.folder)


if __name__ == "__main__":
    main()
