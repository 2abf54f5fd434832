"""A frame's streaks against catalogue stars, whose light the frame's own stars calibrate."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.pipeline.comparison.solved_field import SolvedField, Word, ends_of, places_px
from rsoconsole.reasons import NotAStreak
from rsoconsole.records import Detection, FloatArray, Frame, Solution
from rsoconsole.sky import sky_to_pixel
from rsoconsole.sky.stars import J2000_JYEAR, StarCatalogue, julian_year
from rsoconsole.vision.detector import catalogue_light
from rsoconsole.vision.stars import FEWEST_MATCHED, matched

_COMPLETE_MAG = 10.0
"""The catalogue lacks no star brighter than this to a camera without a filter, red ones apart."""
_WIDEST_DEG = 4.0
"""Half a field's diagonal up to which the catalogue is asked."""
_BRIGHTEST, _MOST_STARS = slice(80), 1500
"""Stars of a frame that are looked for among the catalogue's, and how many of those; there are
fewer above the magnitude of completeness in the widest field."""


def catalogue_stars(
    frame: Frame, solution: Solution, catalogue: StarCatalogue | None, most: int
) -> tuple[FloatArray, FloatArray] | None:
    """Places in pixels (n, 2) and magnitudes of a frame's brightest catalogue stars.

    ``catalogue``: None for the shipped stars. None where the field is too wide; raises
    RsoconsoleError where the catalogue cannot be read.
    """
    diagonal_px = math.hypot(frame.width_px, frame.height_px)
    radius_deg = 0.5 * diagonal_px * solution.scale_arcsec_px / 3600.0
    if radius_deg > _WIDEST_DEG:
        return None
    if catalogue is None:
        catalogue = StarCatalogue.load()
        if not catalogue.covers(solution.dec_icrs_deg, radius_deg):
            catalogue = StarCatalogue.load_whole_sky()
    t_utc_ns = frame.t_mid_utc_ns
    cone = catalogue.cone(
        solution.ra_icrs_deg % 360.0,
        solution.dec_icrs_deg,
        radius_deg,
        epoch_jyear=J2000_JYEAR if t_utc_ns is None else julian_year(t_utc_ns),
    )
    x, y = sky_to_pixel(solution.wcs, cone.ra_icrs_deg[:most], cone.dec_icrs_deg[:most])
    return np.stack([x, y], axis=1), cone.magnitude[:most]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownStars:
    """Catalogue stars of a frame's field, with the light that they promise."""

    here: SolvedField
    places_px: FloatArray
    light_adu: FloatArray
    complete_adu: float

    @classmethod
    def of(cls, here: SolvedField, catalogue: StarCatalogue | None) -> "KnownStars | None":
        """None where the field is too wide, or too few of its stars are in the catalogue."""
        known = catalogue_stars(here.frame, here.solution, catalogue, _MOST_STARS)
        if known is None:
            return None
        places, magnitude = known
        stars, fwhm = here.stars, here.stars.median_fwhm_px
        bright = np.flatnonzero(~stars.is_saturated)[_BRIGHTEST]
        mine, theirs = matched(places_px(stars)[bright], places, max(fwhm, 2.0))
        if len(mine) < FEWEST_MATCHED:
            return None
        # Magnitude of a star that gives 1 ADU.
        zero_mag = float(np.median(magnitude[theirs] + 2.5 * np.log10(stars.flux[bright][mine])))
        return cls(
            here=here,
            places_px=places,
            light_adu=np.asarray(10.0 ** (-0.4 * (magnitude - zero_mag))),
            complete_adu=10.0 ** (-0.4 * (_COMPLETE_MAG - zero_mag)),
        )

    def word(self, streak: Detection) -> Word | None:
        """What the catalogue says of one streak; None where nothing."""
        light = catalogue_light(
            self.here.frame.pixels,
            self.places_px,
            self.light_adu,
            ends=ends_of(streak),
            width_px=max(streak.width_px, self.here.stars.median_fwhm_px),
            complete_adu=self.complete_adu,
        )
        if light is None or light.said == "unclear":
            return None
        if light.said == "no stars":
            return Word(comparison="no catalogue stars")
        reason = NotAStreak(kind="catalogue stars", value=light.stars)
        return Word(comparison="catalogue stars", reason=reason)
