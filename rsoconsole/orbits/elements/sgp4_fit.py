"""SGP4 elements fitted to an orbit and its directions, for use by other programs. Pure.

Two-line elements are constants of a theory, not an orbit at an instant. They are fitted to the
directions, so that the effect of forces that SGP4 lacks is spread over the nights observed, and
with a low weight to the orbit determined from the directions, over one revolution at least. The
orbit fixes the elements that the directions determine poorly (the eccentricity, from two short
passes at one hour of the night). Drag is fitted where the directions determine it. Source: Vallado
& Crawford 2008, SGP4 orbit determination, AIAA 2008-6770; equinoctial elements, which stay regular
for circular and for equatorial orbits.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rsoconsole.base import OrbitError
from rsoconsole.orbits.determination.from_directions import Orbit
from rsoconsole.orbits.elements.elements import ALPHA_5, ElementSet, checksum, parse_elements
from rsoconsole.orbits.first.directions import MeasuredDirections
from rsoconsole.orbits.motion.two_body import osculating_elements, period_s
from rsoconsole.records import FloatArray
from rsoconsole.sky import IntArray, jd_utc, teme_to_gcrs_rotation
from rsoconsole.words import NS_PER_DAY, NS_PER_S

ANALYST_NUMBERS = range(80_000, 90_000)
"""Catalogue numbers that the catalogue reserves for objects without a name."""
TLE_STEP_NS = 864_000
"""Step of an epoch in two lines, 1e-8 day; an OMM gives the same epoch exactly."""
MU_WGS72_KM3_S2 = 398_600.8
_SGP4_EPOCH_DAYS = 7_306
"""Days from 1949-12-31 to 1970-01-01."""
_SAMPLES = 145
_HOLD = float(np.sqrt(6 / (3 * _SAMPLES)) / 5.0)
"""Weight of the orbit in the fit: six measurements to 5 arcsec, SGP4's own accuracy."""
_DRAG_PERIOD_S = 225.0 * 60.0
"""Longest period with drag: beyond it SGP4 uses its deep-space theory, without drag."""
_DRAG_SPAN_S = 43_200.0
_DRAG_UNIT = 1e-4
_HUBER = 3.0
_KNOWN_DRAG = 3.0
"""Least distance of the drag from 0, in sigmas, at which it counts as known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanElements:
    """Mean elements of SGP4 (TEME, WGS-72); angles in degrees, mean motion in revolutions a day."""

    name: str = "UNKNOWN"
    norad_id: int = ANALYST_NUMBERS.start
    epoch_utc_ns: int
    revolutions_a_day: float
    e: float
    i_deg: float
    raan_deg: float
    argp_deg: float
    m_deg: float
    bstar: float
    """Drag term B*, per Earth radius; 0 where it is unknown."""
    rms_arcsec: float = 0.0
    """RMS residual of the used directions, per axis, arcsec."""
    cospar: str = ""
    """International designator, as ``2009-064A``; empty where it is unknown."""

    def sgp4_record(self) -> Any:
        """Return the record that SGP4 propagates.

        Raises OrbitError where SGP4 refuses the elements.
        """
        from sgp4.api import WGS72, Satrec

        record = Satrec()
        record.sgp4init(
            *(WGS72, "i", self.norad_id),
            self.epoch_utc_ns / NS_PER_DAY + _SGP4_EPOCH_DAYS,
            *(self.bstar, 0.0, 0.0, self.e),
            *(np.radians(each) for each in (self.argp_deg, self.i_deg, self.m_deg)),
            self.revolutions_a_day * 2.0 * np.pi / 1440.0,
            np.radians(self.raan_deg),
        )
        if record.error:
            raise OrbitError(f"SGP4 refuses the elements fitted (error {record.error})")
        return record

    def rounded(self) -> "MeanElements":
        """Return the elements rounded to the digits of two-line elements.

        The mean anomaly absorbs the rounding of node and perigee, so that the place in the orbit
        stays.
        """
        raan, argp = round(self.raan_deg, 4) % 360.0, round(self.argp_deg, 4) % 360.0
        anomaly = self.raan_deg + self.argp_deg + self.m_deg - raan - argp
        return replace(
            self,
            raan_deg=raan,
            argp_deg=argp,
            m_deg=round(anomaly % 360.0, 4) % 360.0,
            e=round(self.e, 7),
            i_deg=round(self.i_deg, 4),
            revolutions_a_day=round(self.revolutions_a_day, 8),
        )

    def element_set(self) -> ElementSet:
        """Return the elements as two lines with a name line.

        Raises OrbitError for a catalogue number that two lines have no room for.
        """
        from sgp4.exporter import export_tle

        number = _five_columns(self.norad_id)
        record = self.rounded().sgp4_record()
        if self.cospar:
            record.intldesg = self.cospar[2:4] + self.cospar[5:]
        lines = [each[:2] + number + each[7:68] for each in export_tle(record)]
        text = "\n".join((self.name, *(each + str(checksum(each + "0")) for each in lines)))
        return parse_elements(text, "elements fitted")[0]


def fit_mean_elements(
    orbit: Orbit,
    seen: MeasuredDirections,
    *,
    norad_id: int = ANALYST_NUMBERS.start,
    name: str = "UNKNOWN",
) -> MeanElements:
    """Fit SGP4 elements to an orbit and the directions from which it was determined.

    Their epoch is that of the last direction. ``norad_id``: one of `ANALYST_NUMBERS` for an object
    without a catalogue number. Raises OrbitError where SGP4 cannot represent the orbit (unbound, or
    decayed).
    """
    epoch = int(seen.t_utc_ns[-1]) // TLE_STEP_NS * TLE_STEP_NS
    with np.errstate(all="ignore"):
        frame = _Frame.of(orbit, epoch)
        to_orbit, to_directions = _to_orbit(orbit, seen, frame), _to_directions(seen, frame)

        def both(unknowns: FloatArray) -> FloatArray:
            whitened = seen.whitened(to_directions(unknowns).reshape(-1, 2)).ravel()
            return np.concatenate([whitened, to_orbit(unknowns) * _HOLD])

        found = _solved(to_orbit, frame.start)
        found = None if found is None else _solved(both, found, is_robust=True)
        if found is None:
            raise OrbitError("SGP4 follows no such orbit: no elements can be fitted to it")
        is_low = 86_400.0 / frame.revolutions_a_day < _DRAG_PERIOD_S
        if is_low and float(seen.t_s[-1] - seen.t_s[0]) > _DRAG_SPAN_S:
            dragged = _solved(both, np.append(found, 0.0), is_robust=True, known=_KNOWN_DRAG)
            found = found if dragged is None else dragged
        off = to_directions(found).reshape(-1, 2)[orbit.fit.is_used]
        elements = frame.elements(found)
    rms = float(np.sqrt(np.mean(off**2)))
    return replace(elements, name=name, norad_id=norad_id, rms_arcsec=rms)


def _five_columns(norad_id: int) -> str:
    """Catalogue number as Space-Track writes it: from 100,000 on the first digit is a letter."""
    tens_of_thousands, rest = divmod(norad_id, 10_000)
    if tens_of_thousands < 10:
        return f"{norad_id:05d}"
    if tens_of_thousands - 10 >= len(ALPHA_5):
        raise OrbitError(f"two lines have no room for catalogue number {norad_id}: write an OMM")
    return f"{ALPHA_5[tens_of_thousands - 10]}{rest:04d}"


Residuals = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Frame:
    """Unknowns about which the problem is well scaled.

    Relative change of the mean motion; e cos and e sin of the perigee's longitude; tan i/2 by cos
    and sin of the node; mean longitude (rad); drag in 1e-4 where it is fitted.
    """

    epoch_utc_ns: int
    revolutions_a_day: float
    start: FloatArray

    @classmethod
    def of(cls, orbit: Orbit, epoch_utc_ns: int) -> "_Frame":
        at = np.array([epoch_utc_ns])
        r, v = (each[0] for each in orbit.states(at))
        back = teme_to_gcrs_rotation(at)[0].T
        now = osculating_elements(back @ r, back @ v, MU_WGS72_KM3_S2)
        if not (now.a_km > 0.0 and np.isfinite(now.m_deg)):
            raise OrbitError("the orbit is not bound at the last direction: it has no elements")
        node, argp, mean = np.radians([now.raan_deg, now.argp_deg, now.m_deg])
        tilt = np.tan(np.radians(now.i_deg) / 2.0)
        perigee = node + argp
        return cls(
            epoch_utc_ns=epoch_utc_ns,
            revolutions_a_day=86_400.0 / period_s(now.a_km, MU_WGS72_KM3_S2),
            start=np.array(
                [
                    *(0.0, now.e * np.cos(perigee), now.e * np.sin(perigee)),
                    *(tilt * np.cos(node), tilt * np.sin(node), perigee + mean),
                ]
            ),
        )

    def elements(self, unknowns: FloatArray) -> MeanElements:
        change, k, h, q, p, longitude, *drag = (float(each) for each in unknowns)
        perigee, node = np.arctan2(h, k), np.arctan2(p, q)
        return MeanElements(
            epoch_utc_ns=self.epoch_utc_ns,
            revolutions_a_day=self.revolutions_a_day * (1.0 + change),
            e=float(np.hypot(k, h)),
            i_deg=float(np.degrees(2.0 * np.arctan(np.hypot(p, q)))),
            raan_deg=float(np.degrees(node) % 360.0),
            argp_deg=float(np.degrees(perigee - node) % 360.0),
            m_deg=float(np.degrees(longitude - perigee) % 360.0),
            bstar=drag[0] * _DRAG_UNIT if drag else 0.0,
        )

    def states(
        self, unknowns: FloatArray, t_utc_ns: IntArray, to_gcrs: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """GCRS positions and velocities (N, 3); far away where SGP4 fails."""
        far = np.full((len(t_utc_ns), 3), 1e9)
        try:
            record = self.elements(unknowns).sgp4_record()
        except OrbitError:
            return far, np.zeros_like(far)
        failed, r, v = record.sgp4_array(*(np.ascontiguousarray(x) for x in jd_utc(t_utc_ns)))
        turned = (np.einsum("nij,nj->ni", to_gcrs, each) for each in (r, v))
        is_good = (failed == 0)[:, None]
        r_gcrs, v_gcrs = (np.where(is_good, each, 1e9) for each in turned)
        return r_gcrs, v_gcrs


def _to_orbit(orbit: Orbit, seen: MeasuredDirections, frame: _Frame) -> Residuals:
    """Residuals (3 N,) against the orbit, as arcsec from the Earth's centre."""
    first, last = int(seen.t_utc_ns[0]), int(seen.t_utc_ns[-1])
    around_ns = int(86_400 / frame.revolutions_a_day * NS_PER_S)
    t = np.linspace(first, max(last, first + around_ns), _SAMPLES).astype(np.int64)
    truth, _ = orbit.states(t)
    t, truth = t[np.isfinite(truth[:, 0])], truth[np.isfinite(truth[:, 0])]
    to_gcrs = teme_to_gcrs_rotation(t)
    scale = np.degrees(1.0 / np.linalg.norm(truth, axis=1, keepdims=True)) * 3600.0

    def residuals(unknowns: FloatArray) -> FloatArray:
        return np.ravel((frame.states(unknowns, t, to_gcrs)[0] - truth) * scale)

    return residuals


