"""What was fitted to the ledger of element errors, as settings."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from rsoconsole.config import CatalogueConfig, MeasuredErrors
from rsoconsole.orbits.identification import FittedFactors
from rsoconsole.sky import NS_PER_S

FACTORS = ("along_at_epoch", "along_by_age", "across")


def settings_of(
    fitted: Sequence[FittedFactors], catalogue: CatalogueConfig
) -> list[dict[str, Any]]:
    """``catalogue.error_factors`` with what was fitted; other kinds of orbit keep theirs."""
    new = {each.regime: _measured(each) for each in fitted}
    kept = [each for each in catalogue.error_factors if each.regime not in new]
    return [each.model_dump() for each in (*kept, *new.values())]


def _measured(fitted: FittedFactors) -> MeasuredErrors:
    values = {
        key: round(value, 3)
        for name in FACTORS
        for key, value in (
            (name, getattr(fitted.factors, name)),
            (f"{name}_sigma", getattr(fitted.sigmas, name)),
        )
    }
    return MeasuredErrors.model_validate(
        {
            "regime": fitted.regime,
            **values,
            "tracks": fitted.rows,
            "objects": fitted.objects,
            "oldest_days": round(fitted.oldest_days, 2),
            "measured_on": datetime.fromtimestamp(fitted.t_last_utc_ns // NS_PER_S, tz=UTC).date(),
        }
    )
