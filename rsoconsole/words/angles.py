"""Figures in words: numbers, angles, directions."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

_MAX_DECIMALS = 7


def format_ra(ra_deg: float, decimals: int = 2) -> str:
    """Format a right ascension in degrees as 'hh:mm:ss.ss'."""
    text = _format_sexagesimal(ra_deg % 360.0 / 15.0, decimals)
    return text.replace("24:", "00:", 1) if text.startswith("24:") else text


def format_dec(dec_deg: float, decimals: int = 1) -> str:
    """Format a declination in degrees as '+dd:mm:ss.s'."""
    text = _format_sexagesimal(abs(dec_deg), decimals)
    return ("-" if dec_deg < 0 and text.strip("0:.") else "+") + text


def _format_sexagesimal(value: float, decimals: int) -> str:
    """Format a value that is not negative as 'aa:bb:cc.cc', rounded as a whole: 60 never shows."""
    scale = 10**decimals
    total = round(value * 3600.0 * scale)
    whole, fraction = divmod(total, scale)
    minutes, seconds = divmod(whole, 60)
    first, minutes = divmod(minutes, 60)
    tail = f".{fraction:0{decimals}d}" if decimals else ""
    return f"{first:02d}:{minutes:02d}:{seconds:02d}{tail}"


def direction(
    ra_deg: float, dec_deg: float, form: Literal["screen", "measured", "bare"] = "screen"
) -> str:
    """Format a direction: α 05:32:11.0 δ -04:52:10.

    ``form``: "measured" gives both angles one digit more, "bare" also leaves out α and δ.
    """
    if form == "screen":
        return f"α {format_ra(ra_deg, 1)} δ {format_dec(dec_deg, 0)}"
    ra, dec = format_ra(ra_deg), format_dec(dec_deg)
    return f"{ra} {dec}" if form == "bare" else f"α {ra} δ {dec}"


def altaz(alt_deg: float | None, az_deg: float | None) -> str:
    """Format altitude and azimuth: alt 45.1 az 123.4; empty where they are not known."""
    return "" if alt_deg is None or az_deg is None else f"alt {alt_deg:.1f} az {az_deg:.1f}"


def angle(arcsec: float, form: Literal["line", "cell"] = "line") -> str:
    """Format the size of an angle: 3.12″, 4.2′, 1.72°.

    ``form``: "cell" fits into five columns: 0.45″, 3.1″.
    """
    size, digits = abs(arcsec), 1 if form == "cell" else 2
    if size < 100.0:
        return f"{size:.{2 if size < 0.95 else digits}f}″"
    return f"{size / 60.0:.1f}′" if size < 5940.0 else f"{size / 3600.0:.{digits}f}°"


def signed_angle(arcsec: float) -> str:
    """Format an angle with its sign: +3.12″, -4.2′."""
    return f"{'-' if arcsec < 0.0 else '+'}{angle(arcsec)}"


def error_figure(value: float) -> str:
    """Format an error: two significant digits below 10, a whole number from there on."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def plus_minus(value: float, sigma: float | None) -> str:
    """Format value and sigma, both rounded to the sigma's first digit: 42165±9, .0002±.0001."""
    texts = rounded_to_sigma(value, sigma)
    return "±".join(text.removeprefix("0") if "." in text else text for text in texts if text)


def rounded_to_sigma(value: float, sigma: float | None, *, digits: int = 1) -> tuple[str, str]:
    """Return value and sigma as texts, both rounded to ``digits`` digits of the sigma.

    The sigma's text is empty where the sigma is None, not finite, or not above 0.
    """
    if sigma is None or not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.5g}", ""
    decimals = min(max(digits - 1 - math.floor(math.log10(sigma)), 0), _MAX_DECIMALS)
    spread = f"{sigma:.{decimals}f}"
    return f"{value:.{decimals}f}", spread if float(spread) else ""


def number(value: float | None, form: str, unit: str = "") -> str:
    """Format a number by the Python format ``form``, with its unit; "-" for None."""
    return "-" if value is None else f"{value:{form}}{unit}"


def count_words(count: int, noun: str, plural: str | None = None) -> str:
    """Format a number of things: "1 streak", "2 streaks", "3 galaxies"."""
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"


def join_words(words: Sequence[str]) -> str:
    """Join words with commas and "and": "a", "a and b", "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def short_figure(value: float) -> str:
    """Format a number to two decimals, without the zero before the point: .83."""
    return f"{value:.2f}".removeprefix("0")


def file_size(size_bytes: float) -> str:
    """Format a size in decimal units: 340 kB, 12.0 MB, 1.5 GB."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.1f} {unit}"
    return f"{size_bytes / 1e3:.0f} kB"


def settings_words(changes: Mapping[str, object]) -> str:
    """Format settings with their values: "filter.q_multiplier = 4, detector.tau = 0.2"."""
    return ", ".join(f"{name} = {value}" for name, value in changes.items())
