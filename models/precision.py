"""Choice between float32 and int8: all are written and evaluated, the best one is shipped."""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from models.fields import Field
from models.scoring import Score, score
from rsoconsole.vision import NETWORK_HEIGHT_CELLS, NETWORK_WIDTH_CELLS, Network

INT8 = {"int8": "static_wi8_ai8", "int8-weights": "dynamic_wi8_afp32"}
"""Recipes of AI Edge Quantizer by the names of the int8 networks that they make."""
CELLS_PER_FALSE = 2e6
_WORTH = 0.8
"""Largest time of an int8 network that is shipped, as a fraction of float32's."""
_LOST = 0.005
"""Largest loss of recall of an int8 network that is shipped, against float32."""
_RUNS = 40
_LAST_LAYER = r"(.*_head/torch\.nn\.modules\.conv\.Conv2d.*)|serving_default_output.*"


def quantise(float_path: Path, path: Path, fields: Iterable[Field], recipe: str) -> None:
    """Write an int8 network by a recipe of AI Edge Quantizer; its last layer stays float32.

    The last layer gives logits and cosines, for which one common scale would be too coarse.
    ``static_wi8_ai8`` computes with 8 bits throughout, with ranges learned from ``fields``;
    ``dynamic_wi8_afp32`` has 8-bit weights and chooses the ranges of activations as it runs.
    """
    from ai_edge_quantizer import algorithm_manager, qtyping, quantizer
    from ai_edge_quantizer import recipe as recipes

    made = quantizer.Quantizer(str(float_path), getattr(recipes, recipe)())
    as_it_is = algorithm_manager.AlgorithmName.NO_QUANTIZE
    operations = qtyping.TFLOperationName
    for regex, operation in (
        (".*", operations.INPUT),
        (".*", operations.OUTPUT),
        (_LAST_LAYER, operations.ALL_SUPPORTED),
    ):
        made.update_quantization_recipe(regex, operation, None, as_it_is)
    result = None
    if made.need_calibration:
        (name,) = _inputs(float_path)
        maps = [{name: _padded(field)} for field in fields]
        signature = _signature(float_path)
        result = made.calibrate({signature: maps}, num_threads=2)
    path.unlink(missing_ok=True)
    made.quantize(result, serialize_to_path=path, enable_progress_report=False)


def _inputs(path: Path) -> list[str]:
    """Names of a network's inputs, as its first signature has them."""
    return list(_interpreter(path, 1).get_signature_list()[_signature(path)]["inputs"])


def network_at(path: Path, threads: int = 1) -> Network:
    """The network in a file without a card; its logits are not calibrated."""
    interpreter = _interpreter(path, threads)
    interpreter.allocate_tensors()
    return Network(interpreter, {"calibration": {"slope": 1.0, "offset": 0.0}})


def judged(path: Path, fields: list[Field], threads: int) -> dict[str, float]:
    """Figures of the network in a file on these fields.

    Recall at one false candidate in 2 million cells, the logit there, median time on one thread,
    and file size. ``threads``: for the evaluation.
    """
    result: Score = score(fields, network_at(path, threads).answer, lowest_logit=-4.0)
    logit = result.logit_for_false(int(result.cells / CELLS_PER_FALSE))
    network, values, times = network_at(path, 1), fields[0].values, []
    for _ in range(_RUNS):
        started = time.perf_counter()
        network.answer(values)
        times.append(time.perf_counter() - started)
    return {
        "recall": round(result.recall(logit), 4),
        "recall_2-3": round(result.recall(logit, (2.0, 3.0)), 4),
        "recall_short": round(result.recall(logit, (5.0, np.inf), (0.0, 8.0)), 4),
        "logit": round(logit, 3),
        "ms_one_thread": round(float(np.median(times)) * 1e3, 2),
        "kilobytes": round(path.stat().st_size / 1000),
    }


def choose(figures: dict[str, dict[str, float]]) -> str:
    """The name of the network to ship: float32 unless an int8 one is as good and clearly faster.

    ``figures``: of ``judged``, by name.
    """
    plain = figures["float32"]
    better = [
        name
        for name, of in figures.items()
        if name != "float32"
        and all(of[name] >= plain[name] - _LOST for name in plain if name.startswith("recall"))
        and of["ms_one_thread"] <= _WORTH * plain["ms_one_thread"]
    ]
    return min(better, key=lambda name: figures[name]["ms_one_thread"], default="float32")


def _padded(field: Field) -> Any:
    whole = np.zeros((1, 1, NETWORK_HEIGHT_CELLS, NETWORK_WIDTH_CELLS), dtype=np.float32)
    rows, columns = field.values.shape
    for top in range(0, NETWORK_HEIGHT_CELLS, rows):
        for left in range(0, NETWORK_WIDTH_CELLS, columns):
            part = whole[0, 0, top : top + rows, left : left + columns]
            part[:] = field.values[: part.shape[0], : part.shape[1]] / np.float32(255)
    return whole


def _interpreter(path: Path, threads: int) -> Any:
    from ai_edge_litert.interpreter import Interpreter

    return Interpreter(model_path=str(path), num_threads=threads)


def _signature(path: Path) -> str:
    return str(next(iter(_interpreter(path, 1).get_signature_list())))
