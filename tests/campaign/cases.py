"""Which nights there are, by group: the words for ``rsoconsole demo`` and the world around it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rsoconsole.simulator import elements_path
from tests.campaign import clusters
from tests.real_sky import real_sky_night

ELEMENTS = Path(__file__).resolve().parents[3] / "shared" / "data" / "tles"
"""Element files that the project did not make; groups that need them are left out without."""
FRAMES = 24
WORLD_FRAMES = 40
"""Of a random world: a hundred of them take more than an hour of two cores."""
SCATTERS_S = (0.015, 0.05, 0.1, 0.2, 0.5, 1.0)
_MIX, _GEO = "mix_20230622.tle", "geo_all_20230622.tle"
_BELT = (36097, 42432, 38749, 39078, 35942, 40874)
"""Geostationary satellites of the shipped elements that stand high above the paper's site."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealIndi:
    """A night of ``tests/real_sky/real_sky_night.py``, in real time: half a minute a frame."""

    frames: int
    seed: int
    scatter_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One night."""

    group: str
    name: str
    words: tuple[str, ...] = ()
    """What follows ``rsoconsole demo --headless --json``, but for the world."""
    world: str = ""
    """Text of a world file; empty: the world as the demo has it."""
    late_s: float | None = None
    """The engine waits for its target by elements by which it is so late (`late_pass`)."""
    is_over: Callable[[Path], bool] | None = None
    """By its session's folder, whether it may end before its frames are taken; None: it may not."""
    real_indi: RealIndi | None = None
    """Not a demo: a night on INDI's own simulators."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Nights that share one line of the table."""

    name: str
    title: str
    cases: Callable[[Sequence[int]], list[Case]]
    """From the seeds that are asked for."""
    seeds: tuple[int, ...]
    """When none are asked for."""
    needs_elements: bool = True
    lacks: Callable[[], str | None] = lambda: None
    """Why this machine cannot run them, and the remedy."""


def worlds(seeds: Sequence[int], frames: int = WORLD_FRAMES) -> list[Case]:
    """A night in the random world of each seed."""
    return [
        Case(
            group="worlds",
            name=f"world-{seed:03d}",
            words=(
                *("--target", str(_BELT[seed % len(_BELT)]), "--tle", str(elements_path())),
                *("--world", "random", "--seed", str(seed), "--frames", str(frames)),
            ),
        )
        for seed in seeds
    ]


def shutter(
    seeds: Sequence[int], scatters_s: Sequence[float] = SCATTERS_S, frames: int = FRAMES
) -> list[Case]:
    """A night with a shutter that opens so irregularly, for each scatter and seed."""
    return [
        Case(
            group="shutter",
            name=f"scatter-{scatter_s:g}-seed-{seed}",
            words=("--scenario", "intelsat-14", "--seed", str(seed), "--frames", str(frames)),
            world=f"[shutter]\nscatter_s = {scatter_s}\n",
        )
        for scatter_s in scatters_s
        for seed in seeds
    ]


def _objects(
    group: str, file: str, norad_ids: Sequence[int], *more: str, frames: int = FRAMES
) -> Callable[[Sequence[int]], list[Case]]:
    """A night for each object and seed."""

    def cases(seeds: Sequence[int]) -> list[Case]:
        return [
            Case(
                group=group,
                name=f"{norad_id}-seed-{seed}",
                words=(
                    *("--target", str(norad_id), "--tle", str(ELEMENTS / file), *more),
                    *("--seed", str(seed), "--frames", str(frames)),
                ),
            )
            for norad_id in norad_ids
            for seed in seeds
        ]

    return cases


def _astra(seeds: Sequence[int]) -> list[Case]:
    together = (word for norad in (29055, 31306, 33436, 37775) for word in ("--target", str(norad)))
    words = (*together, "--tle", str(ELEMENTS / _GEO), "--site", "45,10,200")
    return [
        Case(
            group="astra",
            name=f"seed-{seed}",
            words=(*words, "--seed", str(seed), "--frames", str(FRAMES)),
        )
        for seed in seeds
    ]


