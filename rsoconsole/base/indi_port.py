"""The port of an INDI server, and what INDI's own tools are given to reach another."""

INDI_PORT = 7624
"""Default port of an INDI server."""


def indi_port_option(port: int) -> str:
    """For a command line, with a space before it; nothing where the port is the usual one."""
    return "" if port == INDI_PORT else f" -p {port}"
