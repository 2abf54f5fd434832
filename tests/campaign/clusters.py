"""Nights of geostationary clusters: a member that fades, clouds, the demo's world and random ones.

Every field has element sets that the project did not make. ``LONG``: the close approaches through
their hours.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from rsoconsole.simulator import World, random_world, world_from, world_to_toml

FRAMES, LONG_FRAMES = 60, 400
RANDOM_WORLDS = 2
"""Beside the demo's own, for each field and seed."""
_CLOUDS = {"rate_h": 3.0, "duration_s": 120.0, "extinction_mag": 3.0}
_FADE_MAG_H = 4.0
"""Two magnitudes in sixty frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Satellites that stand together above a site."""

    norad_ids: tuple[int, ...]
    """The last one fades."""
    site: str
    at: str = ""
    """UTC of a night of sixty frames; empty: when they are up."""
    long_at: str = ""
    """Of one through the hours of a close approach."""


FIELDS = {
    "astra-19.2E": Field(norad_ids=(29055, 31306, 33436, 37775), site="45,10,200"),
    "badr-26E": Field(norad_ids=(33154, 36592, 41029, 43700, 29526), site="45,20,200"),
    "hotbird-13E": Field(norad_ids=(28946, 54225, 29270), site="45,10,200"),
    # Within 30 arcsec for 1.75 hours, 6 arcsec at the least.
    "hispasat-30W": Field(
        norad_ids=(37264, 43228),
        site="10,20,200",
        at="2023-06-23T18:40:00Z",
        long_at="2023-06-23T18:35:00Z",
    ),
    # Within 30 arcsec for 1.75 hours, below 10 arcsec at the least.
    "arabsat-30.5E": Field(
        norad_ids=(44186, 36745),
        site="45,30,200",
        at="2023-06-22T21:45:00Z",
        long_at="2023-06-22T20:40:00Z",
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterNight:
    """Words of one demo, and its world."""

    name: str
    words: tuple[str, ...]
    world: str


def nights(seeds: Sequence[int], elements: str) -> list[ClusterNight]:
    """Sixty frames of each field and seed, in the demo's world and in two random ones."""
    return [
        _night(name, seed, elements, world=world, frames=FRAMES, at=field.at)
        for seed in seeds
        for world in range(RANDOM_WORLDS + 1)
        for name, field in FIELDS.items()
    ]


def long_nights(seeds: Sequence[int], elements: str) -> list[ClusterNight]:
    """The close approaches for more than three hours: the first seed's in the demo's world."""
    return [
        _night(name, seed, elements, world=world, frames=LONG_FRAMES, at=field.long_at)
        for world, seed in enumerate(seeds)
        for name, field in FIELDS.items()
        if field.long_at
    ]


def _night(
    name: str, seed: int, elements: str, *, world: int, frames: int, at: str
) -> ClusterNight:
    field = FIELDS[name]
    together = (word for norad_id in field.norad_ids for word in ("--target", str(norad_id)))
    place = ("--site", field.site, *(("--at", at) if at else ()))
    number = 1000 * seed + 100 * world + list(FIELDS).index(name)
    return ClusterNight(
        name=f"{name}-{'demo' if not world else f'world-{number}'}-seed-{seed}",
        words=(
            *together,
            *("--tle", elements, *place),
            *("--seed", str(seed), "--frames", str(frames)),
        ),
        world=world_to_toml(_world(random_world(number) if world else None, field.norad_ids[-1])),
    )


def _world(drawn: World | None, fading: int) -> World:
    """This world with clouds and the member that fades."""
    table = (
        {}
        if drawn is None
        else {section: dict(of) for section, of in drawn.non_default_settings().items()}
    )
    table.setdefault("satellite", {}).update({"fade_mag_h": _FADE_MAG_H, "fade_norad": fading})
    table.setdefault("clouds", {}).update(_CLOUDS)
    return world_from(table)
