"""The port of an INDI server, and the option of INDI's own tools for another one."""

INDI_PORT = 7624
"""Default port of an INDI server."""


def indi_port_option(port: int) -> str:
    """Return the port's option for a command line, with a space before it; empty for the default
    port."""
    return "" if port == INDI_PORT else f" -p {port}"
