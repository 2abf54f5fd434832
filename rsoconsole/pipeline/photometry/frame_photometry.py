"""Magnitudes of one frame's streaks: zero point by its stars, light by its pixels.

Nothing waits for it: it is measured once the telescope has its next order.
"""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rsoconsole.pipeline.comparison.look_back import (
    SolvedField,
    star_positions_px,
    streak_ends_px,
    to_other_frame_px,
)
from rsoconsole.pipeline.photometry.catalogue_fluxes import MAG_PER_LN, catalogue_fluxes
from rsoconsole.pipeline.photometry.zero_point import ZeroPoint
from rsoconsole.records import (
    Detection,
    Detections,
    FloatArray,
    Frame,
    LightStep,
    Measurement,
    Photometry,
    Solution,
    StreakLight,
    measurement_id_of,
)
from rsoconsole.vision import (
    Background,
    StarImage,
    StarList,
    StreakFlux,
    fit_star_image,
    star_fluxes,
    streak_flux,
)

log = logging.getLogger(__name__)

LIMIT_SNR = 5.0
_MAX_STREAKS = 60
_BEFORE_SNR = 3.0
"""SNR from which a light in the frame before is one."""
_MIN_SNR = 1.0
"""SNR of a streak's light from which it has a magnitude."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameLight:
    """What a frame's photometry is measured from."""

    frame: Frame
    """With calibrated pixels."""
    stars: StarList
    background: Background
    streaks: tuple[tuple[str, Detection], ...]
    """Measurement id and streak of all that have a measurement, or a detection."""
    solution: Solution | None = None
    before: SolvedField | None = None
    """The solved frame before it; None where there is none."""

    @property
    def field(self) -> SolvedField | None:
        """The frame for comparison with another; None where it is not solved."""
        if self.solution is None:
            return None
        return SolvedField(frame=self.frame, stars=self.stars, solution=self.solution)


def light_streaks(
    found: Detections, measurements: tuple[Measurement, ...]
) -> tuple[tuple[str, Detection], ...]:
    """Return (measurement id, streak) of a frame's detections and of all that were measured."""
    measured = {each.measurement_id for each in measurements}
    streaks = (*found.detections, *(each.detection for each in found.rejected))
    named = [(measurement_id_of(found.frame_id, n), each) for n, each in enumerate(streaks)]
    first = len(found.detections)
    return (*named[:first], *(each for each in named[first:] if each[0] in measured))


def photometry_of(light: FrameLight, speeds_px_s: Mapping[str, float] | None = None) -> Photometry:
    """Measure zero point and magnitudes of a frame; it raises nothing.

    ``speeds_px_s``: speed of the tracks that took a streak, by measurement id: a streak that the
    frame cuts has a magnitude only where the speed is known.
    """
    try:
        return _Measured(light, speeds_px_s or {}).photometry()
    except Exception:
        # Brightness must not cost the night its loop.
        log.exception("frame %d: its brightness is not measured", light.frame.frame_id)
        return Photometry(frame_id=light.frame.frame_id)


