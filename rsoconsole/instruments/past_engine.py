"""STOP where the engine does not answer: by a connection of its own, from any seat."""

from rsoconsole.config import Config, IndiConfig, load_config
from rsoconsole.errors import ConfigError


def stop_past_engine(indi: IndiConfig | None) -> tuple[bool, str]:
    """Stop the mount by a connection of its own to the INDI server: (it stands, how or why not).

    ``indi`` as the session has it; None: as configured.
    """
    from rsoconsole.instruments.indi_wire import stop_mount

    try:
        config = load_config()
    except (ConfigError, OSError):
        config = Config()
    indi = indi or config.indi
    result = stop_mount(indi.host, indi.port, indi.mount, after_stop=config.mount.after_stop)
    return result.stopped, result.path if result.stopped else result.detail or "no reason given"
