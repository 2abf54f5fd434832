"""An INDI server's default port, and the option by which INDI's own tools accept another one."""

INDI_PORT = 7624


def indi_port_option(port: int) -> str:
    """Return the option for INDI's own tools that names ``port``, with a leading space.

    Empty for the default port.
    """
    return "" if port == INDI_PORT else f" -p {port}"
