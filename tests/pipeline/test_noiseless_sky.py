"""Frames whose sky has neither noise nor stars: a plain streak is found, or a note says why not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rsoconsole as rso
from rsoconsole.records import FloatArray
from tests.truth.seen_satellites import SHARED

SIZE = 600, 800
ENDS = (200.0, 350.0), (520.0, 270.0)
REPORTED = SHARED.parent / "cases" / "17-streak-on-a-sky-without-noise" / "streak_on_zero.fits.gz"


def streak(peak: float, sigma_px: float) -> FloatArray:
    """A streak with a Gaussian profile from end to end, on zeros."""
    from scipy.special import erf

    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    (x_a, y_a), (x_b, y_b) = ENDS
    length = np.hypot(x_b - x_a, y_b - y_a)
    ux, uy = (x_b - x_a) / length, (y_b - y_a) / length
    along, across = (x - x_a) * ux + (y - y_a) * uy, -(x - x_a) * uy + (y - y_a) * ux
    ends = erf(along / sigma_px / np.sqrt(2)) - erf((along - length) / sigma_px / np.sqrt(2))
    return np.asarray(0.5 * peak * np.exp(-0.5 * (across / sigma_px) ** 2) * ends)


def clipped(level: float) -> Callable[[], FloatArray]:
    noise = np.random.default_rng(3).normal(0.0, 8.0, SIZE)
    return lambda: np.clip(streak(30.0, 1.2) + noise - level, 0.0, None)


SKIES: dict[str, Callable[[], FloatArray]] = {
    "real numbers": lambda: streak(3000.0, 1.2).astype(np.float32),
    "up to one": lambda: streak(1.0, 1.2).astype(np.float32),
    "16 bits": lambda: np.rint(streak(3000.0, 1.2)).astype(np.uint16),
    "8 bits": lambda: np.rint(streak(255.0, 1.2)).astype(np.uint8),
    "8 bits, saturated": lambda: np.clip(np.rint(streak(1000.0, 1.2)), 0, 255).astype(np.uint8),
    "8 bits, faint": lambda: np.rint(streak(12.0, 1.2)).astype(np.uint8),
    "over a level": lambda: np.rint(streak(3000.0, 1.2) + 100.0).astype(np.uint16),
    "cut off at the median": clipped(0.0),
    "cut off above it": clipped(20.0),
}
MISSED: dict[str, Callable[[], FloatArray]] = {
    "much wider than stars": lambda: streak(3000.0, 4.0).astype(np.float32),
    "narrower than any optics": lambda: streak(3000.0, 0.6).astype(np.float32),
    "nothing": lambda: np.zeros(SIZE, np.uint16),
    "one pixel": lambda: np.pad([[1000.0]], ((300, 299), (400, 399))),
    "below the sky": lambda: -streak(3000.0, 1.2).astype(np.float32),
}


@pytest.mark.parametrize("sky", SKIES)
def test_a_plain_streak_is_found(sky: str) -> None:
    found = rso.detect(SKIES[sky]())
    assert len(found) == 1
    (x_a, y_a), (x_b, y_b) = ENDS
    x, y = (found[name][0].to_value("pix") for name in ("x_px", "y_px"))
    assert np.hypot(x - 0.5 * (x_a + x_b), y - 0.5 * (y_a + y_b)) < 6.0


@pytest.mark.parametrize("sky", [each for each in SKIES if each != "cut off at the median"])
def test_a_sky_without_noise_is_said_to_be(sky: str) -> None:
    assert any("without noise" in note for note in rso.detect(SKIES[sky]()).meta["notes"])


@pytest.mark.parametrize("sky", MISSED)
def test_where_nothing_is_found_a_note_says_why(sky: str) -> None:
    found = rso.detect(MISSED[sky]())
    assert len(found) == 0
    assert any("without noise" in note for note in found.meta["notes"])


@pytest.mark.skipif(not REPORTED.exists(), reason="the reported frame is not there")
def test_the_streak_that_was_reported_is_found() -> None:
    assert len(rso.detect(Path(REPORTED))) == 1
