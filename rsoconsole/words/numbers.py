"""Numbers as all that show them write them: what is missing, how many, how large."""

from collections.abc import Mapping, Sequence


def number(value: float | None, form: str, unit: str = "", *, absent: str = "-") -> str:
    """A figure in a format of Python's with its unit; ``absent`` where there is none."""
    return absent if value is None else f"{value:{form}}{unit}"


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """ "1 streak", "2 streaks", "3 galaxies"."""
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"


def joined(words: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def short(value: float) -> str:
    """To two decimals, without the zero before the point."""
    return f"{value:.2f}".removeprefix("0")


def file_size(size_bytes: float) -> str:
    """Decimal units, as disks are sold."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.1f} {unit}"
    return f"{size_bytes / 1e3:.0f} kB"


def settings_words(changes: Mapping[str, object]) -> str:
    """Settings with their values: "filter.q_multiplier = 4, detector.tau = 0.2"."""
    return ", ".join(f"{name} = {value}" for name, value in changes.items())
