"""How well magnitudes of streaks, and the errors that they are given, hold against the truth.

    python -m tests.campaign.brightness all --count 60 --write
    python -m tests.campaign.brightness clear worlds --quick

Each number is one frame with six satellites of known magnitude, and the frame of the same field
before it, through the engine's own reduction; some five seconds of a core. Stop it when you like;
the same command goes on (``--folder``). ``--write`` puts the table into README.md and the rows into
``results/brightness``.
"""

import math
import statistics
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.pipeline import Reduction
from rsoconsole.pipeline.frame.plate import FixedPlateSource
from rsoconsole.pipeline.frame.reduce import FrameReducer
from rsoconsole.pipeline.photometry.frame_photometry import photometry_of
from rsoconsole.records import Detection, Photometry, StreakLight, measurement_id_of
from rsoconsole.vision import ConfidenceCurve, Network
from tests.campaign.brightness_worlds import FAMILIES, DrawnFrames, TrueLight, draw
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read
from tests.campaign.streaks import is_on

BANDS = ((20.0, 40.0), (40.0, 80.0), (80.0, math.inf))
"""Integrated SNR."""
WITHIN_MAG = (0.05, 0.10, 0.15, 0.25)
QUICK = 3
Row = dict[str, Any]
_networks: list[Network] = []


def network() -> Network:
    """One a process."""
    if not _networks:
        _networks.append(Network.load(None, 1))
    return _networks[0]


def measured(drawn: DrawnFrames) -> tuple[Reduction, Photometry | None]:
    """Both frames through the engine's reduction, by their plates; the second one's brightness."""
    plate = FixedPlateSource()
    curve = ConfidenceCurve.from_card(network().card)
    reducer = FrameReducer(network(), curve, plate, Config())
    reduction: Reduction | None = None
    for frame, solution in (drawn.before, drawn.frame):
        plate.solution = solution
        reduction = reducer.reduce(frame)
    assert reduction is not None
    light = reduction.light
    return reduction, None if light is None else photometry_of(light)


def row_of(name: str, number: int) -> Row:
    """One frame and its satellites."""
    drawn = draw(name, number)
    reduction, found = measured(drawn)
    world = drawn.world
    return {
        "number": number,
        "fwhm_px": round(world.scene.content.fwhm_px, 2),
        "scale_arcsec_px": round(world.scene.sensor.scale_arcsec_px, 3),
        "bits": world.scene.sensor.adc_bits,
        "is_moved": world.scene.motion is not None,
        "vignetting": round(world.scene.sensor.vignetting_corner, 3),
        "stars": world.catalogue_stars,
        "colour_term": round(world.colour_term, 3),
        "zero_point_mag": found and found.zero_point_mag,
        "zero_point_sigma_mag": found and found.zero_point_sigma_mag,
        "zero_point_stars": found.zero_point_stars if found else 0,
        "zero_point_scatter_mag": found and found.zero_point_scatter_mag,
        "colour_term_found": found and found.colour_term,
        "streaks": [_streak_row(light, reduction, found) for light in drawn.lights],
    }


def _streak_row(light: TrueLight, reduction: Reduction, found: Photometry | None) -> Row:
    """The truth of one satellite, and what is measured of it."""
    streak = _of(light, reduction.detections.detections)
    row: Row = {
        "snr": round(light.snr, 2),
        "length_px": round(math.dist(light.ends[:2], light.ends[2:]), 1),
        "mag": round(light.mag, 4),
        "sun_mag": round(light.sun_mag, 4),
        "is_steady": light.is_steady,
        "is_found": streak is not None,
    }
    measured_light = None
    if streak is not None and found is not None:
        number = reduction.detections.detections.index(streak)
        name = measurement_id_of(reduction.detections.frame_id, number)
        measured_light = next((s for s in found.streaks if s.measurement_id == name), None)
    return row | light_row(measured_light, light)


