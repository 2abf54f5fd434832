"""Errors of published elements: how far an object may be from its predicted place. Pure.

Elements carry no covariance, so one is assumed by kind of orbit and age, in two cases: the object
has kept to its orbit (``undisturbed``), or its operator has moved it since (``manoeuvred``).

Geostationary figures: 319 element sets of Intelsat-14, SES-10 and Intelsat-21 (2018 to 2025), each
propagated to the epochs of the seven that follow (``tests/bench/bench_element_errors.py``).
Manoeuvres keep all three in their slots, while their elements predict a natural drift that the
manoeuvres prevent: the errors along the track are 0.65 km times the square of the days, across it a
kilometre a day:

    age, days            3-7   7-14   14-20   20-25   25-35   35-60
    along, 68 %, km       39    100     222     368     585    1542
    across, 68 %, km      12     11      17      26      29      53
    radial, 68 %, km     1.3    2.9     3.3     3.3     5.1      26

Undisturbed objects do much better: KazSat 2, close to a point of rest, was 17 km off after 12
days, and fresh sets are good to 5 to 30 arcsec, which is 1 to 5 km. NAVSTAR 77 was 3.6 km off
after 8 days. For low and eccentric orbits: about 1 km at the epoch and 1 to 3 km a day (Flohrer,
Krag & Klinkrad 2008; Levit & Marshall 2011, Advances in Space Research 47, 1107); not measured
here. Factors found from one's own nights (``element_fit``) multiply the spreads.
"""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

Regime = Literal["GEO", "MEO", "LEO", "HEO"]
ERROR_REGIMES: tuple[Regime, ...] = ("GEO", "MEO", "LEO", "HEO")
_Terms = tuple[float, ...]
"""Terms at the epoch, by the day and by the day squared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSpread:
    """One-sigma errors of elements: terms in km, km a day and km a day squared.

    The three terms add up as squares.
    """

    along: _Terms
    across: _Terms
    """Across the track: amplitude of the swing out of the plane, once a revolution, over root 2."""
    shape: _Terms
    """Amplitude of the radius's swing by an error of the eccentricity; along the track twice it."""


