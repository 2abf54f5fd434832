"""Class probabilities of a streak: satellite, aircraft, meteor, cosmic ray or chain of stars.

Bayes' rule over the evidence of one frame, each piece as if independent of the others:

- width: aircraft and meteors are too near to be in focus, rays are sharper than any star
- light from end to end: meteors flare up and die away
- pulse: strobes
- speed, where time and scale are known
- stars that lie on the streak

Missing measurements have no effect. The likelihoods are rough, by the nature of the objects and the
few real ones at hand; none of them is near zero, so that no single figure decides against all
others. Evidence of an earlier frame and of the star catalogue comes last, by the same rule.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rsoconsole.records import ObjectClass, StreakKind
from rsoconsole.vision.streaks._streak_light import Fading, Modulation

NamedClass: TypeAlias = Literal["satellite", "aircraft", "meteor", "cosmic ray", "star chain"]
Likelihood: TypeAlias = dict[NamedClass, float]
Comparison: TypeAlias = Literal["same light", "new light", "catalogue stars", "no catalogue stars"]
"""Outcome of comparing a streak with an earlier frame (the first two) or the star catalogue."""

PRIOR: Likelihood = {
    "satellite": 0.45,
    "aircraft": 0.20,
    "meteor": 0.20,
    "cosmic ray": 0.05,
    "star chain": 0.10,
}
"""Shares of the classes among all streaks, under any sky; alone they give "undetermined"."""
COMPARISON_LIKELIHOODS: dict[Comparison, Likelihood] = {
    # What moves is seldom where another one of the same light was.
    "same light": {"satellite": 0.002, "aircraft": 0.002, "meteor": 0.002, "cosmic ray": 0.002},
    "new light": {"star chain": 0.01},
    "catalogue stars": {"satellite": 0.02, "aircraft": 0.02, "meteor": 0.02, "cosmic ray": 0.02},
    # Red stars are brighter to a camera without a filter than the catalogue has them.
    "no catalogue stars": {"star chain": 0.05},
}
"""Likelihood of a comparison's outcome for each class, over that of the likeliest one."""
SATELLITE_FROM, OTHERS_FROM = 0.5, 2.0 / 3.0
"""Least probability to name a satellite, and to name another class."""

_SAME_WIDTH = 0.06
"""Relative scatter of a line's width against one star's beside it."""
_WIDTH_PER_SNR = 3.0
_STRAY = 0.04
"""Share of each class whose measurement is a fault: wind, a neighbour, another focus."""
_NARROWEST, _WIDEST = -1.6, 1.6
"""Natural logarithms of a width over the stars' between which faults and rays lie."""
_WIDEST_RAY_PX = 2.4
_APERTURE_M = 0.1
"""Aperture where the header gives none, m."""
_AIRCRAFT_KM, _METEOR_KM = (10.0, 20.0, 40.0), (90.0, 140.0)
_BLUR_FWHM = 0.7
"""Full width at half maximum of a defocused disc's cut, over its diameter."""
_SHARP = 1.0
"""First harmonic over the mean that no sine exceeds."""
_STROBE_S = (0.25, 2.5)
_FASTEST_SATELLITE_DEG_S = 2.0
_SLOWEST_AIRCRAFT_DEG_S = 0.06
_METEOR_DEG = 3.0
_RAY_FWHM = 25.0
_UNEVEN = 0.3, 1.0
"""Limits of unevenness: even up to the first, surely uneven from the second on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassEvidence:
    """Measurements of a streak in one frame that are evidence of its class.

    None: unknown. ``unevenness`` is 0 where there is none or it was not measured;
    ``spoken_against`` is "" for a streak that was not rejected.
    """

    kind: StreakKind
    length_px: float
    width_px: float
    """Full width at half maximum across, px."""
    snr: float
    """Matched signal to noise of the whole streak."""
    star_fwhm_px: float
    star_scatter: float
    """Relative scatter of the widths of single stars, one sigma."""
    unevenness: float = 0.0
    scale_arcsec_px: float | None = None
    exposure_s: float | None = None
    aperture_m: float | None = None
    fading: Fading | None = None
    modulation: Modulation | None = None
    is_pulse_seen: bool = False
    """True where the light is bright and long enough that a strobe's pulse would show."""
    star_share: float | None = None
    """Share of the streak's light that lies at listed stars on it."""
    spoken_against: str = ""
    """Kind of the reason for which the detector rejected the streak; empty: not rejected."""

    @property
    def rate_deg_s(self) -> float | None:
        """Angular rate from end to end, deg/s; too small where the frame cuts the streak.

        None where scale or exposure is unknown.
        """
        if self.scale_arcsec_px is None or not self.exposure_s:
            return None
        return self.length_px * self.scale_arcsec_px / 3600.0 / self.exposure_s


