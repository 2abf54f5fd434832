"""Predicted places on the sky: at one instant, and along a path. Pure."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD, IntArray, direction_to_unit
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedPosition:
    """Predicted place at one instant, as a plate solution would measure it, with its covariance."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_arcsec_s: FloatArray
    """Rate (2,), east and north."""
    covariance_arcsec2: FloatArray
    """Covariance (2, 2) of the place, east and north."""

    @property
    def direction_deg(self) -> tuple[float, float]:
        """Right ascension and declination, ICRS."""
        return self.ra_icrs_deg, self.dec_icrs_deg

    @property
    def speed_arcsec_s(self) -> float:
        """Angular speed on the sky."""
        return math.hypot(*self.rate_arcsec_s.tolist())

    @property
    def sigma_arcsec(self) -> float:
        """Half the longer axis of the one-sigma ellipse."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance_arcsec2)[-1], 0.0)))

    @property
    def variance_along_arcsec2(self) -> float:
        """Variance along the motion."""
        return float(self.along_across_arcsec2[0, 0])

    @property
    def along_across_arcsec2(self) -> FloatArray:
        """Covariance (2, 2) along the motion and across it (north of an eastward motion)."""
        speed = max(self.speed_arcsec_s, 1e-9)
        e, n = (each / speed for each in self.rate_arcsec_s.tolist())
        (ee, en), (_, nn) = self.covariance_arcsec2.tolist()
        mixed = e * n * (nn - ee) + (e * e - n * n) * en
        along = e * e * ee + 2.0 * e * n * en + n * n * nn
        return np.array([[along, mixed], [mixed, ee + nn - along]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedSkyPath:
    """Predicted places at N instants in order, close enough for cubic interpolation."""

    t_utc_ns: IntArray
    lines: FloatArray
    """Unit vectors (N, 3) to the places."""
    rates: FloatArray
    """Changes (N, 3) of the unit vectors, rad/s, at right angles to them."""
    along_across_arcsec2: FloatArray
    """Covariances (N, 2, 2) along the motion and across it (north of an eastward motion)."""

    @property
    def from_utc_ns(self) -> int:
        """First instant of the path."""
        return int(self.t_utc_ns[0])

    @property
    def until_utc_ns(self) -> int:
        """Last instant of the path."""
        return int(self.t_utc_ns[-1])

    def at(self, t_utc_ns: int) -> PredictedPosition | None:
        """Predict the place at an instant; None outside the instants of the path."""
        if not self.from_utc_ns <= t_utc_ns <= self.until_utc_ns:
            return None
        # Plain numbers: a leap asks for some forty places, and arrays of three are slow.
        n = min(int(np.searchsorted(self.t_utc_ns, t_utc_ns, "right")), len(self.t_utc_ns) - 1) - 1
        h = float(self.t_utc_ns[n + 1] - self.t_utc_ns[n]) / NS_PER_S
        u = float(t_utc_ns - self.t_utc_ns[n]) / NS_PER_S / h
        w = 1.0 - u
        of_line = ((1 + 2 * u) * w * w, u * w * w * h, u * u * (3 - 2 * u), -u * u * w * h)
        of_rate = (-6 * u * w / h, w * (1 - 3 * u), 6 * u * w / h, u * (3 * u - 2))
        ends = (self.lines[n], self.rates[n], self.lines[n + 1], self.rates[n + 1])
        values = list(zip(*(each.tolist() for each in ends), strict=True))
        x, y, z = (_combined(of_line, each) for each in values)
        rate = [_combined(of_rate, each) for each in values]
        aside = math.hypot(x, y)
        sine_ra, cosine_ra = (y / aside, x / aside) if aside > 0.0 else (0.0, 1.0)
        sine_dec, cosine_dec = (each / math.hypot(aside, z) for each in (z, aside))
        east = (cosine_ra * rate[1] - sine_ra * rate[0]) / ARCSEC_RAD
        north = cosine_dec * rate[2] - sine_dec * (cosine_ra * rate[0] + sine_ra * rate[1])
        north /= ARCSEC_RAD
        speed = max(math.hypot(east, north), 1e-9)
        e, f = east / speed, north / speed
        (aa, ax), (_, xx) = (
            w * self.along_across_arcsec2[n] + u * self.along_across_arcsec2[n + 1]
        ).tolist()
        ee = e * e * aa - 2.0 * e * f * ax + f * f * xx
        en = e * f * (aa - xx) + (e * e - f * f) * ax
        return PredictedPosition(
            t_utc_ns=t_utc_ns,
            ra_icrs_deg=math.degrees(math.atan2(y, x)) % 360.0,
            dec_icrs_deg=math.degrees(math.atan2(z, aside)),
            rate_arcsec_s=np.array([east, north]),
            covariance_arcsec2=np.array([[ee, en], [en, aa + xx - ee]]),
        )


_Four = tuple[float, float, float, float]


def _combined(by: _Four, values: _Four) -> float:
    return by[0] * values[0] + by[1] * values[1] + by[2] * values[2] + by[3] * values[3]


def sky_path_through(places: list[PredictedPosition]) -> PredictedSkyPath:
    """Make a path through predicted places, at least two, in order of time."""
    ra, dec = (np.array([each.direction_deg[n] for each in places]) for n in (0, 1))
    lines = direction_to_unit(ra, dec)
    a = np.radians(ra)
    east = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=-1)
    north = np.cross(lines, east)
    on_sky = np.array([each.rate_arcsec_s for each in places]) * ARCSEC_RAD
    return PredictedSkyPath(
        t_utc_ns=np.array([each.t_utc_ns for each in places], np.int64),
        lines=lines,
        rates=on_sky[:, :1] * east + on_sky[:, 1:] * north,
        along_across_arcsec2=np.stack([each.along_across_arcsec2 for each in places]),
    )
