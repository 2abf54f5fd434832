"""The libraries that speak INDI, for tests that hold of each."""

import pytest

from rsoconsole.instruments.indi.client_choice import LIBRARIES

CLIENTS = [
    pytest.param(
        each.name,
        marks=pytest.mark.skipif(not each.is_installed, reason=f"{each.package} is not installed"),
    )
    for each in LIBRARIES
]

OTHERS_NIGHTLY = CLIENTS[:1] + [
    pytest.param(
        *each.values, marks=[*each.marks, pytest.mark.nightly("another library, the same orders")]
    )
    for each in CLIENTS[1:]
]
"""``CLIENTS``, of which the plain tier has the first alone. Both speak INDI in
``instruments/test_indi_clients.py``, in the plain tier too."""
