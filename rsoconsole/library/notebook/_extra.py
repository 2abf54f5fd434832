"""Libraries of the extra ``notebook``: asked for when they are used, missed in plain words."""

from importlib import import_module
from typing import Any

from rsoconsole.base import RsoconsoleError


def needed(library: str, what: str) -> Any:
    """The library. Raises RsoconsoleError naming the extra where it is not installed."""
    try:
        return import_module(library)
    except ImportError as error:
        raise RsoconsoleError(
            f"{what} needs {library} ({error}): pip install 'rsoconsole[notebook]'"
        ) from error
