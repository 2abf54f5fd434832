"""How far two machines' answers lie apart."""

from typing import Any


def largest_difference(theirs: Any, ours: Any, unlike: set[str], at: str = "") -> float | str:
    """Largest relative difference of two JSON values; a sentence where they differ in kind.

    Keys named in ``unlike`` are passed over.
    """
    if isinstance(theirs, dict) and isinstance(ours, dict):
        keys = [key for key in theirs | ours if key not in unlike]
        return _worst(
            largest_difference(theirs.get(key), ours.get(key), unlike, f"{at}.{key}")
            for key in keys
        )
    if isinstance(theirs, list) and isinstance(ours, list) and len(theirs) == len(ours):
        pairs = zip(theirs, ours, strict=True)
        return _worst(
            largest_difference(a, b, unlike, f"{at}[{index}]") for index, (a, b) in enumerate(pairs)
        )
    if _is_number(theirs) and _is_number(ours):
        scale = max(abs(theirs), abs(ours))
        return abs(theirs - ours) / scale if scale else 0.0
    return 0.0 if theirs == ours else f"{at.lstrip('.')}: {theirs!r} there, {ours!r} here"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _worst(differences: Any) -> float | str:
    worst = 0.0
    for difference in differences:
        if isinstance(difference, str):
            return difference
        worst = max(worst, difference)
    return worst
