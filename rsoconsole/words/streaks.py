"""Streaks in a few words: "crossing, aircraft 0.83", "satellite 0.97, train of 5"."""

from collections import Counter
from collections.abc import Iterable

from rsoconsole.records import Detection, StreakLight
from rsoconsole.words.light import light_detail_words

PLAIN = ("satellite", "undetermined")


def streak_name(streak: Detection) -> str:
    """Format a streak's kind, class with probability, and train: crossing, aircraft 0.83.

    The kind "streak" and the class "undetermined" are left out; empty where nothing remains.
    """
    return streak_name_words(
        streak.kind, streak.object_class, streak.class_probability, train=streak.train
    )


def streak_name_words(kind: str, object_class: str, probability: float, *, train: int) -> str:
    """Format a streak's kind, class with probability, and train: crossing, aircraft 0.83.

    "streak", "undetermined" and a train of 0 are left out.
    """
    words = [] if kind == "streak" else [kind]
    if object_class != "undetermined":
        words.append(f"{object_class} {probability:.2f}")
    if train:
        words.append(f"train of {train}")
    return ", ".join(words)


def short_name_of(streak: Detection) -> str:
    """Return a streak's class, else its kind; empty for "undetermined" and "streak"."""
    if streak.object_class != "undetermined":
        return streak.object_class
    return "" if streak.kind == "streak" else streak.kind


def streak_size_words(streak: Detection) -> str:
    """Format a streak's length and width: 120×3.1 px."""
    return f"{streak.length_px:.0f}×{streak.width_px:.1f} px"


def streak_detail_words(streak: Detection, light: StreakLight | None = None) -> list[str]:
    """Return a streak's size, SNR, magnitude, name and pulse, as a list without empty items.

    ``light``: its brightness; None where it is not known.
    """
    snr = f"SNR {streak.snr:.0f}" if streak.snr else ""
    parts = (
        streak_size_words(streak),
        snr,
        *light_detail_words(light),
        streak_name(streak),
        streak_pulse_words(streak),
    )
    return [each for each in parts if each]


def streak_pulse_words(streak: Detection) -> str:
    """Format period and depth of a streak's varying brightness; empty where it is steady."""
    return pulse_words(
        streak.modulation_period_px, streak.modulation_period_s, streak.modulation_depth
    )


def pulse_words(period_px: float | None, period_s: float | None, depth: float | None) -> str:
    """Format period and depth of a varying brightness; empty where ``period_px`` is None."""
    if period_px is None:
        return ""
    period = f"{period_px:.1f} px"
    if period_s is not None:
        period = f"{period_s:.2f} s ({period})"
    return f"pulses every {period}, depth {depth or 0.0:.2f}"


def notable_streaks_words(streaks: Iterable[Detection]) -> str:
    """List the streaks that start no track, with the number of each; empty if there are none."""
    counts = Counter(
        streak_name(each)
        for each in streaks
        if each.kind == "crossing" or each.train or each.object_class not in PLAIN
    )
    return "; ".join(f"{n} x {words}" if n > 1 else words for words, n in counts.items())
