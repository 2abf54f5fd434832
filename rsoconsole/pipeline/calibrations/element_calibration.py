"""Rows for the calibration of element errors, from sessions or ``identify`` output."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rsoconsole.base import OrbitError, parse_json, read_named_file
from rsoconsole.config import CatalogueConfig, MeasuredErrorFactors
from rsoconsole.orbits import (
    ERROR_REGIMES,
    SURE_NAMED,
    CatalogueComparison,
    CatalogueEntry,
    ElementErrorRow,
    ElementErrors,
    FittedFactors,
    Identification,
    compare_with_catalogue,
    element_error_row,
    identify_compared_tracks,
)
from rsoconsole.pipeline.orbits.standard_magnitudes import standard_magnitude_by_elements
from rsoconsole.pipeline.orbits.track_measurements import (
    ObservedTrack,
    longest_arc,
    read_observed_tracks,
)
from rsoconsole.session import SessionReader
from rsoconsole.sky import ARCSEC_RAD, iso_to_utc_ns
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

GATE_DEG = 1.0
"""Gate on differences, deg, wider than for identification: errors cut off could not be measured."""
_SHAPE = "a session's folder, or the lines of 'rsoconsole identify --field --json'"


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationRows:
    """Rows for the calibration of element errors, from one session or one file."""

    sessions: tuple[str, ...]
    """Names of the row's sources in the ledger: the session, or each frame of a file."""
    tracks: int
    rows: tuple[ElementErrorRow, ...]
    is_simulated: bool


def is_session(path: Path) -> bool:
    """True where a path is a session's folder, False where it is a file of JSON lines."""
    return path.is_dir() or path.name == "session.db"


def rows_of_session(
    path: Path, entries: Sequence[CatalogueEntry], errors: ElementErrors
) -> CalibrationRows:
    """Return the rows of a session: its tracks compared with their objects' elements.

    The element sets are those nearest in epoch. ``errors``: assumed errors of the elements, which
    limit the offset of an identified track. Raises SessionError where the session has no readable
    track.
    """
    folder = path if path.is_dir() else path.parent
    about = SessionReader(folder).read_meta()
    tracks = read_observed_tracks(folder)
    compared = [
        compare_with_catalogue(
            longest_arc(each.seen), each.site, entries, gate_deg=GATE_DEG, errors=errors
        )
        for each in tracks
    ]
    named = identify_compared_tracks(compared, gate_deg=GATE_DEG)
    first_utc_ns = min(int(each.seen.t_utc_ns[0]) for each in tracks)
    session = _called(folder.resolve().name, first_utc_ns)
    found = (_row_of_track(session, *three) for three in zip(tracks, compared, named, strict=True))
    return CalibrationRows(
        sessions=(session,),
        tracks=len(tracks),
        rows=tuple(each for each in found if each is not None),
        is_simulated=about.get("is_simulated") is True,
    )


def _row_of_track(
    session: str, track: ObservedTrack, compared: CatalogueComparison, found: Identification
) -> ElementErrorRow | None:
    row = element_error_row(session, str(track.number), compared, found)
    if row is None:
        return None
    entry = next(each for each in compared.found.entries if each.norad_id == row.norad_id)
    standard = standard_magnitude_by_elements(track.lights, entry, track.site)
    if standard is None:
        return row
    return replace(row, standard_mag=standard.mag, standard_mag_sigma=standard.sigma_mag)


def rows_of_identify_output(path: Path, *, is_simulated: bool) -> CalibrationRows:
    """Return the rows made from a file of lines printed by ``identify --field --json``.

    Only streaks and movers identified with certainty give rows. Raises OrbitError where the
    file does not hold such lines.
    """
    text = read_named_file(path, OrbitError, f"name {_SHAPE}")
    sessions: dict[str, None] = {}
    tracks = 0
    rows: list[ElementErrorRow] = []
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip():
            continue
        try:
            for session, track, seen in _seen_of(_object(line)):
                sessions[session] = None
                if track:
                    tracks += 1
                    rows.extend(_rows_of(session, track, seen))
        except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError) as error:
            raise OrbitError(
                f"{path}, line {number} is none of 'rsoconsole identify --field --json' as this"
                f" version prints it ({_fault(error)}): print it again, or name a session's folder"
            ) from error
    if not sessions:
        raise OrbitError(f"{path} holds no frame: it must be {_SHAPE}")
    return CalibrationRows(
        sessions=tuple(sessions), tracks=tracks, rows=tuple(rows), is_simulated=is_simulated
    )


def _fault(error: Exception) -> str:
    return f"without {error}" if isinstance(error, KeyError) else str(error)


