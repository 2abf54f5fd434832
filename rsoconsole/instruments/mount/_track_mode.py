"""The rate at which a mount tracks: INDI's TELESCOPE_TRACK_MODE."""

from rsoconsole.instruments.indi.indi_client import IndiClient

_MODE, _SIDEREAL = "TELESCOPE_TRACK_MODE", "TRACK_SIDEREAL"
_ANSWER_S = 3.0


def set_sidereal(client: IndiClient) -> str:
    """Set the sidereal rate, where a mount has another; return what was found, empty for nothing.

    A driver that does not take it is said to: the stars will tell how fast they drift.
    """
    mode = client.get(_MODE)
    if mode is None or mode.values.get(_SIDEREAL, True):
        return ""
    on = (name.removeprefix("TRACK_") for name, is_on in mode.values.items() if is_on)
    found = next(on, "of no name")
    before = client.send_switch(_MODE, _SIDEREAL)
    if client.wait(_MODE, lambda v: bool(v.values.get(_SIDEREAL)), _ANSWER_S, before) is None:
        why = client.failure_reason_since(before)
        return f"the mount stays at the tracking rate {found} ({why}): set it to sidereal"
    return f"the mount was set to track at the rate {found} by another program: sidereal again"
