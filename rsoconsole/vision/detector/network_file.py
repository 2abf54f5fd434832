"""Files of the trained networks: found, checked against their .json, and loaded."""

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rsoconsole.base import ModelError, model_file_path, parse_json, read_foreign_text

ANOTHER_NETWORK = "or name another network in detector.model"
REINSTALL = f"reinstall rsoconsole, {ANOTHER_NETWORK}"


def load_interpreter(
    name: str, path: Path | None, threads: int, remedy: str = REINSTALL
) -> tuple[Path, dict[str, Any], Any]:
    """Load a network of TensorFlow Lite, the shipped one of this name where ``path`` is None.

    Returns its file, the content of the .json beside it, and its interpreter, ready to run. Raises
    ModelError when a file is missing or damaged, with the ``remedy``.
    """
    try:
        model = model_file_path(name) if path is None else path
    except FileNotFoundError as error:
        raise ModelError(f"{error}: {remedy}") from error
    card_path = model.with_suffix(".json")
    card = _read_card(card_path, remedy)
    try:
        content = model.read_bytes()
    except OSError as error:
        raise ModelError(f"the network {model} cannot be read ({error}): {remedy}") from error
    digest = hashlib.sha256(content).hexdigest()
    if digest != card["sha256"]:
        raise ModelError(
            f"the network {model} is not the one its {card_path.name} describes "
            f"(SHA-256 {digest[:12]}... instead of {card['sha256'][:12]}...): {remedy}"
        )
    with _quiet_stderr():
        interpreter = _interpreter(content, threads, model, remedy)
    return model, card, interpreter


def _read_card(path: Path, remedy: str) -> dict[str, Any]:
    try:
        card = parse_json(read_foreign_text(path))
    except (OSError, ValueError) as error:
        raise ModelError(
            f"{path}, which describes the network, cannot be read ({error}): {remedy}"
        ) from error
    needed = {"name", "version", "sha256"}
    if not isinstance(card, dict) or not needed <= card.keys():
        raise ModelError(f"{path} does not describe a network of this program: {remedy}")
    return card


def _interpreter(content: bytes, threads: int, model: Path, remedy: str) -> Any:
    try:
        from ai_edge_litert.interpreter import Interpreter
    except ImportError:
        try:
            from tflite_runtime.interpreter import Interpreter
        except ImportError as error:
            raise ModelError(
                "no TensorFlow Lite runtime is installed: pip install ai-edge-litert"
            ) from error
    try:
        interpreter = Interpreter(model_content=content, num_threads=threads)
        interpreter.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"the network {model} cannot be loaded ({error}): {remedy}") from error
    return interpreter


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Keep what the runtime's C++ prints while loading away from the terminal."""
    try:
        saved = os.dup(2)
    except OSError:
        yield
        return
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
