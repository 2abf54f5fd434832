"""What of a list of cases each run has, and what is nightly."""

from collections.abc import Iterable
from typing import Any

import pytest


def plain_first(count: int, cases: Iterable[Any], why: str = "more cases of the same") -> list[Any]:
    """Parameters of a test: the first ``count`` in the plain tier, the others nightly.

    A tuple is the values of several parameters, as pytest has it.
    """
    return [
        pytest.param(
            *(each if isinstance(each, tuple) else (each,)),
            marks=[pytest.mark.nightly(why)] if number >= count else [],
        )
        for number, each in enumerate(cases)
    ]
