"""Low satellites followed by leaps, night after night in the demo: found, followed, seen again.

    python -m tests.campaign.leaps --folder ~/leaps
    python -m tests.campaign.leaps --folder ~/leaps --nights 3
    python -m tests.campaign.leaps --folder ~/leaps --worlds 10
    python -m tests.campaign.leaps --folder ~/leaps --late 10
    python -m tests.campaign.leaps --folder ~/leaps --table

``--worlds``: the first so many, each in a random world of its own instead of the demo's.
``--late``: the first so many, waited for by elements that are up to 20 s wrong (`late_pass`).
Without elements: the telescope stares within 0.3 deg of where the satellite comes by 20 s later,
and knows nothing else. Passes are of real element sets, lit and in darkness; the truth is SGP4. A
night takes one to nine minutes of a core; stop it when you like, the same command goes on. It needs
the whole sky's stars ('rsoconsole index install', or ``tests/fetch_debian_index.sh``).
"""

import argparse
import json
import sqlite3
import statistics
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.orbits import Satellite
from rsoconsole.records import LeapDone, LowPass, Site
from rsoconsole.session import SessionReader
from rsoconsole.simulator import random_world, world_to_toml
from rsoconsole.sky import icrs_to_altaz
from rsoconsole.words import NS_PER_S
from tests.campaign import runner
from tests.campaign.cases import ELEMENTS, Case
from tests.truth.regimes import samples

FILE = ELEMENTS / "mix_20230622.tle"
FRAMES = 260
MIN_ALTITUDE_DEG = 15.0
FAST_ARCSEC_S = 0.6 * 3600.0
FIRST_WORLD = 4001
MAX_LATE_S, LATE_SEED = 20.0, 24
BEGUN_AGAIN = "its next streak says otherwise"
"""How a pass ends whose first streak was a part: the next one is of the same satellite."""
_RAN_OUT = ("the run is over", "the night is over")
PARTS = ("total", "slew", "settle", "shutter", "open", "readout", "wait")


@dataclass(frozen=True)
class LeapNight:
    """One pass: who, when it may first be looked at, from where."""

    norad_id: int
    at: str
    site: str
    world: int | None = None
    """Number of its random world; None: the demo's own."""
    late_s: float | None = None
    """It is waited for by elements, and comes so much later; None: whatever comes is caught."""

    @property
    def name(self) -> str:
        """Of its files."""
        world = "" if self.world is None else f"-world-{self.world}"
        late = "" if self.late_s is None else f"-late-{self.late_s:+.0f}"
        return f"{self.norad_id}-{self.at[5:16].replace(':', '')}{world}{late}"

    @property
    def case(self) -> Case:
        """As the campaign's runner wants it."""
        return Case(
            group="leaps",
            name=self.name,
            words=(
                *("--target", str(self.norad_id), "--tle", str(FILE), "--site", self.site),
                *("--at", self.at, "--frames", str(FRAMES)),
            ),
            late_s=self.late_s,
            is_over=_is_over,
            world="" if self.world is None else world_to_toml(random_world(self.world)),
        )

    def to_site(self) -> Site:
        """Where the telescope stands."""
        latitude, longitude, elevation = (float(each) for each in self.site.split(","))
        return Site(latitude_deg=latitude, longitude_deg=longitude, elevation_m=elevation)


_NORTH, _MIDDLE, _SOUTH = "45,8,200", "35,8,200", "-30,20,200"
NIGHTS = (
    LeapNight(47592, "2023-06-23T00:52:30Z", _NORTH),
    LeapNight(46039, "2023-06-22T01:46:00Z", _NORTH),
    LeapNight(11681, "2023-06-22T21:07:30Z", _NORTH),
    LeapNight(53826, "2023-06-22T20:06:00Z", _MIDDLE),
    LeapNight(38341, "2023-06-23T21:30:30Z", _NORTH),
    LeapNight(26375, "2023-06-22T01:46:30Z", _NORTH),
    LeapNight(22220, "2023-06-22T22:55:00Z", _NORTH),
    LeapNight(25544, "2023-06-23T02:53:00Z", _MIDDLE),
    LeapNight(18945, "2023-06-22T21:01:00Z", _NORTH),
    LeapNight(8294, "2023-06-22T20:21:00Z", _MIDDLE),
    LeapNight(44531, "2023-06-24T21:00:00Z", _NORTH),
    LeapNight(56097, "2023-06-23T20:28:30Z", _MIDDLE),
    LeapNight(55345, "2023-06-24T01:56:00Z", _MIDDLE),
    LeapNight(4420, "2023-06-22T03:54:30Z", _SOUTH),
    LeapNight(47592, "2023-06-24T00:46:30Z", _NORTH),
    LeapNight(46039, "2023-06-23T01:39:30Z", _NORTH),
    LeapNight(11681, "2023-06-24T20:12:30Z", _MIDDLE),
    LeapNight(38341, "2023-06-24T21:45:20Z", _NORTH),
    LeapNight(26375, "2023-06-23T01:44:30Z", _NORTH),
    LeapNight(22220, "2023-06-23T00:38:30Z", _NORTH),
    LeapNight(18945, "2023-06-24T20:06:30Z", _MIDDLE),
    LeapNight(8294, "2023-06-23T20:13:00Z", _MIDDLE),
    LeapNight(47592, "2023-06-22T02:40:00Z", _MIDDLE),
    LeapNight(53826, "2023-06-23T20:00:00Z", _MIDDLE),
    LeapNight(4420, "2023-06-23T03:44:30Z", _SOUTH),
    LeapNight(47592, "2023-06-24T04:24:00Z", _SOUTH),
    LeapNight(26375, "2023-06-24T01:44:00Z", _MIDDLE),
    LeapNight(44531, "2023-06-23T20:57:30Z", _MIDDLE),
    LeapNight(55345, "2023-06-23T01:59:00Z", _MIDDLE),
    LeapNight(46039, "2023-06-24T01:33:30Z", _NORTH),
)


