"""Makes the reducer out of its parts: the network, the solver's process, the configuration."""

from collections.abc import Iterator
from contextlib import contextmanager

from rsoconsole.config import Config
from rsoconsole.instruments.solver import PlateSolver
from rsoconsole.pipeline.frame.plate import PlateFinder
from rsoconsole.pipeline.frame.reduce import FrameReducer
from rsoconsole.vision.detector import ConfidenceCurve, Network


@contextmanager
def open_reducer(config: Config) -> Iterator[tuple[FrameReducer, str]]:
    """A reducer ready to work, and the network's SHA-256.

    Raises ModelError when the network cannot be loaded, SolverError without index files.
    """
    network = Network.load(config.detector.model, config.detector.threads)
    curve = ConfidenceCurve.from_card(network.card)
    with PlateSolver(config.solver.index_dirs, start_s=config.waits.process_s) as solver:
        yield (
            FrameReducer(network, curve, PlateFinder(solver, config), config),
            str(network.card["sha256"]),
        )
