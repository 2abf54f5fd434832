"""Find and follow satellites that nobody told you about."""

from typing import Any

__version__ = "0.1.0"
__all__ = ["LivePanel", "Session", "live_panel", "open_session"]

_HOMES = {
    "LivePanel": "rsoconsole.notebook",
    "Session": "rsoconsole.notebook.session",
    "live_panel": "rsoconsole.notebook",
    "open_session": "rsoconsole.notebook.session",
}


def __getattr__(name: str) -> Any:
    """What notebooks and scripts ask for; read when it is asked for, the verbs need none of it."""
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    # By name: the floors below must not lead up here by way of the package.
    return getattr(import_module(home), name)
