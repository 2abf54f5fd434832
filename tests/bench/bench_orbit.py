"""What orbits from short arcs are worth, whether they know it, and what refining one costs.

    OPENBLAS_NUM_THREADS=1 python -m tests.bench.bench_orbit [--runs 200] [--write]

Geostationary satellites moved by other code than the product's (`tests/truth/orbit_truth.py`), a
direction every 30 s. Worlds: true eccentricity 3e-4 under a prior of 5e-4 and of the product's
2e-3; eccentricities drawn from either prior, where the stated sigmas ought to be the true ones;
3e-4 under 5e-4 with the semi-major axis believed to 30 km; and satellites held over the equator
under the prior for them. Per cell the median error of the semi-major axis (km), the median error
of the prediction 1 h and 24 h after the last direction (arcsec), the share of predictions inside
their 3-sigma ellipse, and the stated sigma over the true one (root mean squares; both axes). Then
two nights, and the time of refining.
"""

import argparse
import json
import os
import platform
import statistics
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbits import (
    MeasuredDirections,
    Orbit,
    determine_orbit,
    osculating_elements,
    predict,
)
from rsoconsole.orbits.determination.fit import Prior
from rsoconsole.orbits.determination.regimes import REGIMES
from rsoconsole.pipeline import OnlineOrbit
from rsoconsole.records import FloatArray, Measurement, Site, TrackState
from rsoconsole.sky import SkyPlaces, iso_to_utc_ns
from tests.truth.orbit_truth import DAYTONA, geostationary, off_arcsec, seen_with_noise

RESULTS = Path(__file__).parent / "results" / "orbit.json"
T0_UTC_NS = iso_to_utc_ns("2023-06-22T03:00:00Z")
ARCS_MIN = (10, 30, 60, 240)
SIGMAS_ARCSEC = (1.0, 4.0)
CADENCE_S = 30.0
HOUR_S, DAY_S = 3600.0, 86400.0
PUBLISHED = {
    (10, 4.0): (8.0, 21.0, 431.0),
    (30, 1.0): (7.0, 4.0, 387.0),
    (30, 4.0): (8.0, 7.0, 398.0),
    (60, 4.0): (7.0, 6.0, 373.0),
    (240, 4.0): (2.5, 1.8, 130.0),
}
"""Measured before the project began, prior 5e-4 and eccentricity 3e-4: km, arcsec, arcsec."""


PUBLISHED_OF = ("e 3e-4, prior 5e-4", "e 3e-4, prior 5e-4, a 30 km")


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """How orbits are, and what is believed of them."""

    name: str
    prior: Prior
    true_e: float | None = None
    """None: drawn from the prior."""
    true_a_km: tuple[float, float] = (42_166.0, 15.0)
    """Mean and sigma."""
    inclinations_deg: tuple[float, ...] = (0.05, 7.0)

    def eccentricities(self, random: np.random.Generator, count: int) -> FloatArray:
        if self.true_e is not None:
            return np.full(count, self.true_e)
        assert self.prior.sigma_e is not None
        parts = random.normal(0.0, self.prior.sigma_e / np.sqrt(2.0), (count, 2))
        return np.asarray(np.hypot(parts[:, 0], parts[:, 1]))


