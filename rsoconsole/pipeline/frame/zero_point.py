"""How much of the starlight comes through: a frame's zero point from its own catalogue stars."""

import logging

import numpy as np

from rsoconsole.errors import RsoconsoleError
from rsoconsole.pipeline.comparison import catalogue_stars
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.sky.stars import StarCatalogue
from rsoconsole.vision.stars import FEWEST_MATCHED, StarList, matched

log = logging.getLogger(__name__)

_BRIGHTEST, _MOST_STARS = slice(80), 600


class ZeroPoint:
    """Compares the stars of solved frames with the catalogue's magnitudes."""

    def __init__(self, catalogue: StarCatalogue | None = None) -> None:
        """``catalogue``: None for the shipped stars, read when they are first needed."""
        self._catalogue = catalogue
        self._is_broken = False

    def of(
        self, frame: Frame, stars: StarList, solution: Solution | NotSolved | None
    ) -> float | None:
        """Magnitude of a star of 1 ADU a second, median over the matched stars.

        The catalogue's band is not the camera's: compare nights and hours of one camera alone.
        None without a plate or exposure, for trailed stars, and where fewer than
        ``FEWEST_MATCHED`` unsaturated stars are in the catalogue.
        """
        is_usable = isinstance(solution, Solution) and stars.trail is None and frame.exposure_s
        if self._is_broken or not is_usable:
            return None
        assert isinstance(solution, Solution)
        assert frame.exposure_s is not None
        try:
            known = catalogue_stars(frame, solution, self._catalogue, _MOST_STARS)
        except RsoconsoleError as error:
            log.warning("no zero points: %s", error)
            self._is_broken = True
            return None
        if known is None:
            return None
        places, magnitude = known
        bright = np.flatnonzero(~stars.is_saturated & (stars.flux > 0.0))[_BRIGHTEST]
        mine_px = np.stack([stars.x_px, stars.y_px], axis=1)[bright]
        mine, theirs = matched(mine_px, places, max(stars.median_fwhm_px, 2.0))
        if len(mine) < FEWEST_MATCHED:
            return None
        rate_adu_s = stars.flux[bright][mine] / frame.exposure_s
        return float(np.median(magnitude[theirs] + 2.5 * np.log10(rate_adu_s)))
