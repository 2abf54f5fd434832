"""Words of the command line that the campaigns share."""


def seeds_of(text: str) -> list[int]:
    """``1-3,7`` as [1, 2, 3, 7]. Raises ValueError for anything else."""
    seeds: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        seeds += range(int(first), int(last or first) + 1)
    return seeds