def _clusters(
    make: Callable[[Sequence[int], str], list[clusters.ClusterNight]], group: str
) -> Callable[[Sequence[int]], list[Case]]:
    return lambda seeds: [
        Case(group=group, name=night.name, words=night.words, world=night.world)
        for night in make(seeds, str(ELEMENTS / _GEO))
    ]


def _indi(seeds: Sequence[int]) -> list[Case]:
    return [
        Case(
            group="indiserver",
            name=f"scatter-{scatter_s:g}-seed-{seed}",
            real_indi=RealIndi(frames=FRAMES, seed=seed, scatter_s=scatter_s),
        )
        for scatter_s in (0.0, 0.2)
        for seed in seeds
    ]


def _inclined(seeds: Sequence[int]) -> list[Case]:
    cases = _objects("inclined", _GEO, tuple(_INCLINED))(seeds)
    sites = [site for site in _INCLINED.values() for _ in seeds]
    return [
        replace(case, words=(*case.words, "--site", site))
        for case, site in zip(cases, sites, strict=True)
    ]


_GPS = (26407, 43873, 23833, 27663, 28874, 34661, 39533, 41019)
_GALILEO = (37846, 40545, 41859, 43058)
_MOLNIYA = (7276, 8601, 11896, 13890, 17328, 21426)
_TRANSFER = (862, 23866, 27684, 33156, 39021)
_INCLINED = {
    634: "52.2,21.0,110",
    36395: "29.19,-81.05,10",
    36828: "-31.3,149.1,1100",
    37158: "-31.3,149.1,1100",
    42965: "-31.3,149.1,1100",
}
"""Each with a site that sees it."""
_LOW = (25544, 45085, 44713, 46039, 12, 4420, 8294, 11681, 22220, 38341)

GROUPS = {
    group.name: group
    for group in (
        Group(
            name="worlds",
            title=f"random worlds, geostationary, {WORLD_FRAMES} frames each",
            cases=worlds,
            seeds=tuple(range(1, 101)),
            needs_elements=False,
        ),
        Group(
            name="shutter",
            title="shutter scattered by 0.015 to 1 s",
            cases=shutter,
            seeds=(1, 2),
            needs_elements=False,
        ),
        Group(name="gps", title="GPS", cases=_objects("gps", _MIX, _GPS), seeds=(1,)),
        Group(
            name="galileo", title="Galileo", cases=_objects("galileo", _MIX, _GALILEO), seeds=(1,)
        ),
        Group(
            name="molniya", title="Molniya", cases=_objects("molniya", _MIX, _MOLNIYA), seeds=(1,)
        ),
        Group(
            name="transfer",
            title="transfer orbits",
            cases=_objects("transfer", _MIX, _TRANSFER),
            seeds=(1,),
        ),
        Group(
            name="inclined",
            title="inclined geosynchronous",
            cases=_inclined,
            seeds=(1,),
        ),
        Group(name="astra", title="Astra 19.2 E, four together", cases=_astra, seeds=(1, 2)),
        Group(
            name="clusters",
            title="clusters with a member that fades and clouds, demo's world and random ones",
            cases=_clusters(clusters.nights, "clusters"),
            seeds=(1, 2, 3),
        ),
        Group(
            name="approaches",
            title="close approaches, 400 frames, demo's world and random ones",
            cases=_clusters(clusters.long_nights, "approaches"),
            seeds=(1, 2, 3),
        ),
        Group(
            name="low",
            title="ten passes of low satellites",
            cases=_objects("low", _MIX, _LOW, frames=10),
            seeds=(1,),
        ),
        Group(
            name="indiserver",
            title="INDI's own simulators in real time",
            cases=_indi,
            seeds=(1,),
            needs_elements=False,
            lacks=real_sky_night.lacks,
        ),
    )
}
