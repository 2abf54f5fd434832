"""The trained verifier: says of the image of a line whether it is a streak, and where it ends."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.base import ModelError
from rsoconsole.records import FloatArray
from rsoconsole.vision.detector.network_file import load_interpreter
from rsoconsole.vision.lines.line_images import LINE_FIGURES, LINE_IMAGE_SHAPE, LineImages

VERIFIER_NAME = "line_verifier.tflite"
LINES_AT_ONCE = 16
"""Number of lines that the network takes at once."""
_REMEDY = "reinstall rsoconsole"


class Verifier:
    """Loaded network; not for use by two threads at once."""

    def __init__(self, interpreter: Any, card: Mapping[str, Any]) -> None:
        self.card = card
        self._interpreter = interpreter
        inputs = interpreter.get_input_details()
        self._images, self._figures = sorted(inputs, key=lambda each: -len(each["shape"]))
        self._output = interpreter.get_output_details()[0]

    @classmethod
    def load(cls, path: Path | None = None, threads: int = 1) -> "Verifier":
        """Load the network at ``path`` (None: the shipped one).

        Raises ModelError when a file is missing, damaged, or not a verifier.
        """
        model, card, interpreter = load_interpreter(VERIFIER_NAME, path, threads, _REMEDY)
        wanted = {(LINES_AT_ONCE, *LINE_IMAGE_SHAPE), (LINES_AT_ONCE, LINE_FIGURES)}
        if {tuple(each["shape"].tolist()) for each in interpreter.get_input_details()} != wanted:
            raise ModelError(f"the network {model} is no verifier of this program: {_REMEDY}")
        return cls(interpreter, card)

    def log_odds(self, lines: LineImages) -> FloatArray:
        """Log-odds (n,) that lines are streaks, in the population of the training."""
        count = len(lines.images)
        found = np.zeros(count)
        images = np.zeros((LINES_AT_ONCE, *LINE_IMAGE_SHAPE), dtype=np.float32)
        figures = np.zeros((LINES_AT_ONCE, LINE_FIGURES), dtype=np.float32)
        for first in range(0, count, LINES_AT_ONCE):
            part = slice(first, min(first + LINES_AT_ONCE, count))
            size = part.stop - part.start
            images[:size], figures[:size] = lines.images[part], lines.figures[part]
            self._interpreter.set_tensor(self._images["index"], images)
            self._interpreter.set_tensor(self._figures["index"], figures)
            self._interpreter.invoke()
            found[part] = self._interpreter.get_tensor(self._output["index"])[:size, 0]
        return found
