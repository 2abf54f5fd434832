"""Satellites near the limit in the loop, and nights without any.

    python -m tests.campaign.limit_nights all --count 30 --write

``faint``, ``fainter``: the demo's sky with Intelsat 14 in the field, steady, dimmed to an
integrated SNR of 8 to 12 a frame, and of 6.5 to 8 (log-uniform). Counted is a track within eight
frames. ``empty``: 40 frames without a satellite, of four nights one with light that is fixed to the
sensor, and two in a random world. The same command goes on where it was stopped.
"""

import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models.intervals import rate_interval, share_interval
from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import Satellite
from rsoconsole.simulator import Scene, frame_rng, scenario_named, world_from
from rsoconsole.simulator.nights.night_plan import STANDARD_MAGNITUDE
from rsoconsole.simulator.nights.scenarios import STEADY
from tests.campaign import runner
from tests.campaign.cases import Case
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read

SNR = {"faint": (8.0, 12.0), "fainter": (6.5, 8.0)}
NIGHTS = (*SNR, "empty")
WITHIN, EMPTY_FRAMES = 8, 40
"""Frames in which a track has to begin; of an empty night."""
_AT = "2023-06-23T05:30:00Z"
_SITE = "29.19,-81.05,10"
_ELEMENTS = "rsoconsole/simulator/data/belt_20230622.tle"
_NS, _EXPOSURE_S, _CADENCE_S = 1_000_000_000, 10.0, 30.0
_FIXED = "[sensor]\nglow_e_s = {glow}\ncolumn_noise_sigma = {columns}\nhot_fraction = 0.0005\n"


def fainter_mag(seed: int, wanted: float) -> float:
    """Magnitudes that bring a typical satellite to an integrated SNR, by the renderer's own."""
    scenario = scenario_named("intelsat-14")
    assert scenario.target is not None
    typical_mag = STANDARD_MAGNITUDE["GEO"]
    target = Satellite(scenario.target.element_set, typical_mag)
    steady = replace(scenario.target, standard_magnitude=typical_mag, brightness=STEADY)
    scenario = replace(scenario, satellites=(steady,))
    t_utc_ns = scenario.t_start_utc_ns + round(0.5 * WITHIN * _CADENCE_S * _NS)
    place = target.astrometric_place(scenario.site, np.array([t_utc_ns]))
    where = (float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0]))
    mag = 0.0
    for _ in range(3):
        world = world_from({"satellite": {"fainter_mag": mag}})
        optics = OpticsConfig(width_px=900, height_px=700)
        scene = Scene(scenario, seed, optics=optics, world=world)
        _, truth = scene.expose(*where, 1.7, False, t_utc_ns, _EXPOSURE_S)
        snr = max(each.snr_integrated for each in truth.satellites)
        mag += 2.5 * math.log10(snr / wanted)
    return mag


def row_of(name: str, number: int) -> dict[str, Any]:
    """One night through the whole program."""
    seed = 5_000 + number
    rng = frame_rng(seed, NIGHTS.index(name))
    world, words, snr = "", ("--scenario", "empty", "--frames", str(EMPTY_FRAMES)), 0.0
    if name in SNR:
        snr = math.exp(float(rng.uniform(*np.log(SNR[name]))))
        world = f"[satellite]\nfainter_mag = {fainter_mag(seed, snr):.4f}\n"
        words = ("--target", "36097", "--tle", _ELEMENTS, "--at", _AT, "--site", _SITE)
        words += ("--frames", str(WITHIN))
    elif number % 4 == 0:
        glow, columns = rng.uniform(20.0, 100.0), rng.uniform(0.3, 1.5)
        world = _FIXED.format(glow=round(glow, 1), columns=round(columns, 2))
    elif number % 4 > 1:
        words += ("--world", "random")
    case = Case(group=name, name=str(number), words=(*words, "--seed", str(seed)), world=world)
    night = runner.run(case)
    locked = night.get("locked_after_frames")
    return {
        "number": number,
        "snr": round(snr, 2),
        "error": night.get("error", ""),
        "locked_after_frames": locked,
        "false": night.get("false_measurements", 0) if name in SNR else int(locked is not None),
    }


def line_of(name: str, rows: list[dict[str, Any]]) -> str:
    """One line of the table."""
    ran = [row for row in rows if not row["error"]]
    locked = sum(row["locked_after_frames"] is not None for row in ran)
    low, high = share_interval(locked, len(ran))
    false = sum(row["false"] for row in ran)
    nights = "no satellite, 40 frames" if name == "empty" else "SNR {:g} to {:g}".format(*SNR[name])
    share = f"{locked} of {len(ran)}" + ("" if name == "empty" else f" ({low:.2f}-{high:.2f})")
    most = f" (at most {rate_interval(false, len(ran))[1]:.2f} a night)"
    return f"| {nights} | {share} | {false}{most} |\n"


def main(words: list[str] | None = None) -> int:
    """Run the nights that are asked for."""
    parser = parser_of("limit_nights", __doc__, 30)
    parser.add_argument("names", nargs="+", choices=[*NIGHTS, "all"], metavar="NIGHTS")
    chosen = parser.parse_args(words)
    for name in NIGHTS if "all" in chosen.names else chosen.names:
        path = chosen.folder / f"{name}.jsonl"
        complete(path, partial(row_of, name), chosen.count, chosen.jobs)
    text = "| a frame | a track within eight frames | false |\n|---|---|---|\n" + "".join(
        line_of(name, rows)
        for name in NIGHTS
        if (rows := read(Path(chosen.folder, f"{name}.jsonl")))
    )
    print(text)
    if chosen.write:
        keep(chosen.folder, "limit_nights")
        put_into_page("limit_nights", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
