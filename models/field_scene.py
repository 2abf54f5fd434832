"""Random fields with their truth, for training and evaluation of the detector's network.

This module chooses what to draw; ``rsoconsole.simulator.camera.rendering`` draws it.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from models import alterations
from models.extras import (
    Canvas,
    Points,
    aircraft,
    close_stars,
    clouds,
    galaxy,
    ghost,
    meteor,
    spiked_star,
    wander,
)
from models.fields import (
    FIELD_CELLS,
    KINDS,
    Conditions,
    Field,
    FloatArray,
    Kind,
    TrueStreak,
    clip_to_box,
)
from models.light import log_uniform
from models.satellites import Satellites
from rsoconsole.records import MapMode
from rsoconsole.simulator import FWHM_PER_SIGMA, FieldContent, SensorModel, Streak, render
from rsoconsole.vision import find_row_column_pattern, make_map

_SHARES = (0.62, 0.08, 0.11, 0.10, 0.06, 0.03)
"""Share of each of ``KINDS`` in the fields."""
_SATELLITE_SHARE = {
    "ordinary": 1.0,
    "empty": 0.0,
    "trailed stars": 0.4,
    "aircraft": 0.5,
    "rays": 0.7,
    "meteor": 0.5,
}
_MAX_STAR_POINTS = 150_000
_COVERED_SHARE = 0.5
"""Share of hard fields with trailed stars in which these have been covered with sky."""


def draw_sensor(block: int, rng: np.random.Generator, *, is_hard: bool = True) -> SensorModel:
    """A random sensor whose frame has 192 cells of ``block`` x ``block`` pixels on a side.

    ``is_hard`` False: the paper's sensor without imperfections other than its seed's.
    """
    side = FIELD_CELLS * block
    if not is_hard:
        return SensorModel(width_px=side, height_px=side, seed=int(rng.integers(1 << 30)))
    gain = float(rng.choice([20000.0 / 4096.0, 20000.0 / 4096.0, 1.2]))
    has_bad_columns = rng.random() < 0.5
    bad, partial, dark = rng.poisson((0.7, 1.0, 1.0)) * has_bad_columns
    # A smaller field is a cut of the frame: as many hot pixels a cell as at a block of 8.
    sensor = SensorModel(
        width_px=side,
        height_px=side,
        e_per_adu12=gain,
        full_well_e=4096.0 * gain,
        read_noise_e=float(rng.uniform(1.0, 5.0)),
        vignetting_corner=float(rng.uniform(0.0, 0.3)),
        prnu=float(rng.uniform(0.001, 0.01)),
        hot_fraction=log_uniform(rng, 1e-5, 4e-4) * (8 / block) ** 0.7,
        bad_columns=int(bad),
        partial_columns=int(partial),
        dark_columns=int(dark),
        blooming=float(rng.uniform(0.2, 1.0)) if rng.random() < 0.2 else 0.0,
        seed=int(rng.integers(1 << 30)),
    )
    return alterations.altered_sensor(sensor, block, rng)


def draw_field(
    sensor: SensorModel, block: int, conditions: Conditions, rng: np.random.Generator
) -> Field:
    """One random field: its map as the network sees it, and its truth.

    ``block``: pixels per cell of the map.
    """
    kind = conditions.kind or KINDS[int(rng.choice(len(KINDS), p=_SHARES))]
    mode: MapMode = conditions.mode or ("paper" if rng.random() < 0.15 else "fast")
    is_hard = conditions.is_hard
    sky_e = alterations.sky_electrons(sensor, rng) if is_hard else rng.uniform(100.0, 170.0)
    canvas = _canvas(sensor, block, sky_e, rng, is_hard=is_hard)
    stars = _stars(canvas, block, rng, is_hard=is_hard)
    trails: list[Streak] = []
    path_px = wander(canvas, rng) if kind == "trailed stars" else None
    motion_px: FloatArray | None = None
    are_covered = False
    if path_px is not None:
        stars = _trailed(stars, path_px, canvas, rng)
        are_covered = is_hard and rng.random() < _COVERED_SHARE
        if are_covered:
            stars = alterations.covered(stars, path_px, canvas, rng)
    elif is_hard:
        stars, trails = _mimics(stars, canvas, rng)
        motion_px = alterations.motion(canvas, rng)
    cloud = clouds(rng) if is_hard and rng.random() < 0.25 else None
    content = FieldContent(
        fwhm_px=canvas.fwhm_px,
        defocus_px=canvas.defocus_px,
        sky_electrons_px=sky_e,
        sky_gradient=alterations.gradient(rng) if is_hard else _slight_gradient(rng),
        star_x_px=stars[0],
        star_y_px=stars[1],
        star_electrons=stars[2],
        star_path_px=path_px,
        stands=None if motion_px is None else alterations.stands(motion_px, canvas),
        cloud_transmission=cloud,
        **_rays(kind, block, canvas, rng, is_hard=is_hard),
        **(alterations.stripes(canvas, rng) if is_hard else {}),
    )
    truth: list[TrueStreak] = []
    if conditions.streaks is not None or rng.random() < _SATELLITE_SHARE[kind]:
        satellites = Satellites(
            sensor=sensor,
            canvas=canvas,
            content=content,
            mode=mode,
            block=block,
            conditions=conditions,
            rng=rng,
            motion_px=motion_px,
            are_stars_covered=are_covered,
        )
        drawn, truth = satellites.draw(path_px)
        trails += drawn
    if kind == "aircraft":
        trails += aircraft(canvas, rng)
    if kind == "meteor":
        trails += meteor(canvas, rng)
    if is_hard and conditions.streaks is None:
        passing = alterations.crossings(canvas, rng)
        trails += passing
        truth += [each for streak in passing for each in unasked(streak, block)]
    content = replace(content, streaks=tuple(trails))
    pixels = render(sensor, content, rng)
    # As the detector does before it makes its map.
    pattern = find_row_column_pattern(pixels)
    values = make_map(pixels if pattern is None else pattern.removed(pixels), mode, block).values
    return Field(values=values, kind=kind, mode=mode, block=block, streaks=tuple(truth))


def _slight_gradient(rng: np.random.Generator) -> tuple[float, float]:
    return float(rng.normal(0, 0.15)), float(rng.normal(0, 0.15))


def unasked(streak: Streak, block: int) -> list[TrueStreak]:
    """Truth of a trail from edge to edge that counts neither as found nor as false.

    Empty for a trail outside the field. ``block``: pixels per cell of the map.
    """
    a, b = (((streak.x_px[i] + 0.5) / block, (streak.y_px[i] + 0.5) / block) for i in (0, -1))
    seen = clip_to_box((*a, *b), FIELD_CELLS, FIELD_CELLS)
    if seen is None:
        return []
    x_a, y_a, x_b, y_b = (float(v) for v in seen)
    return [
        TrueStreak(
            x_a=x_a, y_a=y_a, x_b=x_b, y_b=y_b, peak_snr=0.0, integrated_snr=0.0, is_asked=False
        )
    ]


def _canvas(
    sensor: SensorModel, block: int, sky_e: float, rng: np.random.Generator, *, is_hard: bool
) -> Canvas:
    """The frame with its seeing: half of the hard ones far from what the paper's camera has."""
    fwhm_px, defocus_px = float(rng.uniform(1.9, 2.8)), 0.0
    if is_hard:
        fwhm_px, defocus_px = alterations.seeing(block, rng)
    return Canvas(
        width_px=sensor.width_px,
        height_px=sensor.height_px,
        fwhm_px=fwhm_px,
        noise_e=float(np.sqrt(sky_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0)),
        unit_px=float(block),
        defocus_px=defocus_px,
    )


