"""The rate at which a mount tracks: INDI's TELESCOPE_TRACK_MODE."""

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_client import IndiClient

_MODE, _SIDEREAL = "TELESCOPE_TRACK_MODE", "TRACK_SIDEREAL"


def set_sidereal(client: IndiClient, answer_s: float) -> str:
    """Set the sidereal rate, where a mount has another; return that in words, empty for none.

    ``answer_s``: longest time that the driver may take. Raises InstrumentError where it does not
    take the sidereal rate.
    """
    mode = client.get(_MODE)
    if mode is None or mode.values.get(_SIDEREAL, True):
        return ""
    on = (name.removeprefix("TRACK_") for name, is_on in mode.values.items() if is_on)
    found = next(on, "of no name")
    before = client.send_switch(_MODE, _SIDEREAL)
    if client.wait(_MODE, lambda v: bool(v.values.get(_SIDEREAL)), answer_s, before) is None:
        raise InstrumentError(
            f"the mount tracks at the rate {found} and does not take the sidereal one"
            f" ({client.failure_reason_since(before)}): set it in its driver"
        )
    return f"the mount was set to track at the rate {found} by another program: sidereal again"
