"""How much of the starlight comes through: a frame's zero point from its own catalogue stars."""

import logging
import math

import numpy as np

from rsoconsole.errors import RsoconsoleError
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.sky import sky_to_pixel
from rsoconsole.sky.stars import J2000_JYEAR, StarCatalogue, julian_year
from rsoconsole.vision.stars import FEWEST_MATCHED, StarList, matched

log = logging.getLogger(__name__)

WIDEST_DEG = 4.0
"""Half a field's diagonal up to which the catalogue is asked."""
_BRIGHTEST, _MOST_STARS = slice(80), slice(600)


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
        diagonal_px = math.hypot(frame.width_px, frame.height_px)
        radius_deg = 0.5 * diagonal_px * solution.scale_arcsec_px / 3600.0
        if radius_deg > WIDEST_DEG:
            return None
        try:
            catalogue = self._catalogue or self._read(solution.dec_icrs_deg, radius_deg)
        except RsoconsoleError as error:
            log.warning("no zero points: %s", error)
            self._is_broken = True
            return None
        t_utc_ns = frame.t_mid_utc_ns
        cone = catalogue.cone(
            solution.ra_icrs_deg % 360.0,
            solution.dec_icrs_deg,
            radius_deg,
            epoch_jyear=J2000_JYEAR if t_utc_ns is None else julian_year(t_utc_ns),
        )
        magnitude = cone.magnitude[_MOST_STARS]
        x, y = sky_to_pixel(
            solution.wcs, cone.ra_icrs_deg[_MOST_STARS], cone.dec_icrs_deg[_MOST_STARS]
        )
        bright = np.flatnonzero(~stars.is_saturated & (stars.flux > 0.0))[_BRIGHTEST]
        mine_px = np.stack([stars.x_px, stars.y_px], axis=1)[bright]
        mine, theirs = matched(mine_px, np.stack([x, y], axis=1), max(stars.median_fwhm_px, 2.0))
        if len(mine) < FEWEST_MATCHED:
            return None
        rate_adu_s = stars.flux[bright][mine] / frame.exposure_s
        return float(np.median(magnitude[theirs] + 2.5 * np.log10(rate_adu_s)))

    def _read(self, dec_deg: float, radius_deg: float) -> StarCatalogue:
        catalogue = StarCatalogue.load()
        if catalogue.covers(dec_deg, radius_deg):
            return catalogue
        return StarCatalogue.load_whole_sky()