def light_row(found: StreakLight | None, light: TrueLight) -> Row:
    """What is measured of a satellite less its truth."""
    if found is None or found.mag is None or found.band != "V":
        return {"error_mag": None}
    return {
        "error_mag": round(found.mag - light.sun_mag, 4),
        "sigma_mag": found.mag_sigma,
        "colour_error_mag": round(found.mag - light.mag, 4),
        "colour_sigma_mag": found.sigma_mag,
        "flux_error_share": round(found.flux_adu / light.flux_adu - 1.0, 4),
        "flux_sigma_share": round(found.flux_sigma_adu / light.flux_adu, 4),
        "is_saturated": found.is_saturated,
        "is_blended": found.is_blended,
    }


def _of(light: TrueLight, streaks: Sequence[Detection]) -> Detection | None:
    """The detection of a satellite; the most confident one of several."""
    on_it = [each for each in streaks if is_on(each, light.ends)]
    return max(on_it, key=lambda each: each.confidence, default=None)


def streaks_of(rows: Sequence[Row], band: tuple[float, float]) -> list[Row]:
    """Every satellite of a band of SNR."""
    low, high = band
    return [each for row in rows for each in row["streaks"] if low <= each["snr"] < high]


def line_of(title: str, rows: Sequence[Row], band: tuple[float, float]) -> str:
    """One line of the table."""
    drawn = streaks_of(rows, band)
    found = [each for each in drawn if each["is_found"]]
    judged = [each for each in found if each["error_mag"] is not None]
    judged = [each for each in judged if not each["is_saturated"]]
    low, high = band
    cells = [
        title,
        f"{low:g} to {high:g}" if math.isfinite(high) else f"from {low:g}",
        f"{len(judged)} of {len(found)} of {len(drawn)}",
    ]
    if not judged:
        return "| " + " | ".join([*cells, *["-"] * 8]) + " |\n"
    errors = [each["error_mag"] for each in judged]
    cells += [
        f"{statistics.median(errors):+.3f}",
        f"{statistics.median(map(abs, errors)):.3f}",
        *(f"{share(abs(error) <= limit for error in errors):.3f}" for limit in WITHIN_MAG),
        coverage([(each["error_mag"], each["sigma_mag"]) for each in judged]),
        coverage([(each["colour_error_mag"], each["colour_sigma_mag"]) for each in judged]),
    ]
    return "| " + " | ".join(cells) + " |\n"


def share(are_true: Any) -> float:
    """Share of what is true."""
    known = list(are_true)
    return sum(known) / len(known)


def coverage(pairs: Sequence[tuple[float, float]]) -> str:
    """Shares of errors within one, two and three of their own sigmas."""
    return " / ".join(
        f"{share(abs(error) <= sigmas * sigma for error, sigma in pairs):.2f}"
        for sigmas in (1, 2, 3)
    )


def table(found: dict[str, Sequence[Row]]) -> str:
    """By family and by third of SNR, and all together."""
    text = (
        "| nights | SNR | measured of found of drawn | median error | median without sign | within "
        + " | ".join(f"{limit:.2f}" for limit in WITHIN_MAG)
        + " | 1, 2, 3 sigma | with unknown colour |\n|"
        + "---|" * (7 + len(WITHIN_MAG))
        + "\n"
    )
    for name, rows in found.items():
        title = f"{FAMILIES[name].title}, {len(rows)} frames"
        text += "".join(line_of(title, rows, band) for band in BANDS if streaks_of(rows, band))
    every = [row for rows in found.values() for row in rows]
    return text + "".join(line_of("**all together**", every, band) for band in BANDS)


def known_rows(folder: Path) -> dict[str, Sequence[Row]]:
    """Rows of each family that has been drawn."""
    return {name: rows for name in FAMILIES if (rows := read(folder / f"{name}.jsonl"))}


def main() -> None:
    """Run what is missing, print the table."""
    parser = parser_of("brightness", __doc__, 60)
    parser.add_argument("families", nargs="+", choices=[*FAMILIES, "all", "table"])
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} frames of each family")
    chosen = parser.parse_args()
    names = list(FAMILIES) if "all" in chosen.families else chosen.families
    count = QUICK if chosen.quick else chosen.count
    for name in (each for each in names if each in FAMILIES):
        complete(chosen.folder / f"{name}.jsonl", partial(row_of, name), count, chosen.jobs)
    text = table(known_rows(chosen.folder))
    print(text, end="")
    if chosen.write:
        keep(chosen.folder, "brightness")
        put_into_page("brightness", text)


if __name__ == "__main__":
    main()
