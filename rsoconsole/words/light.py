"""Brightness in words: magnitudes ("mag 12.41±.03 V"), periods of light curves, glints."""

from collections.abc import Iterable

from rsoconsole.records import Band, StreakLight
from rsoconsole.words.angles import plus_minus, rounded_to_sigma

BAND_WORDS: dict[Band, str] = {"V": "V", "instrumental": "inst"}
"""Short name of each band: "inst" where 0 mag is 1 ADU a second, with no zero point known."""


def magnitude_words(light: StreakLight | None) -> str:
    """Format a streak's magnitude with its sigma and band: mag 12.41±.03 V.

    The sigma is that of noise and zero point. A saturated streak is brighter than measured: mag
    <8.21 V. Empty where no magnitude is known.
    """
    if light is None:
        return ""
    return light_words(light.mag, light.mag_sigma, light.band, is_saturated=light.is_saturated)


def light_words(
    mag: float | None, mag_sigma: float | None, band: Band | None, *, is_saturated: bool = False
) -> str:
    """Format a magnitude with its sigma and band, as ``magnitude_words`` does; None: not known."""
    if mag is None or band is None:
        return ""
    if is_saturated:
        figure = f"<{mag:.2f}"
    else:
        figure = f"{mag:.2f}" if mag_sigma is None else plus_minus(mag, mag_sigma)
    return f"mag {figure} {BAND_WORDS[band]}"


def light_detail_words(light: StreakLight | None, *, with_colour: bool = True) -> list[str]:
    """Return a streak's magnitude in full, as a list; empty where its light was not measured.

    After the magnitude come what the object's unknown colour adds to its sigma, unless
    ``with_colour`` is False, and what else is to be known of it.
    """
    if light is None:
        return []
    if light.mag is None:
        return ["no magnitude: its light is lost in the noise"]
    colour = light.mag_sigma_colour if with_colour else None
    parts = (
        magnitude_words(light),
        f"±{colour:.2f} by its unknown colour" if colour is not None else "",
        "saturated: it is brighter" if light.is_saturated else "",
        "blended with stars" if light.is_blended else "",
    )
    return [each for each in parts if each]


def column_band(bands: Iterable[Band | None]) -> Band:
    """Return the band of a column of magnitudes: instrumental only where all of them are."""
    known = {band for band in bands if band is not None}
    return "instrumental" if known == {"instrumental"} else "V"


def column_head(band: Band) -> str:
    """Return the head of a column of magnitudes in a band: mag, inst."""
    return "mag" if band == "V" else BAND_WORDS[band]


def column_words(mag: float | None, band: Band | None, column: Band) -> str:
    """Format a magnitude in a column of the band ``column``: its figure, "-" where not known.

    One of another band has no figure there, which would be read in the column's: inst.
    """
    if mag is None or band is None:
        return "-"
    return f"{mag:.2f}" if band == column else BAND_WORDS[band]


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
