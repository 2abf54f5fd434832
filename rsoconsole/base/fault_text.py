"""Rewrites validation errors of pydantic and click in plain words; finds the nearest known name."""

import difflib
import re
from collections.abc import Iterable

NOT_FINITE = "must be a number that can be worked with"
_PHRASES: tuple[tuple[str, str], ...] = (
    (r"Input should be a valid number, unable to parse string as a number", "must be a number"),
    (
        r"Input should be a valid integer, (?:unable to parse string as an integer"
        r"|got a number with a fractional part)",
        "must be a whole number",
    ),
    (r"Input should be a valid boolean, unable to interpret input", "must be true or false"),
    (r"Input should be a valid (integer|list|tuple|number|string|boolean)", r"must be a \1"),
    (r"Input should be a finite number", NOT_FINITE),
    (r"Input should be greater than or equal to", "must be at least"),
    (r"Input should be less than or equal to", "must be at most"),
    (r"Input should be greater than", "must be above"),
    (r"Input should be less than", "must be below"),
    (r"Input should be", "must be"),
    (r"Extra inputs are not permitted", "there is no such setting"),
    (r"Field required", "is missing"),
    (r"Value error, ", ""),
    (r"\. Did you mean", ": did you mean"),
    (r"must be a integer", "must be a whole number"),
)


def plain_fault(message: str) -> str:
    """Return a validation error's message in plain words."""
    for pattern, words in _PHRASES:
        message = re.sub(pattern, words, message)
    return message.strip().rstrip(".")


def nearest_name(name: str, known: Iterable[str]) -> str | None:
    """Return the known name most like ``name``; None where no name is similar.

    The last part of a dotted known name is compared too.
    """
    names = list(known)
    same_end = [each for each in names if each.rpartition(".")[2] == name.lower()]
    if len(same_end) == 1:
        return same_end[0]
    by_end = {each.rpartition(".")[2]: each for each in names}
    near_end = difflib.get_close_matches(name, by_end, n=1, cutoff=0.75)
    near = difflib.get_close_matches(name, names, n=1)
    if near_end:
        return by_end[near_end[0]]
    return near[0] if near else None
