"""Hints for the plate solution of a frame, and those that the stars contradict."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.instruments import SolveHint
from rsoconsole.pipeline.frame.hint_causes import (
    likely_scale_factors,
    position_causes,
    position_remedy,
    scale_remedy,
)
from rsoconsole.records import Frame, Solution
from rsoconsole.sky import separation_deg

_ROUNDING = 2e-3
"""Tolerance of a scale, which may be written with three digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongHint:
    """Hint that the stars contradict."""

    hint: Literal["scale", "position"]
    words: str
    """Sentence with both figures and the remedy."""


def header_hint(frame: Frame, config: Config) -> SolveHint:
    """Return the hint for the solver from the frame's header."""
    scale, tolerance = frame.scale_arcsec_px, config.solver.scale_tolerance
    return SolveHint(
        ra_icrs_deg=frame.pointing_ra_icrs_deg,
        dec_icrs_deg=frame.pointing_dec_icrs_deg,
        radius_deg=config.solver.radius_deg,
        scale_low_arcsec_px=None if scale is None else scale * (1.0 - tolerance),
        scale_high_arcsec_px=None if scale is None else scale * (1.0 + tolerance),
    )


def hint_with_overrides(
    hint: SolveHint,
    ra_icrs_deg: float | None,
    dec_icrs_deg: float | None,
    radius_deg: float | None,
    scale_arcsec_px: tuple[float, float] | None,
) -> SolveHint:
    """Return the header's hint with the values given by the operator in place of its own."""
    if ra_icrs_deg is not None:
        hint = replace(hint, ra_icrs_deg=ra_icrs_deg, dec_icrs_deg=dec_icrs_deg)
    if radius_deg is not None:
        hint = replace(hint, radius_deg=radius_deg)
    if scale_arcsec_px is not None:
        low, high = scale_arcsec_px
        hint = replace(hint, scale_low_arcsec_px=low, scale_high_arcsec_px=high)
    return hint


def rescaled_hint(hint: SolveHint, factor: float) -> SolveHint:
    """Return the hint with its scale times ``factor``."""
    if hint.scale_low_arcsec_px is None or hint.scale_high_arcsec_px is None:
        return hint
    return replace(
        hint,
        scale_low_arcsec_px=hint.scale_low_arcsec_px * factor,
        scale_high_arcsec_px=hint.scale_high_arcsec_px * factor,
    )


def relaxed_hints(hint: SolveHint) -> tuple[SolveHint, ...]:
    """Return weaker hints: without the scale, without the position, without both; each once."""
    without_scale = replace(hint, scale_low_arcsec_px=None, scale_high_arcsec_px=None)
    without_place = replace(hint, ra_icrs_deg=None, dec_icrs_deg=None)
    weaker = (without_scale, without_place, SolveHint(radius_deg=hint.radius_deg))
    return tuple(each for each in dict.fromkeys(weaker) if each != hint)


def likely_hints(hint: SolveHint, frame: Frame, config: Config) -> tuple[SolveHint, ...]:
    """Return the hints that the header means where it is written in a frequent wrong form.

    Each corrects the scale, the position or both; none for what is not the header's own.
    """
    own = header_hint(frame, config)
    scales, places = [hint], [hint]
    if hint.scale_low_arcsec_px is not None and hint.scale_arcsec_px == own.scale_arcsec_px:
        scales += [rescaled_hint(hint, factor) for factor in likely_scale_factors(frame)]
    if hint.position_deg is not None and hint.position_deg[:2] == (
        own.ra_icrs_deg,
        own.dec_icrs_deg,
    ):
        places += [
            replace(hint, ra_icrs_deg=each.ra_icrs_deg, dec_icrs_deg=each.dec_icrs_deg)
            for each in position_causes(frame)
            if each.is_frequent
        ]
    both = [
        replace(
            place,
            scale_low_arcsec_px=scale.scale_low_arcsec_px,
            scale_high_arcsec_px=scale.scale_high_arcsec_px,
        )
        for place in places
        for scale in scales
    ]
    return tuple(each for each in dict.fromkeys(both) if each != hint)


def wrong_hints(
    hint: SolveHint, solution: Solution, frame: Frame, config: Config
) -> tuple[WrongHint, ...]:
    """Return the hints that the solved plate contradicts."""
    return (*_wrong_scale(hint, solution, frame, config), *_wrong_position(hint, solution, frame))


def _wrong_scale(
    hint: SolveHint, solution: Solution, frame: Frame, config: Config
) -> Iterator[WrongHint]:
    low, high = hint.scale_low_arcsec_px, hint.scale_high_arcsec_px
    found = solution.scale_arcsec_px
    if low is None or high is None or low * (1 - _ROUNDING) <= found <= high * (1 + _ROUNDING):
        return
    own = header_hint(frame, config)
    if (low, high) != (own.scale_low_arcsec_px, own.scale_high_arcsec_px):
        yield WrongHint(
            hint="scale",
            words=f"the given scale of {low:.4g} to {high:.4g} arcsec/px is wrong: the stars say"
            f" {found:.4g}",
        )
        return
    hinted = (low + high) / 2.0
    optics = config.optics
    # Binned frames have fewer and larger pixels.
    configured = optics.scale_arcsec_px * optics.width_px / frame.width_px
    is_configured = abs(hinted / configured - 1.0) < config.solver.scale_tolerance
    setting = "the camera's driver" + (" and optics.focal_length_mm" if is_configured else "")
    remedy = scale_remedy(frame, found / hinted, setting)
    whose = "configured scale" if is_configured else "header's scale"
    yield WrongHint(
        hint="scale",
        words=f"the {whose} {hinted:.4g} arcsec/px is wrong: the stars say {found:.4g}"
        + (f"; {remedy}" if remedy else ""),
    )


def _wrong_position(hint: SolveHint, solution: Solution, frame: Frame) -> Iterator[WrongHint]:
    if hint.position_deg is None:
        return
    ra_deg, dec_deg, radius_deg = hint.position_deg
    away_deg = separation_deg(ra_deg, dec_deg, solution.ra_icrs_deg, solution.dec_icrs_deg)
    if away_deg <= radius_deg:
        return
    own = (frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg)
    whose = "header's" if own == (hint.ra_icrs_deg, hint.dec_icrs_deg) else "given"
    yield WrongHint(
        hint="position",
        words=f"the {whose} position RA {ra_deg:.3f} Dec {dec_deg:+.3f} is wrong: the stars say"
        f" RA {solution.ra_icrs_deg:.3f} Dec {solution.dec_icrs_deg:+.3f}, {away_deg:.1f} deg"
        f" away ({radius_deg:g} at most)"
        + (f"; {position_remedy(frame, solution, radius_deg)}" if whose == "header's" else ""),
    )
