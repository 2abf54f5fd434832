"""Who takes part: name, module and settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from rsoconsole.records import Frame
from tests.bench.peers.scoring import Candidate


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """One detector of the comparison."""

    module: str
    settings_name: str = "SETTINGS"
    is_slow: bool = False
    """It gets the first frames of a long run only: it takes long, or finds nothing by design."""

    def settings(self) -> Mapping[str, Any]:
        """The settings it runs with."""
        chosen: Mapping[str, Any] = getattr(self._module(), self.settings_name)
        return chosen

    def grid(self) -> tuple[Mapping[str, Any], ...]:
        """What is tried beside them when tuning."""
        tried: tuple[Mapping[str, Any], ...] = self._module().GRID
        return tried

    def open(self, settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
        """The detector, loaded."""
        opened: Callable[[Frame], list[Candidate]] = self._module().open_peer(settings)
        return opened

    def _module(self) -> Any:
        return import_module(f"tests.bench.peers.{self.module}")


PEERS: Mapping[str, Peer] = {
    "rsoconsole": Peer(module="product"),
    "rsoconsole, paper's map and box": Peer(module="product", settings_name="PAPER_SETTINGS"),
    "paper's recipe, full resolution": Peer(module="paper_recipe"),
    "photutils segmentation": Peer(module="photutils_segments"),
    "OpenCV LSD": Peer(module="opencv_lsd"),
    "acstools satdet": Peer(module="acs_satdet", is_slow=True),
    "satdet's steps, short trails": Peer(module="acs_satdet", settings_name="SHORT_SETTINGS"),
    "acstools findsat_mrt": Peer(module="acs_findsat", is_slow=True),
    "findsat_mrt in tiles": Peer(module="acs_findsat", settings_name="TILE_SETTINGS", is_slow=True),
}