WORLDS = (
    World(name="e 3e-4, prior 5e-4", prior=Prior(sigma_e=5e-4), true_e=3e-4),
    World(name="e drawn from prior 5e-4", prior=Prior(sigma_e=5e-4)),
    World(name="e 3e-4, prior 2e-3", prior=Prior(sigma_e=2e-3), true_e=3e-4),
    World(name="e drawn from prior 2e-3", prior=Prior(sigma_e=2e-3)),
    World(
        name="e 3e-4, prior 5e-4, a 30 km",
        prior=Prior(sigma_e=5e-4, a_km=42_166.0, sigma_a_km=30.0),
        true_e=3e-4,
    ),
    World(
        name="held, prior slot",
        prior=REGIMES["slot"].prior,
        true_e=2.7e-4,
        true_a_km=(42_165.9, 0.7),
        inclinations_deg=(0.05,),
    ),
)
"""The last: as the catalogue has them (`rsoconsole/orbits/determination/regimes.py`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """What a hundred or more runs of one kind came to; `h1` and `h24`: so long after the arc."""

    world: str
    arc_min: int
    sigma_arcsec: float
    i_deg: float
    runs: int
    labels: dict[str, int]
    median_a_km: float
    median_h1_arcsec: float
    median_h24_arcsec: float
    inside_h1: float
    inside_h24: float
    stated_over_true_h1: float
    stated_over_true_h24: float
    stated_over_true_a: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    label: str
    a_km: float
    sigma_a_km: float
    off_arcsec: FloatArray
    """(2, 2): after an hour and a day, east and north."""
    cov_arcsec2: FloatArray
    """(2, 3)"""


def cells_of(world: World, i_deg: float, arc_min: int, runs: int, seed: int) -> list[Cell]:
    """One for each sigma, on the same satellites."""
    random = np.random.default_rng([seed, arc_min, round(i_deg * 100)])
    flight = geostationary(
        random,
        runs,
        t0_utc_ns=T0_UTC_NS,
        i_deg=i_deg,
        e=world.eccentricities(random, runs),
        a_km=world.true_a_km,
    )
    end_s = arc_min * 60.0
    arc_s = np.arange(0.0, end_s + 1.0, CADENCE_S)
    all_s = np.concatenate([arc_s, [end_s + HOUR_S, end_s + DAY_S]])
    places, states = flight.places(all_s), flight.states(all_s)
    cells = []
    for sigma in SIGMAS_ARCSEC:
        found = [_run(places[m], states[:, m], sigma, world, random) for m in range(runs)]
        cells.append(_cell(world, arc_min, sigma, i_deg, found))
    return cells


def _run(
    places: SkyPlaces,
    states: FloatArray,
    sigma: float,
    world: World,
    random: np.random.Generator,
) -> _Run:
    arc, later = _part(places, slice(0, -2)), _part(places, slice(-2, None))
    seen = seen_with_noise(random, DAYTONA, arc, sigma)
    with patch.dict(REGIMES, geo=replace(REGIMES["geo"], prior=world.prior)):
        orbit = determine_orbit(seen, prior="geo")
    assert orbit is not None
    truth = states[int(np.flatnonzero(places.t_utc_ns == orbit.epoch_utc_ns)[0])]
    ahead = predict(orbit, DAYTONA, later.t_utc_ns)
    return _Run(
        label=orbit.label,
        a_km=osculating_elements(orbit.r_km, orbit.v_km_s).a_km
        - osculating_elements(truth[:3], truth[3:]).a_km,
        sigma_a_km=orbit.sigma_a_km,
        off_arcsec=off_arcsec(ahead.places, later),
        cov_arcsec2=ahead.cov_sky_arcsec2,
    )


def _part(places: SkyPlaces, chosen: slice) -> SkyPlaces:
    return SkyPlaces(
        **{name: getattr(places, name)[chosen] for name in SkyPlaces.__dataclass_fields__}
    )


def _cell(world: World, arc_min: int, sigma: float, i_deg: float, found: list[_Run]) -> Cell:
    off = np.array([each.off_arcsec for each in found])
    cov = np.array([each.cov_arcsec2 for each in found])
    matrices = np.moveaxis(cov[..., [0, 1, 1, 2]].reshape(*cov.shape[:2], 2, 2), 1, 0)
    inside, ratio = [], []
    for n in (0, 1):
        squares = np.einsum("mi,mij,mj->m", off[:, n], np.linalg.inv(matrices[n]), off[:, n])
        inside.append(float(np.mean(squares < 11.83)))
        stated = np.mean(np.trace(matrices[n], axis1=-2, axis2=-1))
        ratio.append(float(np.sqrt(stated / np.mean(np.sum(off[:, n] ** 2, axis=-1)))))
    far = np.linalg.norm(off, axis=-1)
    a_km = np.array([each.a_km for each in found])
    stated_a = np.array([each.sigma_a_km for each in found])
    names = [each.label for each in found]
    return Cell(
        world=world.name,
        arc_min=arc_min,
        sigma_arcsec=sigma,
        i_deg=i_deg,
        runs=len(found),
        labels={name: names.count(name) for name in sorted(set(names))},
        median_a_km=round(float(np.median(np.abs(a_km))), 2),
        median_h1_arcsec=round(float(np.median(far[:, 0])), 2),
        median_h24_arcsec=round(float(np.median(far[:, 1])), 1),
        inside_h1=round(inside[0], 3),
        inside_h24=round(inside[1], 3),
        stated_over_true_h1=round(ratio[0], 2),
        stated_over_true_h24=round(ratio[1], 2),
        stated_over_true_a=round(float(np.sqrt(np.mean(stated_a**2) / np.mean(a_km**2))), 2),
    )


def two_nights(runs: int, seed: int) -> list[dict[str, float | int | dict[str, int]]]:
    """Ten minutes a night, two nights: the 24 hours after them."""
    rows: list[dict[str, float | int | dict[str, int]]] = []
    once_s = np.arange(0.0, 601.0, CADENCE_S)
    since_s = np.concatenate([once_s, DAY_S + once_s, [DAY_S + 600.0 + DAY_S]])
    for sigma in SIGMAS_ARCSEC:
        random = np.random.default_rng([seed, 77])
        flight = geostationary(random, runs, t0_utc_ns=T0_UTC_NS, i_deg=0.05, e=np.full(runs, 3e-4))
        off, inside, labels = [], [], []
        for places in flight.places(since_s):
            later = _part(places, slice(-1, None))
            orbit = determine_orbit(
                seen_with_noise(random, flight.site, _part(places, slice(0, -1)), sigma)
            )
            assert orbit is not None
            ahead = predict(orbit, flight.site, later.t_utc_ns)
            ee, en, nn = ahead.cov_sky_arcsec2[0]
            each = off_arcsec(ahead.places, later)[0]
            off.append(float(np.hypot(*each)))
            inside.append(each @ np.linalg.solve([[ee, en], [en, nn]], each) < 11.83)
            labels.append(orbit.label)
        rows.append(
            {
                "sigma_arcsec": sigma,
                "runs": runs,
                "median_h24_arcsec": round(statistics.median(off), 2),
                "p95_h24_arcsec": round(float(np.quantile(off, 0.95)), 2),
                "inside_h24": round(float(np.mean(inside)), 3),
                "labels": {name: labels.count(name) for name in sorted(set(labels))},
            }
        )
    return rows


def refining(seed: int) -> list[dict[str, float | int]]:
    """Milliseconds for 500 directions, from an orbit through the first 490 of them."""
    rows: list[dict[str, float | int]] = []
    for name, since_s in (
        ("4 h", np.linspace(0.0, 4.0 * HOUR_S, 500)),
        ("25 min", np.linspace(0.0, 1500.0, 500)),
        ("two nights", np.concatenate([np.arange(250.0) * 30.0, DAY_S + np.arange(250.0) * 30.0])),
    ):
        random = np.random.default_rng([seed, 5])
        flight = geostationary(random, 1, t0_utc_ns=T0_UTC_NS, i_deg=0.05, e=np.array([3e-4]))
        places = flight.places(since_s)[0]
        seen = seen_with_noise(random, flight.site, places, 1.0)
        before = determine_orbit(seen.subset(np.arange(490)))
        assert before is not None
        state = (before.r_km, before.v_km_s)
        taken, cold = [], []
        for _ in range(9):
            begun = time.perf_counter()
            after = determine_orbit(seen, start=state)
            taken.append((time.perf_counter() - begun) * 1e3)
            assert isinstance(after, Orbit)
        for _ in range(3):
            begun = time.perf_counter()
            determine_orbit(seen)
            cold.append((time.perf_counter() - begun) * 1e3)
        rows.append(
            {
                "arc": name,
                "refined_ms": round(statistics.median(taken), 1),
                "best_refined_ms": round(min(taken), 1),
                "from_nothing_ms": round(statistics.median(cold), 1),
            }
        )
    return rows


def while_following(seed: int) -> list[dict[str, float | int]]:
    """Milliseconds of all that the engine does for the orbit after a frame, names left out.

    Reading which measurements the track took, reducing the new one, judging what was predicted of
    it, refining, and making the record.
    """
    random = np.random.default_rng([seed, 6])
    flight = geostationary(random, 1, t0_utc_ns=T0_UTC_NS, i_deg=0.05, e=np.array([3e-4]))
    places = flight.places(np.arange(500.0) * CADENCE_S)[0]
    seen = seen_with_noise(random, flight.site, places, 1.0)
    online = OnlineOrbit(Config.model_validate({"site": _site(flight.site)}))
    taken: list[float] = []
    for n in range(len(seen)):
        for record in _followed(seen, n):
            online.receive(record)
        begun = time.perf_counter()
        online.refine()
        taken.append((time.perf_counter() - begun) * 1e3)
    return [
        {
            "directions": count,
            "median_ms": round(statistics.median(taken[count - 20 : count]), 1),
            "worst_ms": round(max(taken[count - 20 : count]), 1),
        }
        for count in (30, 120, 500)
    ]


def _site(site: Site) -> dict[str, float]:
    return {
        "latitude_deg": site.latitude_deg,
        "longitude_deg": site.longitude_deg,
        "elevation_m": site.elevation_m,
    }


def _followed(seen: MeasuredDirections, n: int) -> tuple[Measurement, TrackState]:
    """What the loop puts on record of a direction that the track takes."""
    t_utc_ns, frame_id = int(seen.t_utc_ns[n]), n + 1
    ra, dec = float(seen.ra_icrs_deg[n]), float(seen.dec_icrs_deg[n])
    measured = Measurement(
        measurement_id=f"{frame_id}-0",
        frame_id=frame_id,
        t_mid_utc_ns=t_utc_ns,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(1.0, 0.0, 1.0),
        x_px=0.0,
        y_px=0.0,
        confidence=1.0,
        source="network",
    )
    track = TrackState(
        track_id=1,
        measurement_id=f"{frame_id}-0",
        kind="updated" if n else "initial",
        frame_id=frame_id,
        t_utc_ns=t_utc_ns,
        x=(ra, 0.0, dec, 0.0),
        P=((1.0, 0.0, 0.0, 0.0),) * 4,
        nis=2.0,
        sigma_innovation_arcsec=(2.0, 2.0),
    )
    return measured, track


def _print(cells: list[Cell]) -> None:
    print(f"{'world':28}{'arc':>5}{'sig':>4}{'i':>6}  {'da km':>7}{'1 h':>8}{'24 h':>8}", end="")
    print(f"  {'inside 1 h':>10}{'24 h':>7}  {'stated/true 1 h':>15}{'24 h':>6}{'a':>6}  published")
    for c in cells:
        known = PUBLISHED.get((c.arc_min, c.sigma_arcsec)) if c.world in PUBLISHED_OF else None
        print(
            f"{c.world:28}{c.arc_min:5}{c.sigma_arcsec:4.0f}{c.i_deg:6.2f}  {c.median_a_km:7.2f}"
            f"{c.median_h1_arcsec:8.2f}{c.median_h24_arcsec:8.1f}  {c.inside_h1:10.3f}"
            f"{c.inside_h24:7.3f}  {c.stated_over_true_h1:15.2f}{c.stated_over_true_h24:6.2f}"
            f"{c.stated_over_true_a:6.2f}  {known or ''} {c.labels}",
            flush=True,
        )


_COLUMNS = {
    "e 3e-4, prior 5e-4, a 30 km": "e 3e-4, prior 5e-4, a to 30 km",
    "e 3e-4, prior 5e-4": "e 3e-4, prior 5e-4",
    "e 3e-4, prior 2e-3": "e 3e-4, prior `geo`",
    "e drawn from prior 2e-3": "e as prior `geo` says",
    "held, prior slot": "held in a slot, prior `slot`",
}


def table(kept: dict[str, Any]) -> str:
    """The cells for people: median errors at both inclinations after an hour and a day, arcsec."""
    cells = {(c["world"], c["arc_min"], c["sigma_arcsec"], c["i_deg"]): c for c in kept["cells"]}
    rows = [f"| arc, sigma | {' | '.join(_COLUMNS.values())} |", "|---|" + "---|" * len(_COLUMNS)]
    for arc in ARCS_MIN:
        for sigma in SIGMAS_ARCSEC:
            row = []
            for world in _COLUMNS:
                both = [c for i in (0.05, 7.0) if (c := cells.get((world, arc, sigma, i)))]
                after = [
                    ", ".join(f"{c[key]:.{digits}f}" for c in both)
                    for key, digits in (("median_h1_arcsec", 1), ("median_h24_arcsec", 0))
                ]
                row.append(" / ".join(after))
            rows.append(f'| {arc} min, {sigma:.0f}" | {" | ".join(row)} |')
    return "\n".join(rows)


def summary(kept: dict[str, Any]) -> dict[str, tuple[float, float, float, float]]:
    """Of each world: least and largest share inside 3 sigma, stated over true sigma after a day."""
    found = {}
    for world in _COLUMNS:
        of = [c for c in kept["cells"] if c["world"] == world]
        inside = [c[key] for c in of for key in ("inside_h1", "inside_h24")]
        ratio = [c["stated_over_true_h24"] for c in of]
        found[world] = (min(inside), max(inside), min(ratio), max(ratio))
    return found


def _measured(world: World, runs: int, seed: int) -> list[dict[str, object]]:
    cells: list[Cell] = []
    for i_deg in world.inclinations_deg:
        for arc_min in ARCS_MIN:
            these = cells_of(world, i_deg, arc_min, runs, seed)
            _print(these)
            cells += these
    return [asdict(each) for each in cells]


def main() -> None:
    """Measure, print, and keep with ``--write``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=20230622)
    parser.add_argument("--only", choices=["cells", "nights", "refining"])
    parser.add_argument("--world", choices=[each.name for each in WORLDS], help="this one alone")
    parser.add_argument("--write", action="store_true", help=f"keep the figures in {RESULTS.name}")
    parser.add_argument("--table", action="store_true", help="only print what is kept")
    given = parser.parse_args()
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    if given.table:
        print(table(kept))
        print(*summary(kept).items(), sep="\n")
        return
    if given.only in {None, "refining"}:
        kept["refining"] = refining(given.seed)
        kept["while_following"] = while_following(given.seed)
        print(*kept["refining"], *kept["while_following"], sep="\n")
    if given.only in {None, "nights"}:
        kept["two_nights"] = two_nights(given.runs, given.seed)
        print(*kept["two_nights"], sep="\n")
    if given.only in {None, "cells"}:
        for world in WORLDS:
            if given.world in {None, world.name}:
                kept["cells"] = [
                    *(each for each in kept.get("cells", []) if each["world"] != world.name),
                    *_measured(world, given.runs, given.seed),
                ]
                if given.write:  # a world takes minutes
                    RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
    kept["machine"] = f"{platform.machine()}, {os.cpu_count()} cores"
    kept[f"load_{given.only or 'all'}"] = round(os.getloadavg()[0], 1)
    if given.write:
        RESULTS.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