def _stars(canvas: Canvas, block: int, rng: np.random.Generator, *, is_hard: bool) -> Points:
    """Places x, y and electrons of stars: a power law in flux, a log-uniform density."""
    low, high = (0.004, 0.5) if is_hard else (0.02, 0.3)
    cells = canvas.width_px * canvas.height_px / block**2
    count = int(rng.poisson(log_uniform(rng, low, high) * cells))
    slope = rng.uniform(0.7, 1.1)
    electrons = canvas.star_e(0.8) * (1.0 - rng.random(count)) ** (-1.0 / slope)
    x = rng.uniform(-8.0, canvas.width_px + 8.0, count)
    y = rng.uniform(-8.0, canvas.height_px + 8.0, count)
    return x, y, np.minimum(electrons, 3e6)


def _trailed(
    stars: Points, path_px: FloatArray, canvas: Canvas, rng: np.random.Generator
) -> Points:
    """Trailed stars, enough to be seen as many alike, bright enough though drawn out."""
    length = float(np.hypot(*np.diff(path_px, axis=1)).sum())
    most = int(min(log_uniform(rng, 200, 2500), _MAX_STAR_POINTS / max(length, 2.0)))
    x, y, electrons = stars
    fewest = int(rng.integers(150, 400))
    if len(x) < fewest:
        extra = fewest - len(x)
        slope = rng.uniform(0.7, 1.1)
        more_e = canvas.star_e(0.8) * (1.0 - rng.random(extra)) ** (-1.0 / slope)
        x = np.concatenate([x, rng.uniform(-8.0, canvas.width_px + 8.0, extra)])
        y = np.concatenate([y, rng.uniform(-8.0, canvas.height_px + 8.0, extra)])
        electrons = np.concatenate([electrons, more_e])
    order = np.argsort(-electrons)[: max(most, fewest)]
    boost = 1.0 + length / canvas.fwhm_px * rng.uniform(0.3, 1.5)
    return x[order], y[order], np.minimum(electrons[order] * boost, 3e6)


