"""One streak of a low satellite by its two ends: places, times, and how well they are known. Pure.

What a shutter does to the time of a frame is common to both ends: it is no part of the errors here
(`low_fit.Timing` has it). Which end came first it does not say: `reversed` is the other sense.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import NS_PER_S, IntArray, position_angle_deg, separation_deg

UNSEEN_ARCSEC = 7200.0
"""Sigma along the streak of an end that is not in the frame: its line alone is known there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakEnds:
    """Where the light was when the shutter opened and when it closed, taken in one sense."""

    t_open_utc_ns: int
    t_close_utc_ns: int
    ra_icrs_deg: FloatArray
    """(2,) at the opening and at the closing."""
    dec_icrs_deg: FloatArray
    sigma_along_arcsec: FloatArray
    """(2,) of each end; ``UNSEEN_ARCSEC`` where it is not in the frame."""
    sigma_across_arcsec: FloatArray
    delay_s: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,) how much later than the frame's first row the rows of these places were exposed."""

    @property
    def exposure_s(self) -> float:
        """How long the shutter was open."""
        return (self.t_close_utc_ns - self.t_open_utc_ns) / NS_PER_S

    @property
    def t_mid_utc_ns(self) -> int:
        """Halfway between opening and closing, as the frame has it."""
        return (self.t_open_utc_ns + self.t_close_utc_ns) // 2

    @property
    def t_utc_ns(self) -> IntArray:
        """(2,) at which the light was at the two places."""
        late_ns = np.rint(self.delay_s * NS_PER_S).astype(np.int64)
        return np.array([self.t_open_utc_ns, self.t_close_utc_ns]) + late_ns

    @property
    def is_whole(self) -> bool:
        """Whether both ends are in the frame."""
        return bool(np.all(self.sigma_along_arcsec < UNSEEN_ARCSEC))

    @property
    def length_arcsec(self) -> float:
        """From end to end."""
        return 3600.0 * separation_deg(*self._first, *self._last)

    @property
    def speed_arcsec_s(self) -> float:
        """Of a whole streak."""
        return self.length_arcsec / (float(np.diff(self.t_utc_ns)[0]) / NS_PER_S)

    @property
    def rate_arcsec_s(self) -> FloatArray:
        """(2,) east and north, of a whole streak."""
        towards = np.radians(position_angle_deg(*self._first, *self._last))
        return self.speed_arcsec_s * np.array([np.sin(towards), np.cos(towards)])

    @property
    def covariances_arcsec2(self) -> FloatArray:
        """(2, 3) east-east, east-north, north-north of either end."""
        towards = np.radians(position_angle_deg(*self._first, *self._last))
        s, c = np.sin(towards), np.cos(towards)
        along, across = self.sigma_along_arcsec**2, self.sigma_across_arcsec**2
        parts = [along * s * s + across * c * c, (along - across) * s * c]
        return np.stack([*parts, along * c * c + across * s * s], axis=-1)

    def shaken(self, arcsec: float) -> "StreakEnds":
        """Each end by itself less sure by so much, in any direction."""
        return replace(
            self,
            sigma_along_arcsec=np.hypot(self.sigma_along_arcsec, arcsec),
            sigma_across_arcsec=np.hypot(self.sigma_across_arcsec, arcsec),
        )

    def of_unsure_length(self, arcsec: float) -> "StreakEnds":
        """Where a piece so long may be missing at either end, or be too much."""
        return replace(self, sigma_along_arcsec=np.hypot(self.sigma_along_arcsec, arcsec))

    @property
    def reversed(self) -> "StreakEnds":
        """The same streak, run through the other way."""
        names = ("ra_icrs_deg", "dec_icrs_deg", "sigma_along_arcsec", "sigma_across_arcsec")
        turned = {name: getattr(self, name)[::-1] for name in (*names, "delay_s")}
        return replace(self, **turned)

    @property
    def _first(self) -> tuple[float, float]:
        return float(self.ra_icrs_deg[0]), float(self.dec_icrs_deg[0])

    @property
    def _last(self) -> tuple[float, float]:
        return float(self.ra_icrs_deg[1]), float(self.dec_icrs_deg[1])
