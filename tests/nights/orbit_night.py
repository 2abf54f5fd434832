"""A made-up night that has its orbit and its name on record; no engine has a part in it."""

from collections.abc import Collection
from dataclasses import replace
from math import cos, radians, sin
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.night import Night
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import CatalogueMatch, Cause, Identified, OrbitEstimate, StateChange
from rsoconsole.session import SessionWriter
from tests.nights import made_up_night as night

A_KM, TOWARDS_DEG, INCLINATION_DEG = 42_165.0, 195.0, 0.052
E = 3e-4
FIRST_ORBIT, NAMED_EVERY = night.FIRST_MEASURED + 2, 10
BEST = CatalogueMatch(
    norad_id=36_097,
    name="INTELSAT 14",
    separation_arcsec=3.1,
    along_track_s=-0.2,
    cross_track_arcsec=1.5,
    rate_difference_percent=0.01,
    tle_age_days=0.4,
    score=0.5,
    probability=0.98,
)
NEXT = replace(BEST, norad_id=42_432, name="SES 10", separation_arcsec=720.0, probability=0.01)


def estimate_of(n: int, **changes: Any) -> OrbitEstimate:
    """The orbit after a frame: a geostationary satellite that never sets."""
    along, pole = radians(TOWARDS_DEG), radians(INCLINATION_DEG)
    perigee_km = A_KM * (1.0 - E)
    speed = (MU_EARTH_KM3_S2 * (2.0 / perigee_km - 1.0 / A_KM)) ** 0.5
    sigmas = (4.0, 4.0, 0.5, 3e-4, 3e-4, 2e-4)
    record = OrbitEstimate(
        frame_id=n,
        track_id=1,
        label="constrained by prior",
        prior="geo",
        reason="a satellite over the equator: eccentricity about 0.002",
        observations=n - 2,
        arc_s=float((n - 3) * night.CADENCE_S),
        epoch_utc_ns=night.t_of(n) - 7 * 10**9,
        r_gcrs_km=(perigee_km * cos(along), perigee_km * sin(along), 0.0),
        v_gcrs_km_s=(
            -speed * sin(along) * cos(pole),
            speed * cos(along) * cos(pole),
            speed * sin(pole),
        ),
        covariance=tuple(
            tuple(sigmas[i] ** 2 if i == k else 0.0 for i in range(6)) for k in range(6)
        ),
        a_km=A_KM,
        e=E,
        i_deg=INCLINATION_DEG,
        sigma_a_km=9.2,
        rms_arcsec=0.41,
        outliers=0,
        nis=1.2,
        innovation_arcsec=(0.4, -0.2),
        sigma_innovation_arcsec=(0.5, 0.5),
    )
    return replace(record, **changes)


def identified_of(n: int, **changes: Any) -> Identified:
    """The name after a frame."""
    record = Identified(
        frame_id=n,
        track_id=1,
        verdict="identified",
        reason='INTELSAT 14 (36097) is 3.1" off, the runner-up SES 10 (42432) is 0.20 deg off',
        hint="",
        observations=n - 2,
        catalogued=31_204,
        matches=(BEST, NEXT),
    )
    return replace(record, **changes)


def begin(folder: Path, **about: Any) -> SessionWriter:
    """An empty session of an engine that has a catalogue."""
    config = Config.model_validate({"catalogue": {"tle_files": ["geo.tle"]}})
    return SessionWriter.create(folder, config, {"title": "made up", **about})


def add(writer: SessionWriter, frames: range, missed: Collection[int] = (night.MISSED,)) -> None:
    """Frames in order, each with the orbit that it led to."""
    for n in frames:
        night.add_one(writer, n, missed)
        if n >= FIRST_ORBIT and n not in missed:
            writer.append(estimate_of(n), night.t_of(n) + 10**8)
        if n >= FIRST_ORBIT and (n - FIRST_ORBIT) % NAMED_EVERY == 0:
            writer.append(identified_of(n), night.t_of(n) + 2 * 10**8)
    assert writer.flush()


def write(folder: Path, frames: int = 20, *, pictures: range | None = None) -> SessionWriter:
    """A night of so many frames, still open, with a picture of the last one."""
    writer = begin(folder)
    night.armed(writer)
    add(writer, range(1, frames + 1))
    night.add_previews(writer, range(frames, frames + 1) if pictures is None else pictures)
    return writer


def folded(*records: Any, before: Night | None = None) -> Night:
    """A night's fold over records, each at its frame's time; ``before``: it goes on from there."""
    found = before or Night(Path("night"), {}, Config())
    for record in records:
        t = night.t_of(getattr(record, "frame_id", 0) or 0)
        found.fold_record(t, record)
    return found


def state(n: int, kind: str = "updated", track_id: int = 1) -> Any:
    """The filter after a frame."""
    return replace(night.state_of(n, 150.0, -5.0, kind), track_id=track_id)


def to(n: int, before: Any, after: Any) -> StateChange:
    """The loop passes from one state to another."""
    return StateChange(
        frame_id=n, before=before, after=after, reason=Cause(kind="operator's word", detail="so")
    )


FOLLOWED = (state(4, "initial"), to(4, "ACQUIRE", "TRACK"), state(5), estimate_of(5))
