"""Where something will be on the sky: at one instant, and along its path for a while. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import direction_to_unit, unit_to_direction
from rsoconsole.sky.times import ARCSEC_RAD, NS_PER_S, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyAhead:
    """Where it will be, as a plate solution would measure it, and how sure that is."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_arcsec_s: FloatArray
    """(2,) east and north."""
    covariance_arcsec2: FloatArray
    """(2, 2) of the place, east and north."""

    @property
    def direction_deg(self) -> tuple[float, float]:
        """Right ascension and declination, ICRS."""
        return self.ra_icrs_deg, self.dec_icrs_deg

    @property
    def speed_arcsec_s(self) -> float:
        """On the sky."""
        return float(np.hypot(*self.rate_arcsec_s))

    @property
    def sigma_arcsec(self) -> float:
        """Half the longer axis of the one-sigma ellipse."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance_arcsec2)[-1], 0.0)))

    @property
    def along_across_arcsec2(self) -> FloatArray:
        """(2, 2) covariance along the motion and to its left."""
        ahead = self.rate_arcsec_s / max(self.speed_arcsec_s, 1e-9)
        turn = np.array([ahead, [-ahead[1], ahead[0]]])
        return np.asarray(turn @ self.covariance_arcsec2 @ turn.T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyPath:
    """Places at N instants in order, near enough for a cubic between two."""

    t_utc_ns: IntArray
    lines: FloatArray
    """(N, 3) unit vectors."""
    rates: FloatArray
    """(N, 3) radians a second, across them."""
    along_across_arcsec2: FloatArray
    """(N, 2, 2)"""

    @property
    def from_utc_ns(self) -> int:
        """Its first instant."""
        return int(self.t_utc_ns[0])

    @property
    def until_utc_ns(self) -> int:
        """Its last instant."""
        return int(self.t_utc_ns[-1])

    def at(self, t_utc_ns: int) -> SkyAhead | None:
        """The place at an instant; None before the first and after the last."""
        if not self.from_utc_ns <= t_utc_ns <= self.until_utc_ns:
            return None
        n = min(int(np.searchsorted(self.t_utc_ns, t_utc_ns, "right")), len(self.t_utc_ns) - 1) - 1
        h = float(self.t_utc_ns[n + 1] - self.t_utc_ns[n]) / NS_PER_S
        u = float(t_utc_ns - self.t_utc_ns[n]) / NS_PER_S / h
        (p, q), (a, b) = self.lines[n : n + 2], h * self.rates[n : n + 2]
        line = (1 + 2 * u) * (1 - u) ** 2 * p + u * (1 - u) ** 2 * a
        line = line + u * u * (3 - 2 * u) * q + u * u * (u - 1) * b
        rate = 6 * u * (1 - u) * (q - p) + (1 - u) * (1 - 3 * u) * a + u * (3 * u - 2) * b
        ra_deg, dec_deg = (float(each) for each in unit_to_direction(line))
        east = np.array([-np.sin(np.radians(ra_deg)), np.cos(np.radians(ra_deg)), 0.0])
        axes = np.stack([east, np.cross(line / np.linalg.norm(line), east)])
        on_sky = axes @ rate / h / ARCSEC_RAD
        ahead = on_sky / max(float(np.hypot(*on_sky)), 1e-9)
        back = np.array([ahead, [-ahead[1], ahead[0]]]).T
        pair = self.along_across_arcsec2[n : n + 2]
        return SkyAhead(
            t_utc_ns=t_utc_ns,
            ra_icrs_deg=ra_deg,
            dec_icrs_deg=dec_deg,
            rate_arcsec_s=on_sky,
            covariance_arcsec2=back @ ((1 - u) * pair[0] + u * pair[1]) @ back.T,
        )


def path_of(places: list[SkyAhead]) -> SkyPath:
    """Through places in order of time, at least two."""
    ra, dec = (np.array([each.direction_deg[n] for each in places]) for n in (0, 1))
    lines = direction_to_unit(ra, dec)
    a = np.radians(ra)
    east = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=-1)
    north = np.cross(lines, east)
    on_sky = np.array([each.rate_arcsec_s for each in places]) * ARCSEC_RAD
    return SkyPath(
        t_utc_ns=np.array([each.t_utc_ns for each in places], np.int64),
        lines=lines,
        rates=on_sky[:, :1] * east + on_sky[:, 1:] * north,
        along_across_arcsec2=np.stack([each.along_across_arcsec2 for each in places]),
    )
