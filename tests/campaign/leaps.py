"""Low satellites followed by leaps, night after night in the demo: found, followed, seen again.

    python -m tests.campaign.leaps --folder ~/leaps
    python -m tests.campaign.leaps --folder ~/leaps --nights 3
    python -m tests.campaign.leaps --folder ~/leaps --table

Without elements: the telescope stares within 0.3 deg of where the satellite comes by 20 s later,
and knows nothing else. Passes are of real element sets, lit and in darkness; the truth is SGP4. A
night takes two to four minutes of a core; stop it when you like, the same command goes on. It needs
the whole sky's stars ('rsoconsole index install', or ``tests/fetch_debian_index.sh``).
"""

import argparse
import json
import re
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.orbit.satellite import Satellite
from rsoconsole.records import Event, Site
from rsoconsole.session.reader import SessionReader
from rsoconsole.sky.frames import icrs_to_altaz
from rsoconsole.sky.times import NS_PER_S, iso_to_utc_ns
from tests.campaign import runner
from tests.campaign.cases import ELEMENTS, Case
from tests.regimes import samples

FILE = ELEMENTS / "mix_20230622.tle"
FRAMES = 75
LEAST_ALTITUDE_DEG = 15.0
FAST_ARCSEC_S = 0.6 * 3600.0


@dataclass(frozen=True)
class LeapNight:
    """One pass: who, when it may first be looked at, from where."""

    norad_id: int
    at: str
    site: str

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.norad_id}-{self.at[5:16].replace(':', '')}"

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
    LeapNight(22220, "2023-06-22T22:54:00Z", _NORTH),
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
    LeapNight(38341, "2023-06-24T21:44:30Z", _NORTH),
    LeapNight(26375, "2023-06-23T23:55:30Z", _NORTH),
    LeapNight(22220, "2023-06-23T00:38:30Z", _NORTH),
    LeapNight(18945, "2023-06-24T20:06:30Z", _MIDDLE),
    LeapNight(8294, "2023-06-23T20:13:00Z", _MIDDLE),
    LeapNight(47592, "2023-06-22T02:40:00Z", _MIDDLE),
    LeapNight(53826, "2023-06-23T20:00:00Z", _MIDDLE),
    LeapNight(4420, "2023-06-23T03:44:00Z", _SOUTH),
    LeapNight(47592, "2023-06-24T04:24:00Z", _SOUTH),
    LeapNight(26375, "2023-06-24T01:44:00Z", _MIDDLE),
    LeapNight(44531, "2023-06-23T20:57:30Z", _MIDDLE),
    LeapNight(55345, "2023-06-23T01:59:00Z", _MIDDLE),
    LeapNight(46039, "2023-06-24T01:33:30Z", _NORTH),
)


def judged(night: LeapNight, session: Path) -> dict[str, Any]:
    """What came of one night, by its log and by SGP4."""
    events: list[tuple[int, str]] = []
    for _, t_utc_ns, record in SessionReader(session).records():
        if isinstance(record, Event):
            events.append((t_utc_ns, record.text))
    said = [text for _, text in events]
    entry = next(e.entry for e in samples("low orbit", 20) if e.entry.norad_id == night.norad_id)
    truth, site = Satellite(entry), night.to_site()
    begun = [n for n, text in enumerate(said) if text.startswith("a low satellite,")]
    planned = [int(text.split()[2]) for text in said if text.startswith("up to ")]
    met = [t for t, text in events if text.startswith("leap ") and " met:" in text]
    ends = ("it sets", "it has gone into", "altitude", "horizon", "given up", "too ", "hour angle")
    end = next((text for text in said if text.startswith(ends) and " streaks in " in text), "")
    found: dict[str, Any] = {
        "norad": night.norad_id,
        "found": bool(begun),
        "planned": max(planned, default=0),
        "met": len(met),
        "end": end.split(":")[0],
        "took": end.partition("a leap took ")[2],
    }
    found |= _at_the_end(truth, site, met)
    found |= _across(said)
    return found | _next_pass(truth, site, said)


