"""The libraries that speak INDI, for tests that hold of each."""

import pytest

from rsoconsole.instruments.indi.client_choice import LIBRARIES

CLIENTS = [
    pytest.param(
        each.name,
        marks=pytest.mark.skipif(not each.is_there, reason=f"{each.package} is not installed"),
    )
    for each in LIBRARIES
]