def _object(line: str) -> Mapping[str, Any]:
    said = parse_json(line)
    if not isinstance(said, dict):
        raise TypeError("no object")
    return said


def _seen_of(said: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield session, track and object for each object of a line; a frame first without a track."""
    if "error" in said:
        return
    if "movers" in said:
        for each in said["movers"]:
            name = Path(str(each["places"][0]["frame"])).name
            at = iso_to_utc_ns(each["t_mid_utc"])
            seen = {**each, "t_utc_ns": at, "observations": len(each["places"])}
            yield _called(name, at), f"mover {each['mover']}", seen
        return
    at = iso_to_utc_ns(said["t_mid_utc"])
    session = _called(Path(str(said["frame"])).name, at)
    yield session, "", {}
    for each in said["streaks"]:
        yield session, f"streak {each['streak']}", {**each, "t_utc_ns": at, "observations": 1}


def _rows_of(session: str, track: str, seen: Mapping[str, Any]) -> Iterator[ElementErrorRow]:
    """Yield a row where the object is identified with certainty."""
    if seen["verdict"] != "identified" or seen["matches"][0]["probability"] < SURE_NAMED:
        return
    best = seen["matches"][0]
    if best["regime"] not in ERROR_REGIMES:
        raise ValueError(f"{best['regime']!r} is no kind of orbit")
    speed_km_s, range_km = float(best["speed_km_s"]), float(best["range_km"])
    sigma_s = float(best["sigma_along_track_s"])
    sigma_arcsec = float(best["sigma_cross_track_arcsec"])
    along_s, across_arcsec = float(best["along_track_s"]), float(best["cross_track_arcsec"])
    by_radial, by_plane = (float(best[f"cross_track_by_{n}"]) for n in ("radial", "plane"))
    if not min(speed_km_s, range_km, sigma_s, sigma_arcsec) > 0.0:
        raise ValueError("an error, a speed or a distance is not above 0")
    epoch = iso_to_utc_ns(best["tle_epoch_utc"])
    row = ElementErrorRow(
        session=session,
        track=track,
        norad_id=int(best["norad_id"]),
        name=str(best["name"]),
        t_utc_ns=seen["t_utc_ns"],
        tle_epoch_utc_ns=epoch,
        age_days=(seen["t_utc_ns"] - epoch) / NS_PER_DAY,
        regime=best["regime"],
        along_s=along_s,
        sigma_along_s=sigma_s,
        along_km=along_s * speed_km_s,
        sigma_along_km=sigma_s * speed_km_s,
        across_arcsec=across_arcsec,
        sigma_across_arcsec=sigma_arcsec,
        across_km=across_arcsec * range_km * ARCSEC_RAD,
        sigma_across_km=sigma_arcsec * range_km * ARCSEC_RAD,
        along_by=(0.0, 1.0, 0.0),
        across_by=(by_radial, 0.0, by_plane),
        observations=seen["observations"],
        probability=float(best["probability"]),
    )
    numbers = [
        v for v in (*asdict(row).values(), *row.along_by, *row.across_by) if isinstance(v, float)
    ]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a value is not a number")
    yield row


def _called(name: str, t_utc_ns: int) -> str:
    """Return the name with its instant, which tells folders or frames of one name apart; to the
    second, so that a corrected clock does not change it.
    """
    return f"{name}, {utc_ns_to_iso(round(t_utc_ns / NS_PER_S) * NS_PER_S, 0)}"


FACTORS = ("along_at_epoch", "along_by_age", "across")


def merged_error_factors(
    fitted: Sequence[FittedFactors], catalogue: CatalogueConfig
) -> list[dict[str, Any]]:
    """Return the setting ``catalogue.error_factors`` with the fitted factors put in."""
    new = {each.regime: _measured(each) for each in fitted}
    kept = [each for each in catalogue.error_factors if each.regime not in new]
    return [each.model_dump() for each in (*kept, *new.values())]


def _measured(fitted: FittedFactors) -> MeasuredErrorFactors:
    values = {
        key: round(value, 3)
        for name in FACTORS
        for key, value in (
            (name, getattr(fitted.factors, name)),
            (f"{name}_sigma", getattr(fitted.sigmas, name)),
        )
    }
    return MeasuredErrorFactors.model_validate(
        {
            "regime": fitted.regime,
            **values,
            "tracks": fitted.rows,
            "objects": fitted.objects,
            "oldest_days": round(fitted.oldest_days, 2),
            "measured_on": datetime.fromtimestamp(fitted.t_last_utc_ns // NS_PER_S, tz=UTC).date(),
        }
    )