def _is_over(session: Path) -> bool:
    """Whether its pass is on record: what may come by afterwards is not asked."""
    log = session / "session.db"
    if not log.exists():
        return False
    with closing(sqlite3.connect(f"file:{log}?mode=ro", uri=True, timeout=30.0)) as database:
        try:
            ends = database.execute(
                "SELECT json_extract(body, '$.ended') FROM log WHERE kind = 'LowPass'"
            ).fetchall()
        except sqlite3.OperationalError:  # it has only just been made
            return False
    return any(end not in (BEGUN_AGAIN, *_RAN_OUT) for (end,) in ends)


def judged(night: LeapNight, session: Path) -> dict[str, Any]:
    """What came of one night, by its records and by SGP4."""
    leaps: list[LeapDone] = []
    passes: list[LowPass] = []
    for _, _, record in SessionReader(session).records():
        if isinstance(record, LeapDone):
            leaps.append(record)
        elif isinstance(record, LowPass):
            passes.append(record)
    entry = next(e.entry for e in samples("low orbit", 20) if e.entry.norad_id == night.norad_id)
    truth, site = Satellite(entry), night.to_site()
    # What was caught first is the one that the night was made for; others may follow it.
    first = next((each for each in passes if each.ended != BEGUN_AGAIN), None)
    begun = first.begun_frame_id if first is not None else leaps[0].begun_frame_id if leaps else 0
    own = [each for each in leaps if each.begun_frame_id == begun]
    met = [each.t_mid_utc_ns for each in own if each.result == "met"]
    found: dict[str, Any] = {
        "norad": night.norad_id,
        "found": bool(begun),
        "planned": 0 if first is None else first.planned_leaps,
        "leaps": len(own),
        "met": len(met),
        "at_close": sum(each.ordered == "at close" for each in own),
        "end": "the night is over" if first is None else first.ended,
        "took": _took(own),
        "across_rms_arcsec": None if first is None else first.across_rms_arcsec,
    }
    found |= _at_the_end(truth, site, met)
    if first is not None and found["took"] and "left_s" in found:
        seen_s = (met[-1] - first.t_first_utc_ns) / NS_PER_S
        # Behind a limit of the mount it allows none.
        seen_s += 0.0 if "limit" in first.ended else found["left_s"]
        found["allowed"] = max(int(seen_s / found["took"]["total"]), 1)
    return found | _next_pass(truth, site, first)


def _took(leaps: Sequence[LeapDone]) -> dict[str, float]:
    """Medians of a leap's parts, and of all beside slew and settling, in seconds."""
    if not leaps:
        return {}
    beside = [each.total_s - each.slew_s - each.settle_s for each in leaps]
    medians = {part: [getattr(each, f"{part}_s") for each in leaps] for part in PARTS}
    return {
        part: round(statistics.median(values), 2)
        for part, values in (medians | {"beside": beside}).items()
    }


def _at_the_end(truth: Satellite, site: Site, met: list[int]) -> dict[str, Any]:
    """How long it could still be seen after the last leap, and how fast it was."""
    if not met:
        return {}
    t = met[-1] + np.arange(0, 900, 5) * NS_PER_S
    places = truth.astrometric_place(site, t)
    altitude, _ = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t)
    is_seen = (altitude > MIN_ALTITUDE_DEG) & np.isfinite(truth.magnitude(places))
    left = int(np.argmin(is_seen)) if not np.all(is_seen) else len(t)
    before = truth.astrometric_place(site, np.array(met))
    east = before.ra_rate_deg_s * np.cos(np.radians(before.dec_icrs_deg))
    fastest = 3600.0 * float(np.max(np.hypot(east, before.dec_rate_deg_s)))
    return {"left_s": 5.0 * left, "fastest_arcsec_s": round(fastest)}