UNDISTURBED: dict[Regime, ErrorSpread] = {
    "GEO": ErrorSpread(along=(2.5, 1.5, 0.0), across=(1.0, 0.15, 0.0), shape=(0.8, 0.1, 0.0)),
    "MEO": ErrorSpread(along=(1.0, 0.5, 0.0), across=(0.5, 0.1, 0.0), shape=(0.4, 0.05, 0.0)),
    "LEO": ErrorSpread(along=(1.0, 1.5, 0.3), across=(0.3, 0.1, 0.0), shape=(0.3, 0.1, 0.0)),
    "HEO": ErrorSpread(along=(5.0, 5.0, 0.0), across=(3.0, 0.5, 0.0), shape=(3.0, 0.5, 0.0)),
}
MANOEUVRED: dict[Regime, ErrorSpread] = {
    "GEO": ErrorSpread(along=(5.0, 5.0, 0.65), across=(8.0, 1.05, 0.0), shape=(1.0, 0.14, 0.0)),
    "MEO": ErrorSpread(along=(10.0, 10.0, 1.0), across=(3.0, 0.5, 0.0), shape=(3.0, 0.5, 0.0)),
    "LEO": ErrorSpread(along=(5.0, 15.0, 5.0), across=(1.0, 0.5, 0.0), shape=(1.0, 1.0, 0.0)),
    "HEO": ErrorSpread(along=(20.0, 20.0, 2.0), across=(5.0, 1.0, 0.0), shape=(5.0, 1.0, 0.0)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorFactors:
    """Factors on the assumed spreads of undisturbed objects of one kind of orbit."""

    along_at_epoch: float = 1.0
    along_by_age: float = 1.0
    """Factor on the two terms that grow with age, of ``along`` and ``shape``."""
    across: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementErrors:
    """Errors of elements by kind of orbit, assumed or measured."""

    undisturbed: Mapping[Regime, ErrorSpread]
    manoeuvred: Mapping[Regime, ErrorSpread]

    def spread_for(self, regime: Regime, *, is_moved: bool) -> ErrorSpread:
        """Spread of one kind of orbit: of manoeuvred objects, or of undisturbed ones."""
        return (self.manoeuvred if is_moved else self.undisturbed)[regime]

    def scaled(self, factors: Mapping[Regime, ErrorFactors]) -> "ElementErrors":
        """Return the errors with the spreads of undisturbed objects multiplied by factors.

        ``factors``: by kind of orbit; other kinds are unchanged. A spread of manoeuvred objects is
        raised to that of undisturbed ones where it would be smaller.
        """
        if not factors:
            return self
        undisturbed, manoeuvred = dict(self.undisturbed), dict(self.manoeuvred)
        for regime, each in factors.items():
            ahead = (each.along_at_epoch, each.along_by_age, each.along_by_age)
            # The shape goes with the place along the track: twice its swing is seen there.
            factors_of = ErrorSpread(along=ahead, across=(each.across,) * 3, shape=ahead)
            undisturbed[regime] = _by_terms(operator.mul, undisturbed[regime], factors_of)
            manoeuvred[regime] = _by_terms(max, undisturbed[regime], manoeuvred[regime])
        return ElementErrors(undisturbed=undisturbed, manoeuvred=manoeuvred)


def _by_terms(of: Callable[[float, float], float], a: ErrorSpread, b: ErrorSpread) -> ErrorSpread:
    """Combine two spreads term by term."""
    along, across = map(of, a.along, b.along), map(of, a.across, b.across)
    return ErrorSpread(
        along=tuple(along), across=tuple(across), shape=tuple(map(of, a.shape, b.shape))
    )


ASSUMED = ElementErrors(undisturbed=UNDISTURBED, manoeuvred=MANOEUVRED)
_CONTROLLED: dict[Regime, float] = {"GEO": 0.35, "MEO": 0.1, "LEO": 0.3, "HEO": 0.03}
"""Share of the catalogued objects that are under control."""
_BETWEEN_MANOEUVRES_DAYS: dict[Regime, float] = {"GEO": 5.0, "MEO": 180.0, "LEO": 14.0, "HEO": 60.0}


def orbit_regime(revolutions_a_day: float, eccentricity: float) -> Regime:
    """Kind of orbit of one element set."""
    number = regime_numbers(np.array(revolutions_a_day), np.array(eccentricity))
    return ERROR_REGIMES[int(number)]


def regime_numbers(revolutions_a_day: FloatArray, eccentricity: FloatArray) -> npt.NDArray[np.intp]:
    """Kinds of orbit of elements (...), as indices of ``ERROR_REGIMES``."""
    is_geo = (revolutions_a_day > 0.85) & (revolutions_a_day < 1.15)
    return np.where(
        eccentricity > 0.25, 3, np.where(revolutions_a_day > 9.0, 2, np.where(is_geo, 0, 1))
    )


def manoeuvred_probability(regime: Regime, age_days: float) -> float:
    """Probability that an object of this kind was manoeuvred since its elements' epoch."""
    return float(manoeuvred_probabilities(regime, np.array(age_days)))


def manoeuvred_probabilities(regime: Regime, age_days: FloatArray) -> FloatArray:
    """Probabilities of a manoeuvre since the elements' epoch, at ages (...)."""
    interval = _BETWEEN_MANOEUVRES_DAYS[regime]
    return np.asarray(_CONTROLLED[regime] * (1.0 - np.exp(-np.abs(age_days) / interval)))


def covariance_rtn(spread: ErrorSpread, age_days: float, mean_motion_rad_s: float) -> FloatArray:
    """Return the covariance (6, 6) of radial, along- and cross-track errors and their rates.

    In km and km/s, in the frame that turns with the orbit. A small error of the orbit's shape or
    plane oscillates once a revolution about the predicted place, at any phase: R = A cos(nt),
    T = -2A sin(nt), N = B cos(nt). The lead or lag is added (Clohessy & Wiltshire 1960).
    """
    along, across, shape = (
        float(sigma_at_age_km(each, age_days))
        for each in (spread.along, spread.across, spread.shape)
    )
    n = mean_motion_rad_s
    covariance = np.diag(
        [
            *(shape**2, along**2 + 4.0 * shape**2, across**2),
            *((n * shape) ** 2, (2.0 * n * shape) ** 2, (n * across) ** 2),
        ]
    )
    covariance[0, 4] = covariance[4, 0] = -2.0 * n * shape**2
    covariance[1, 3] = covariance[3, 1] = 2.0 * n * shape**2
    # What is off along the track by so much a day moves on at that pace.
    pace = (spread.along[1] + 2.0 * spread.along[2] * abs(age_days)) / 86_400.0
    covariance[4, 4] += pace**2
    return covariance


def position_sigmas_km(
    spread: ErrorSpread, age_days: float | FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the one-sigma errors at ages (...), radial, along-track and cross-track, km.

    The along-track error includes that by the eccentricity, twice the radial one.
    """
    along, across, shape = (
        sigma_at_age_km(each, age_days) for each in (spread.along, spread.across, spread.shape)
    )
    return shape, np.sqrt(along**2 + 4.0 * shape**2), across


def sigma_at_age_km(terms: _Terms, age_days: float | FloatArray) -> FloatArray:
    at_epoch, by_day, by_day_2 = terms
    age = np.abs(age_days)
    return np.asarray(np.sqrt(at_epoch**2 + (by_day * age) ** 2 + (by_day_2 * age * age) ** 2))