class _Measured:
    """Photometry of one frame, step by step."""

    def __init__(self, light: FrameLight, speeds_px_s: Mapping[str, float]) -> None:
        self._light, self._speeds = light, speeds_px_s
        frame, stars = light.frame, light.stars
        self._image = fit_star_image(frame.pixels, light.background, stars, frame.saturation_adu)
        self._known_px = np.zeros((0, 2))
        self._sigma_adu: float | None = None

    def photometry(self) -> Photometry:
        frame = self._light.frame
        zero = self._zero_point()
        streaks = [self._streak(*each, zero) for each in self._light.streaks[:_MAX_STREAKS]]
        limiting = None
        if zero is not None and self._sigma_adu and frame.exposure_s:
            limiting = zero.mag - 2.5 * math.log10(LIMIT_SNR * self._sigma_adu / frame.exposure_s)
        return Photometry(
            frame_id=frame.frame_id,
            streaks=tuple(each for each in streaks if each is not None),
            zero_point_mag=None if zero is None else zero.mag,
            zero_point_sigma_mag=None if zero is None else zero.sigma_mag,
            zero_point_stars=0 if zero is None else zero.stars,
            zero_point_scatter_mag=None if zero is None else zero.scatter_mag,
            colour_term=None if zero is None else zero.colour_term,
            colour_term_sigma=None if zero is None else zero.colour_term_sigma,
            limiting_mag=limiting,
        )

    def _zero_point(self) -> ZeroPoint | None:
        field, frame = self._light.field, self._light.frame
        if field is None:
            return None
        found = catalogue_fluxes(field, self._light.background, self._image)
        if found is None:
            return None
        self._known_px, self._sigma_adu = found.known_px, found.flux_sigma_adu
        return found.zero_point((frame.width_px, frame.height_px))

    def _streak(self, name: str, streak: Detection, zero: ZeroPoint | None) -> StreakLight | None:
        light, frame = self._light, self._light.frame
        if streak.width_px <= 0.0 or not frame.exposure_s:
            return None
        ends = streak_ends_px(streak)
        stars = light.stars
        fwhm = stars.fwhm_at(streak.x_px, streak.y_px)
        found = streak_flux(
            frame.pixels,
            light.background,
            self._image.without_trail(),
            ends,
            stars_px=self._stars_beside(streak),
            was_there=self._was_there,
            saturation_adu=frame.saturation_adu,
            scale=fwhm / stars.median_fwhm_px,
        )
        if found is None:
            return None
        lit_s = frame.exposure_s
        if streak.is_clipped:
            speed = self._speeds.get(name)
            lit_s = min(found.length_px / speed, lit_s) if speed else math.nan
        return self._worded(name, streak, found, lit_s, zero)

    def _worded(
        self,
        name: str,
        streak: Detection,
        found: StreakFlux,
        lit_s: float,
        zero: ZeroPoint | None,
    ) -> StreakLight:
        exposure_s = self._light.frame.exposure_s or 1.0
        has_rate = math.isfinite(lit_s)
        lit_s = lit_s if has_rate else exposure_s
        rate, sigma = found.flux_adu / lit_s, found.sigma_adu / lit_s
        mag = mag_sigma = by_colour = None
        if has_rate and rate > _MIN_SNR * sigma:
            level, level_sigma = 0.0, 0.0
            if zero is not None:
                level, level_sigma = zero.along(_along(streak))
                by_colour = zero.colour_sigma_mag
            mag = level - 2.5 * math.log10(rate)
            mag_sigma = math.hypot(MAG_PER_LN * sigma / rate, level_sigma)
        per_s = found.length_px / lit_s
        steps = zip(found.step_px, found.step_adu_px, found.step_sigma_adu_px, strict=True)
        return StreakLight(
            measurement_id=name,
            flux_adu=found.flux_adu,
            flux_sigma_adu=found.sigma_adu,
            rate_adu_s=rate,
            rate_sigma_adu_s=sigma,
            band="instrumental" if zero is None else "V",
            mag=mag,
            mag_sigma=mag_sigma,
            mag_sigma_colour=by_colour,
            is_saturated=found.is_saturated,
            is_blended=found.is_blended,
            steps=tuple(
                LightStep(
                    t_s=round((u / found.length_px - 0.5) * exposure_s, 4),
                    rate_adu_s=float(f"{adu * per_s:.5g}"),
                    rate_sigma_adu_s=float(f"{adu_sigma * per_s:.3g}"),
                )
                for u, adu, adu_sigma in steps
            )
            if streak.kind == "streak"
            else (),
        )

    def _stars_beside(self, streak: Detection) -> FloatArray:
        """Places of stars: of the catalogue, and of the frame's own that are not on the line."""
        own = star_positions_px(self._light.stars)
        fwhm = self._light.stars.median_fwhm_px
        x_a, y_a, x_b, y_b = streak_ends_px(streak)
        length = max(math.hypot(x_b - x_a, y_b - y_a), 1e-6)
        dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
        along = (own[:, 0] - x_a) * dx + (own[:, 1] - y_a) * dy
        beside = np.abs((own[:, 1] - y_a) * dx - (own[:, 0] - x_a) * dy)
        # The streak may go on beyond the ends that were found.
        reach = 4.0 * fwhm + 0.2 * length
        is_on_it = (beside < 1.2 * fwhm) & (along > -reach) & (along < length + reach)
        confirmed = [n for n in np.flatnonzero(is_on_it) if self._was_there(*own[n])]
        is_on_it[confirmed] = False
        own = own[~is_on_it]
        if not len(self._known_px) or not len(own):
            return np.concatenate([own, self._known_px])
        near = np.hypot(*(self._known_px - (0.5 * (x_a + x_b), 0.5 * (y_a + y_b))).T)
        known = self._known_px[near < 0.5 * length + 20.0 * fwhm]
        apart = np.hypot(*(known[:, None] - own[None]).transpose(2, 0, 1)).min(axis=1, initial=9e9)
        return np.concatenate([own, known[apart > fwhm]])

    def _was_there(self, x_px: float, y_px: float) -> bool | None:
        """Whether the frame before shows light at the same place of the sky."""
        here, before = self._light.field, self._light.before
        if here is None or before is None:
            return None
        x, y = to_other_frame_px(here, before, np.array([x_px]), np.array([y_px]))
        stars = before.stars
        place = np.array([[float(x[0]), float(y[0])]])
        found = star_fluxes(
            before.frame.pixels,
            self._light.background,
            StarImage.gaussian(stars),
            place,
            saturation_adu=before.frame.saturation_adu,
            fwhm_px=stars.median_fwhm_px,
        )
        if not np.isfinite(found.flux_adu[0]):
            return None
        return bool(found.flux_adu[0] > _BEFORE_SNR * found.sigma_adu[0])


def _along(streak: Detection) -> FloatArray:
    """Five places along a streak, (5, 2)."""
    x_a, y_a, x_b, y_b = streak_ends_px(streak)
    t = np.linspace(0.1, 0.9, 5)
    return np.stack([x_a + t * (x_b - x_a), y_a + t * (y_b - y_a)], axis=1)