def _at_the_end(truth: Satellite, site: Site, met: list[int]) -> dict[str, Any]:
    """How long it could still be seen after the last leap, and how fast it was."""
    if not met:
        return {}
    t = met[-1] + np.arange(0, 900, 5) * NS_PER_S
    places = truth.astrometric_place(site, t)
    altitude, _ = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t)
    is_seen = (altitude > LEAST_ALTITUDE_DEG) & np.isfinite(truth.magnitude(places))
    left = int(np.argmin(is_seen)) if not np.all(is_seen) else len(t)
    before = truth.astrometric_place(site, np.array(met))
    east = before.ra_rate_deg_s * np.cos(np.radians(before.dec_icrs_deg))
    fastest = 3600.0 * float(np.max(np.hypot(east, before.dec_rate_deg_s)))
    return {"left_s": 5.0 * left, "fastest_arcsec_s": round(fastest)}


def _across(said: list[str]) -> dict[str, Any]:
    rms = [re.search(r"across ([\d.]+) arcsec rms", text) for text in said]
    known = [float(each.group(1)) for each in rms if each is not None]
    return {"across_rms_arcsec": known[-1] if known else None}


def _next_pass(truth: Satellite, site: Site, said: list[str]) -> dict[str, Any]:
    """Predicted rise against that of SGP4."""
    line = next((text for text in said if text.startswith("its next pass: ")), None)
    if line is None:
        return {}
    predicted = iso_to_utc_ns(line.split()[3])
    sigma_s = float(line.split("+- ")[1].split()[0])
    reach_s = max(60.0, 6.0 * sigma_s)
    t = predicted + (np.arange(-reach_s, reach_s, 0.5) * NS_PER_S).astype(np.int64)
    places = truth.astrometric_place(site, t)
    altitude, _ = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t)
    up = np.flatnonzero((altitude[1:] > LEAST_ALTITUDE_DEG) & (altitude[:-1] <= LEAST_ALTITUDE_DEG))
    if not len(up):
        return {"next_sigma_s": sigma_s, "next_late_s": None}
    rises_s = (t[up + 1] - predicted) / NS_PER_S
    late_s = float(rises_s[np.argmin(np.abs(rises_s))])
    return {"next_sigma_s": sigma_s, "next_late_s": late_s}


def is_followed(found: dict[str, Any]) -> bool:
    """To where it sets, to its shadow or to a limit of the mount, and 7 of 10 leaps."""
    is_over = found.get("left_s", 1e9) <= 35.0 or found["end"] != "given up"
    return bool(is_over and found["met"] >= 0.7 * found["planned"])


def table(answers: dict[str, dict[str, Any]]) -> str:
    """A line for each night, and the shares."""
    lines = [
        "| night | leaps met / planned | ended | seen on, s | across | next pass off / sigma, s |"
    ]
    lines.append("|---|---|---|---|---|---|")
    for name, each in answers.items():
        late = each.get("next_late_s")
        after = "-" if late is None else f"{late:+.1f} / {each['next_sigma_s']:.1f}"
        fast = " (fast)" if each.get("fastest_arcsec_s", 0) > FAST_ARCSEC_S else ""
        lines.append(
            f"| {name}{fast} | {each['met']} / {each['planned']} | {each['end']} |"
            f" {each.get('left_s', float('nan')):.0f} | {each['across_rms_arcsec']} | {after} |"
        )
    every = list(answers.values())
    found = [each for each in every if each["found"]]
    followed = [each for each in found if is_followed(each)]
    again = [each for each in found if each.get("next_late_s") is not None]
    # The rise is stated to the second, and to half a second by its search.
    held = [e for e in again if abs(e["next_late_s"]) <= 3.0 * e["next_sigma_s"] + 1.0]
    across = [e["across_rms_arcsec"] for e in found if e["across_rms_arcsec"] is not None]
    lines.append("")
    lines.append(
        f"found {len(found)} of {len(every)}, followed to the end {len(followed)} of {len(found)},"
        f" next pass within 3 sigma {len(held)} of {len(again)},"
        f" across {statistics.median(across) if across else float('nan')} arcsec (median)"
    )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Exit status 0 when every night came to its end."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True, help="where answers are kept")
    parser.add_argument("--nights", type=int, default=len(NIGHTS), help="only the first so many")
    parser.add_argument("--table", action="store_true", help="what is known by now, no more nights")
    asked = parser.parse_args()
    answers, is_well = {}, True
    for night in NIGHTS[: asked.nights]:
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
