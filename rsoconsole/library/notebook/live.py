"""The panel on the engine, as others ask for it: ``LivePanel`` needs ``rsoconsole[notebook]``."""

from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.library.formats.tables import needed

if TYPE_CHECKING:
    from rsoconsole.library.notebook.panel.panel import LivePanel


def live_panel(socket: Path | str | None = None, *, read_only: bool = False) -> "LivePanel":
    """A panel on the running engine, for a notebook: its state, its picture, its orders, STOP.

    ``socket``: the engine's, None for this user's own. ``read_only``: looks and stops, nothing
    else. Without an engine it says so and waits for one. Raises RsoconsoleError where the extra
    ``rsoconsole[notebook]`` is not installed.
    """
    needed("anywidget", "a live panel")
    from rsoconsole.library.notebook.panel.panel import LivePanel

    return LivePanel(socket, read_only=read_only)
