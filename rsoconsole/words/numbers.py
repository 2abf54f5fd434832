"""Numbers as all that show them write them: what is missing, how many, how large."""


def number(value: float | None, form: str, unit: str = "", *, absent: str = "-") -> str:
    """A figure in a format of Python's with its unit; ``absent`` where there is none."""
    return absent if value is None else f"{value:{form}}{unit}"


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """ "1 streak", "2 streaks", "3 galaxies"."""
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"