def _mimics(stars: Points, canvas: Canvas, rng: np.random.Generator) -> tuple[Points, list[Streak]]:
    """Close stars, galaxies, spikes and ghosts, each in some of the fields."""
    trails: list[Streak] = []
    points = [stars]
    if rng.random() < 0.4:
        points += [close_stars(canvas, rng) for _ in range(int(rng.integers(1, 16)))]
    if rng.random() < 0.12:
        angle, arms = rng.uniform(0, np.pi), int(rng.choice([4, 4, 6]))
        for _ in range(int(rng.integers(1, 4))):
            star, spikes = spiked_star(canvas, rng, angle=angle, arms=arms)
            points.append(star)
            trails += spikes
    nuisances: tuple[tuple[float, int, Callable[[Canvas, np.random.Generator], list[Streak]]], ...]
    nuisances = ((0.15, 6, galaxy), (0.07, 3, ghost))
    for share, most, draw in nuisances:
        if rng.random() < share:
            for _ in range(int(rng.integers(1, most + 1))):
                trails += draw(canvas, rng)
    x, y, electrons = (np.concatenate(part) for part in zip(*points, strict=True))
    return (x, y, electrons), trails


def _rays(
    kind: Kind, block: int, canvas: Canvas, rng: np.random.Generator, *, is_hard: bool
) -> dict[str, Any]:
    """Number, width and length of cosmic rays."""
    # Tracks keep their length in pixels: the same number would fill a small field.
    size = (block / 8) ** 1.3
    if kind == "rays":
        widest = float(rng.uniform(0.28, 0.9) * canvas.fwhm_px / FWHM_PER_SIGMA)
        return {
            "cosmic_rays": log_uniform(rng, 50, 400) * size,
            "cosmic_ray_sigma_px": (0.2, max(widest, 0.3)),
            "cosmic_ray_stretch": float(rng.uniform(1.0, 2.0)),
        }
    if not is_hard:
        return {"cosmic_rays": 12.0 * size}
    return {
        "cosmic_rays": log_uniform(rng, 3, 150) * size,
        "cosmic_ray_sigma_px": (0.25, float(rng.uniform(0.28, 0.6))),
    }
