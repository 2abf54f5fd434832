"""STOP where the engine does not answer: by a connection to the INDI server from any console."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError
from rsoconsole.config import Config, IndiConfig, load_config
from rsoconsole.instruments.ports import StopResult


def stop_without_engine(
    on_found: Callable[[Mapping[str, Any]], None],
    indi: IndiConfig | None = None,
    *,
    config_path: Path | None = None,
    on_fault: Callable[[str], None] | None = None,
) -> None:
    """Stop the mount without the engine, by a connection of its own to the INDI server.

    ``on_found``: called with each result, in the form in which an engine answers a STOP: first the
    driver's answer, then the measured motion. Returns when the mount is at rest, or after half a
    minute, in which ABORT is repeated while the mount moves.

    ``indi``: settings of the session; None: those of the configuration at ``config_path``. Where
    that cannot be read, ``on_fault`` gets the error; without ``indi`` the default mount is
    stopped.
    """
    from rsoconsole.instruments.indi.wire_stop import stop_mount

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
    stop_mount(
        indi.host,
        indi.port,
        indi.mount,
        after_stop=config.mount.after_stop,
        on_result=lambda result: on_found(_as_answer(result)),
    )


def _as_answer(result: StopResult) -> dict[str, Any]:
    return {
        "is_answered": result.is_answered,
        "path": result.path,
        "ms": result.ms,
        "motion": None if result.motion is None else result.motion.kind,
        "rate_deg_s": result.rate_deg_s,
        "detail": result.detail,
    }
