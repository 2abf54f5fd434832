"""How far elements may be off by a configuration, and whether that is assumed or measured."""

from typing import Any

from rsoconsole.config import CatalogueConfig
from rsoconsole.orbits.identification import (
    ASSUMED,
    ERROR_REGIMES,
    ElementErrors,
    ErrorFactors,
    Regime,
)

_TIMES = 3.0


def errors_of(catalogue: CatalogueConfig) -> ElementErrors:
    """By the measured factors of the configuration; as assumed where it has none."""
    return ASSUMED.scaled(factors_of(catalogue))


def wide_errors_of(catalogue: CatalogueConfig) -> ElementErrors:
    """Three times as wide as assumed, or twice as measured: for what is to measure them.

    Named by narrow errors, tracks could only say that errors are narrow.
    """
    known = factors_of(catalogue)
    wide = {}
    for regime in ERROR_REGIMES:
        each = known.get(regime, ErrorFactors())
        wide[regime] = ErrorFactors(
            along_at_epoch=max(2.0 * each.along_at_epoch, _TIMES),
            along_by_age=max(2.0 * each.along_by_age, _TIMES),
            across=max(2.0 * each.across, _TIMES),
        )
    return ASSUMED.scaled(wide)


def factors_of(catalogue: CatalogueConfig) -> dict[Regime, ErrorFactors]:
    """Of each kind of orbit that was measured."""
    return {
        each.regime: ErrorFactors(
            along_at_epoch=each.along_at_epoch,
            along_by_age=each.along_by_age,
            across=each.across,
        )
        for each in catalogue.error_factors
    }


def errors_report(catalogue: CatalogueConfig) -> list[dict[str, Any]]:
    """Of each kind of orbit, where its errors come from, as JSON carries it."""
    measured = {each.regime: each for each in catalogue.error_factors}
    found: list[dict[str, Any]] = []
    for regime in ERROR_REGIMES:
        each = measured.get(regime)
        found.append(
            {
                "regime": regime,
                "source": "assumed" if each is None else "measured",
                "tracks": 0 if each is None else each.tracks,
                "objects": 0 if each is None else each.objects,
                "oldest_days": None if each is None else each.oldest_days,
                "measured_on": None if each is None else each.measured_on.isoformat(),
            }
        )
    return found
