"""Brightness in words: magnitudes, periods of light curves, glints."""

from rsoconsole.words.angles import rounded_to_sigma


def period_words(period_s: float, sigma_s: float | None) -> str:
    """Format a period with its sigma: ``12.35 ± 0.02 s``."""
    value, spread = rounded_to_sigma(period_s, sigma_s, digits=2)
    return f"{value} ± {spread} s" if spread else f"{value} s"


def false_alarm_words(probability: float | None) -> str:
    """Format a false-alarm probability: ``1.2e-07``, ``below 1e-300``, ``0.35``."""
    if probability is None:
        return "-"
    return f"{probability:.2g}" if probability > 1e-300 else "below 1e-300"


def no_period_words(
    points: int, probability: float | None, shortest_s: float | None, longest_s: float | None
) -> str:
    """Format a search that found no period: what was searched, and how likely the best one is."""
    if probability is None or shortest_s is None or longest_s is None:
        return f"no period: {points} points are too few or too short in time to search"
    return (
        f"no period from {shortest_s:.3g} to {longest_s:.3g} s: the best has a false-alarm"
        f" probability of {false_alarm_words(probability)}"
    )


def glint_words(height_mag: float, duration_s: float, *, is_within_frame: bool) -> str:
    """Format a glint: ``2.3 mag for 0.5 s``; one of a whole frame lasted no longer than that."""
    most = "" if is_within_frame else "at most "
    return f"{height_mag:.1f} mag for {most}{duration_s:.2g} s"
