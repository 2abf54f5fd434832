"""Who takes part: name, module and settings."""

import os
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from shutil import which
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
    ours: tuple[str, ...] = ()
    """Patterns of the project's files, beside its module, that take part in what it finds."""
    package: str = ""
    """What it needs that the product does not."""
    remedy: str = "pip install --no-deps -r requirements-peers.txt"
    """How that is had."""
    python_in: str = ""
    """Environment variable with the path of its own Python, where it cannot share this one."""

    def python(self) -> str:
        """Path of the Python that it runs in; empty where none is named."""
        return os.environ.get(self.python_in, "") if self.python_in else sys.executable

    def missing(self) -> str:
        """Why it cannot take part here, and what to do; empty where it can."""
        if self.python_in:
            return "" if which(self.python()) else f"no Python in {self.python_in}: {self.remedy}"
        if not self.package or find_spec(self.package) is not None:
            return ""
        return f"no package {self.package} here: {self.remedy}"

    def settings(self) -> Mapping[str, Any]:
        """The settings it runs with."""
        chosen: Mapping[str, Any] = getattr(self._module(), self.settings_name)
        return chosen

    def grid(self) -> tuple[Mapping[str, Any], ...]:
        """What is tried beside them when tuning."""
        changes: tuple[Mapping[str, Any], ...] = self._module().GRID
        return changes

    def open(self, settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
        """The detector, loaded."""
        opened: Callable[[Frame], list[Candidate]] = self._module().open_peer(settings)
        return opened

    def _module(self) -> Any:
        return import_module(f"tests.bench.peers.{self.module}")


_ASTRIDE = (
    "pip install --no-deps -r requirements-peers.txt git+https://github.com/dwkim78/ASTRiDE@83d9bce"
)
_DETECTOR = ("rsoconsole/vision/**/*.py", "models/streak_ssd.*", "models/line_verifier.*")
_SKY = ("rsoconsole/vision/frame/*.py",)
_STRETCH = (*_SKY, "tests/bench/peers/paper_recipe.py")
PEERS: Mapping[str, Peer] = {
    "rsoconsole": Peer(module="product", ours=_DETECTOR),
    "rsoconsole, paper's map and box": Peer(
        module="product", settings_name="PAPER_SETTINGS", ours=_DETECTOR
    ),
    "paper's recipe, full resolution": Peer(module="paper_recipe", ours=_DETECTOR),
    "photutils segmentation": Peer(module="photutils_segments", package="photutils"),
    "OpenCV LSD": Peer(module="opencv_lsd", ours=_STRETCH),
    "ASTRiDE": Peer(module="astride_contours", package="astride", remedy=_ASTRIDE),
    "acstools satdet": Peer(module="acs_satdet", is_slow=True, package="acstools"),
    "satdet's steps, short trails": Peer(
        module="acs_satdet", settings_name="SHORT_SETTINGS", package="skimage"
    ),
    "acstools findsat_mrt": Peer(module="acs_findsat", is_slow=True, ours=_SKY, package="acstools"),
    "findsat_mrt in tiles": Peer(
        module="acs_findsat",
        settings_name="TILE_SETTINGS",
        is_slow=True,
        ours=_SKY,
        package="acstools",
    ),
    "SENPAI": Peer(
        module="senpai_filters",
        is_slow=True,
        python_in="SENPAI_PYTHON",
        remedy="pip install astro-senpai==2.8.2 lazy-loader, in an environment of its own",
    ),
}


def present(names: Iterable[str]) -> list[str]:
    """Those that can take part here; the others are told with what to do."""
    there = []
    for name in names:
        why = PEERS[name].missing()
        if why:
            print(f"{name} takes no part: {why}", flush=True)
        else:
            there.append(name)
    return there