def most_likely_class(shares: Likelihood) -> tuple[ObjectClass, float]:
    """Return the likeliest class and its probability p, or "undetermined" and 1 - p.

    "undetermined" where the probability does not exceed ``SATELLITE_FROM`` for a satellite, or
    ``OTHERS_FROM`` for another class.
    """
    best = max(shares, key=lambda name: shares[name])
    asked = SATELLITE_FROM if best == "satellite" else OTHERS_FROM
    if shares[best] > asked:
        return best, shares[best]
    return "undetermined", 1.0 - shares[best]


def probabilities_from_evidence(evidence: ClassEvidence) -> Likelihood:
    """Return the probability of each class by the evidence of one frame; they add up to 1."""
    parts = (_by_width, _by_ends, _by_gaps, _by_pulse, _by_speed, _by_stars, _by_evenness, _by_gate)
    shares = dict(PRIOR)
    for part in parts:
        shares = _times(shares, part(evidence))
    return _normalised(shares)


def update_probabilities(shares: Likelihood, comparison: Comparison) -> Likelihood:
    """Return the class probabilities after a comparison with this outcome, by Bayes' rule."""
    return _normalised(_times(shares, COMPARISON_LIKELIHOODS[comparison]))


def _times(shares: Likelihood, likely: Likelihood) -> Likelihood:
    return {name: share * likely.get(name, 1.0) for name, share in shares.items()}


def _normalised(shares: Likelihood) -> Likelihood:
    whole = sum(shares.values())
    return {name: share / whole for name, share in shares.items()}


def _by_width(e: ClassEvidence) -> Likelihood:
    """Likelihood by its width over the stars', with the errors that the stars themselves show."""
    if not (e.width_px > 0.0 and e.star_fwhm_px > 0.0 and e.snr > 0.0):
        return {}
    found = math.log(e.width_px / e.star_fwhm_px)
    error = math.hypot(_SAME_WIDTH, e.star_scatter, _WIDTH_PER_SNR / e.snr)
    stray = _STRAY / (_WIDEST - _NARROWEST)

    def as_wide(expected: float) -> float:
        return (1.0 - _STRAY) * _gauss(found - expected, error) + stray

    ray = (1.0 if e.width_px < _WIDEST_RAY_PX else 0.05) * _evenly(found, _NARROWEST, 0.1, error)
    return {
        "satellite": as_wide(0.0),
        "star chain": as_wide(0.05),
        "aircraft": _out_of_focus(e, _AIRCRAFT_KM, as_wide),
        "meteor": _out_of_focus(e, _METEOR_KM, as_wide),
        "cosmic ray": ray + stray,
    }


def _out_of_focus(
    e: ClassEvidence, distances_km: tuple[float, ...], as_wide: Callable[[float], float]
) -> float:
    """Mean density over the possible distances.

    A point at a distance is a disc of the aperture's diameter over that distance, in radians, in a
    telescope focused on infinity.
    """
    if e.scale_arcsec_px is None:
        # In a wide field it is sharp, in a narrow one it may be anything up to twice the width.
        return 0.5 * as_wide(0.0) + sum(as_wide(step) for step in (0.15, 0.3, 0.45, 0.6, 0.75)) / 10
    aperture_m = e.aperture_m or _APERTURE_M
    total = 0.0
    for distance_km in distances_km:
        disc_px = math.degrees(aperture_m / (1e3 * distance_km)) * 3600.0 / e.scale_arcsec_px
        total += as_wide(math.log(math.hypot(1.0, _BLUR_FWHM * disc_px / e.star_fwhm_px)))
    return total / len(distances_km)


def _by_ends(e: ClassEvidence) -> Likelihood:
    """Likelihood by its ends: a meteor's grow and die, a satellite's are cut.

    The shutter cuts them, or at one end the Earth's shadow.
    """
    if e.kind != "streak" or e.fading is None:
        return {}
    length_px = e.fading.length_px
    shorter, longer = e.fading.shorter_px / length_px, e.fading.longer_px / length_px
    # A star beside an end, or a wave of the light there, is worth about half a width.
    blur = 0.01 + 0.4 * e.width_px / length_px
    is_cut, is_dying = _decay(shorter, blur), _decay(shorter, 0.15)
    # At one of its ends a satellite may meet the shadow, and any line a star.
    one_cut, one_dying = _decay(longer, blur), _decay(longer, 0.2)
    one_of_two = 0.6 * one_cut + 0.4 * one_dying
    return {
        "satellite": (0.93 * is_cut + 0.07 * is_dying) * one_of_two,
        "aircraft": (0.85 * is_cut + 0.15 * is_dying) * one_of_two,
        "star chain": (0.7 * is_cut + 0.3 * is_dying) * one_of_two,
        "meteor": (0.05 * is_cut + 0.95 * is_dying) * (0.05 * one_cut + 0.95 * one_dying),
        "cosmic ray": (0.7 * is_cut + 0.3 * is_dying) * one_of_two,
    }


