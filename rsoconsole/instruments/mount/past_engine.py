"""STOP where the engine does not answer: by a connection of its own, from any seat."""

from collections.abc import Callable
from pathlib import Path

from rsoconsole.config import Config, IndiConfig, load_config
from rsoconsole.errors import ConfigError


def stop_past_engine(
    indi: IndiConfig | None = None,
    *,
    config_path: Path | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> tuple[bool, str]:
    """Stop the mount by a connection of its own to the INDI server: (it stands, how or why not).

    ``indi`` as the session has it; None: as configured. A configuration that cannot be read
    prevents nothing: ``on_fault`` is told, and the standard mount is stopped.
    """
    from rsoconsole.instruments.indi import stop_mount

    try:
        config = load_config(config_path)
    except (ConfigError, OSError) as error:
        config = Config()
        settings = indi or config.indi
        if on_fault is not None:
            on_fault(
                f"{error}; stopping '{settings.mount}' at {settings.host}:{settings.port} instead"
            )
    indi = indi or config.indi
    result = stop_mount(indi.host, indi.port, indi.mount, after_stop=config.mount.after_stop)
    return result.stopped, result.path if result.stopped else result.detail or "no reason given"