def _next_pass(truth: Satellite, site: Site, seen: LowPass | None) -> dict[str, Any]:
    """Predicted rise against that of SGP4."""
    if seen is None or seen.t_next_rise_utc_ns is None or seen.sigma_next_s is None:
        return {}
    predicted, sigma_s = seen.t_next_rise_utc_ns, seen.sigma_next_s
    reach_s = max(60.0, 6.0 * sigma_s)
    t = predicted + (np.arange(-reach_s, reach_s, 0.5) * NS_PER_S).astype(np.int64)
    places = truth.astrometric_place(site, t)
    altitude, _ = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t)
    up = np.flatnonzero((altitude[1:] > MIN_ALTITUDE_DEG) & (altitude[:-1] <= MIN_ALTITUDE_DEG))
    if not len(up):
        return {"next_sigma_s": round(sigma_s, 1), "next_late_s": None}
    rises_s = (t[up + 1] - predicted) / NS_PER_S
    late_s = float(rises_s[np.argmin(np.abs(rises_s))])
    return {"next_sigma_s": round(sigma_s, 1), "next_late_s": round(late_s, 1)}


def is_followed(found: dict[str, Any]) -> bool:
    """To where it sets, to its shadow or to a limit of the mount, and 7 of 10 leaps.

    Of as many as the mount's own pace allows from the first streak to where it can be seen last.
    What was planned before the first of them knows neither that pace nor the shadow.
    """
    is_over = found.get("left_s", 1e9) <= 35.0 or found["end"] not in ("given up", *_RAN_OUT)
    return bool(is_over and found["met"] >= 0.7 * found.get("allowed", 1e9))


def table(answers: dict[str, dict[str, Any]]) -> str:
    """A line for each night, and the shares."""
    lines = [
        "| night | leaps met / allowed | ended | seen on, s | across | next pass off / sigma, s |"
    ]
    lines.append("|---|---|---|---|---|---|")
    for name, each in answers.items():
        late = each.get("next_late_s")
        after = "-" if late is None else f"{late:+.1f} / {each['next_sigma_s']:.1f}"
        fast = " (fast)" if each.get("fastest_arcsec_s", 0) > FAST_ARCSEC_S else ""
        lines.append(
            f"| {name}{fast} | {each['met']} / {each.get('allowed', '-')} | {each['end']} |"
            f" {each.get('left_s', float('nan')):.0f} | {_one_digit(each['across_rms_arcsec'])} |"
            f" {after} |"
        )
    every = list(answers.values())
    found = [each for each in every if each["found"]]
    followed = [each for each in found if is_followed(each)]
    again = [each for each in found if each.get("next_late_s") is not None]
    # The rise is found to half a second by the search here.
    held = [e for e in again if abs(e["next_late_s"]) <= 3.0 * e["next_sigma_s"] + 1.0]
    across = [e["across_rms_arcsec"] for e in found if e["across_rms_arcsec"] is not None]
    lines.append("")
    lines.append(
        f"found {len(found)} of {len(every)}, followed to the end {len(followed)} of {len(found)},"
        f" next pass within 3 sigma {len(held)} of {len(again)},"
        f" across {statistics.median(across) if across else float('nan')} arcsec (median)"
    )
    return "\n".join(lines) + "\n"


def _one_digit(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def main() -> int:
    """Exit status 0 when every night came to its end."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True, help="where answers are kept")
    parser.add_argument("--nights", type=int, default=len(NIGHTS), help="only the first so many")
    parser.add_argument("--table", action="store_true", help="what is known by now, no more nights")
    parser.add_argument("--worlds", type=int, default=0, help="so many in random worlds instead")
    parser.add_argument("--late", type=int, default=0, help="so many by wrong elements instead")
    asked = parser.parse_args()
    answers, is_well = {}, True
    nights = NIGHTS[: asked.nights]
    if asked.worlds:
        numbered = enumerate(NIGHTS[: asked.worlds], FIRST_WORLD)
        nights = tuple(replace(night, world=number) for number, night in numbered)
    if asked.late:
        drawn = np.random.default_rng(LATE_SEED).uniform(-MAX_LATE_S, MAX_LATE_S, len(NIGHTS))
        late = zip(NIGHTS, drawn.tolist(), strict=True)
        nights = tuple(replace(night, late_s=each) for night, each in list(late)[: asked.late])
    for night in nights:
        path = asked.folder / f"{night.name}.json"
        if not path.exists() and not asked.table:
            done = runner.run(night.case, asked.folder)
            session = asked.folder / "leaps" / night.name
            if "error" in done:
                print(f"{night.name}: {done['error']}", file=sys.stderr, flush=True)
                is_well = False
                continue
            answer = judged(night, session) | {"wall_s": done["wall_s"]}
            path.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            print(night.name, json.dumps(answer), flush=True)
        if path.exists():
            answers[night.name] = json.loads(path.read_text(encoding="utf-8"))
    print(table(answers))
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