def _by_gaps(e: ClassEvidence) -> Likelihood:
    """Likelihood by gaps: dark between bright without a rhythm means stars in a row."""
    if e.fading is None or e.modulation is not None or e.fading.gap_share < 0.15:
        return {}
    return {"satellite": 0.08, "aircraft": 0.3, "meteor": 0.1, "cosmic ray": 0.6}


def _by_pulse(e: ClassEvidence) -> Likelihood:
    """Likelihood by pulse: strobes are regular and short, a satellite's facets slow and smooth."""
    pulse = e.modulation
    if pulse is None:
        if not e.is_pulse_seen:
            return {}
        # A frame that is crossed in a moment may hold too few flashes to be regular.
        return {"aircraft": 0.4 if e.kind == "streak" else 0.7, "satellite": 0.85}
    is_sharp = pulse.sharpness > _SHARP
    likely: Likelihood = (
        {"aircraft": 0.4, "satellite": 0.04, "meteor": 0.01, "cosmic ray": 0.05, "star chain": 0.01}
        if is_sharp
        else {
            "aircraft": 0.2,
            "satellite": 0.11,
            "meteor": 0.06,
            "cosmic ray": 0.05,
            "star chain": 0.03,
        }
    )
    if e.kind == "streak" and e.exposure_s:
        period_s = e.exposure_s / pulse.periods
        is_strobe = _STROBE_S[0] <= period_s <= _STROBE_S[1]
        likely["aircraft"] *= 0.85 if is_strobe else 0.15
        likely["satellite"] *= 0.35 if is_strobe else 0.65
    return likely


def _by_speed(e: ClassEvidence) -> Likelihood:
    """Likelihood by speed in degrees a second, and by the length in degrees of a meteor's path."""
    rate = e.rate_deg_s
    if not rate or e.scale_arcsec_px is None:
        return {}
    too_fast = 1.0 / (1.0 + (rate / _FASTEST_SATELLITE_DEG_S) ** 4)
    likely: Likelihood = {"satellite": too_fast, "aircraft": max(too_fast, 0.1)}
    if e.kind == "streak":
        length_deg = e.length_px * e.scale_arcsec_px / 3600.0
        likely["aircraft"] *= max(1.0 / (1.0 + (_SLOWEST_AIRCRAFT_DEG_S / rate) ** 2), 0.01)
        likely["meteor"] = max(length_deg / (length_deg + _METEOR_DEG), 0.01)
    return likely


def _by_stars(e: ClassEvidence) -> Likelihood:
    """Likelihood by the share of its light that separately detected stars have."""
    if e.star_share is None:
        return {}
    if e.modulation is not None:
        return {}  # flashes are found by themselves, too
    if e.star_share < 0.15:
        return {"star chain": 0.35}
    if e.star_share < 0.5:
        return {"satellite": 0.5, "aircraft": 0.7, "meteor": 0.5, "cosmic ray": 0.5}
    return {"satellite": 0.08, "aircraft": 0.25, "meteor": 0.08, "cosmic ray": 0.08}


def _by_evenness(e: ClassEvidence) -> Likelihood:
    """Likelihood by evenness: a ray loses its charge in lumps; 116 of 135 examined were uneven."""
    if e.length_px > _RAY_FWHM * max(e.star_fwhm_px, 1.0):
        return {"cosmic ray": 0.2}
    low, high = _UNEVEN
    share = min(max((e.unevenness - low) / (high - low), 0.0), 1.0)
    if e.width_px > _WIDEST_RAY_PX:
        # As wide as no ray: the air may have made it so.
        share *= 0.5
    uneven: Likelihood = {"satellite": 0.12, "aircraft": 0.3, "meteor": 0.5, "star chain": 0.8}
    return {"cosmic ray": 0.15 ** (1.0 - share)} | {
        name: likely**share for name, likely in uneven.items()
    }


def _by_gate(e: ClassEvidence) -> Likelihood:
    """Likelihood by the reason for which the detector rejected it."""
    against: dict[str, Likelihood] = {
        "trailed stars": {"star chain": 50.0},
        "stars' trails": {"star chain": 50.0},
        "dark in between": {"star chain": 4.0, "aircraft": 2.0},
        "uneven": {"star chain": 4.0, "aircraft": 2.0},
        "patchy": {"star chain": 2.0, "cosmic ray": 3.0},
    }
    return against.get(e.spoken_against, {})


def _gauss(off: float, sigma: float) -> float:
    return math.exp(-0.5 * (off / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))


def _decay(found: float, typical: float) -> float:
    """Density of a quantity of typical size ``typical`` that is never negative."""
    return math.exp(-found / typical) / typical


def _evenly(found: float, low: float, high: float, sigma: float) -> float:
    """Density of a quantity that lies anywhere between two bounds, measured with an error."""
    root = math.sqrt(2.0) * sigma
    return 0.5 * (math.erf((high - found) / root) - math.erf((low - found) / root)) / (high - low)
