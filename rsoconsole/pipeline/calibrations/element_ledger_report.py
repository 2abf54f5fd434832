"""What the ledger of element errors holds and what was fitted to it, as JSON and as settings."""

import itertools
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from rsoconsole.config import CatalogueConfig, MeasuredErrors
from rsoconsole.orbits.identification import ElementRow, FittedFactors
from rsoconsole.sky import NS_PER_S, utc_ns_to_iso

AGES_DAYS = (0.0, 1.0, 3.0, 7.0, 14.0, 30.0, 60.0, math.inf)
FACTORS = ("along_at_epoch", "along_by_age", "across")


def regime_report(
    fitted: FittedFactors, rows: Sequence[ElementRow], catalogue: CatalogueConfig
) -> dict[str, Any]:
    """One kind of orbit; ``rows`` are the ledger's."""
    own = [each for each in rows if each.regime == fitted.regime]
    ages = [abs(each.age_days) for each in own]
    in_use = [each for each in catalogue.error_factors if each.regime == fitted.regime]
    return {
        "regime": fitted.regime,
        "tracks": fitted.rows,
        "objects": fitted.objects,
        "counted_as": fitted.counted,
        "youngest_days": min(ages),
        "oldest_days": max(ages),
        "t_last_utc": utc_ns_to_iso(fitted.t_last_utc_ns),
        "factors": {
            key: value
            for name in FACTORS
            for key, value in (
                (name, getattr(fitted.factors, name)),
                (f"{name}_sigma", getattr(fitted.sigmas, name)),
            )
        },
        "in_use": in_use[0].model_dump(mode="json") if in_use else None,
        "ages": [
            _age_report(low, high, bin_rows)
            for low, high in itertools.pairwise(AGES_DAYS)
            if (bin_rows := [r for r in own if low <= abs(r.age_days) < high])
        ],
    }


def _age_report(low: float, high: float, rows: Sequence[ElementRow]) -> dict[str, Any]:
    return {
        "from_days": low,
        "to_days": high if math.isfinite(high) else None,
        "tracks": len(rows),
        "objects": len({each.norad_id for each in rows}),
        "along_rms_s": _rms([each.along_s for each in rows]),
        "along_rms_km": _rms([each.along_km for each in rows]),
        "across_rms_arcsec": _rms([each.across_arcsec for each in rows]),
        "across_rms_km": _rms([each.across_km for each in rows]),
    }


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(each**2 for each in values) / len(values))


def row_report(row: ElementRow) -> dict[str, Any]:
    """One row of a night."""
    return {
        "session": row.session,
        "track": row.track,
        "norad_id": row.norad_id,
        "name": row.name,
        "t_utc": utc_ns_to_iso(row.t_utc_ns),
        "tle_epoch_utc": utc_ns_to_iso(row.tle_epoch_utc_ns),
        "tle_age_days": row.age_days,
        "regime": row.regime,
        "along_track_s": row.along_s,
        "sigma_along_track_s": row.sigma_along_s,
        "along_track_km": row.along_km,
        "sigma_along_track_km": row.sigma_along_km,
        "cross_track_arcsec": row.across_arcsec,
        "sigma_cross_track_arcsec": row.sigma_across_arcsec,
        "cross_track_km": row.across_km,
        "sigma_cross_track_km": row.sigma_across_km,
        "observations": row.observations,
        "probability": row.probability,
    }


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
