"""Many versions of one long list that grows: what two have alike, they share."""

from collections.abc import Sequence
from typing import TypeAlias, TypeVar

Item = TypeVar("Item")
Chunks: TypeAlias = tuple[tuple[Item, ...], ...]
"""The items, in order, in chunks of one size."""
CHUNK = 256


def in_chunks(items: Sequence[Item], before: Chunks[Item]) -> Chunks[Item]:
    """The items in chunks, those of ``before`` where they are the same."""
    chunks = []
    for number, start in enumerate(range(0, len(items), CHUNK)):
        chunk = tuple(items[start : start + CHUNK])
        is_as_before = number < len(before) and before[number] == chunk
        chunks.append(before[number] if is_as_before else chunk)
    return tuple(chunks)