def _to_directions(seen: MeasuredDirections, frame: _Frame) -> Residuals:
    """Residuals (2 N,) against the directions, arcsec."""
    to_gcrs = teme_to_gcrs_rotation(seen.t_utc_ns)

    def residuals(unknowns: FloatArray) -> FloatArray:
        r, v = frame.states(unknowns, seen.t_utc_ns, to_gcrs)
        tau_s = seen.light_times_s(r - v * seen.light_times_s(r)[:, None])
        return seen.residuals_arcsec(r - v * tau_s[:, None]).ravel()

    return residuals


def _solved(
    residuals: Residuals, start: FloatArray, *, is_robust: bool = False, known: float | None = None
) -> FloatArray | None:
    """Solve by least squares; ``known``: sigmas by which the last unknown must differ from 0."""
    from scipy.optimize import least_squares

    if not np.all(np.isfinite(residuals(start))):
        return None
    solved = least_squares(
        residuals,
        start,
        x_scale="jac",
        loss="huber" if is_robust else "linear",
        f_scale=_HUBER,
        xtol=1e-12,
        ftol=1e-10,
        max_nfev=60,
    )
    if not solved.success or not np.all(np.isfinite(solved.x)):
        return None
    if known is not None:
        normal = solved.jac.T @ solved.jac
        scatter = 2.0 * solved.cost / max(len(solved.fun) - len(start), 1)
        sigma = float(np.sqrt(np.linalg.pinv(normal)[-1, -1] * max(scatter, 1.0)))
        if not abs(float(solved.x[-1])) > known * sigma:
            return None
    return np.asarray(solved.x)
