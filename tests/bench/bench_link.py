"""How right links and joins are, and whether they are as sure as they claim.

Run: ``python -m tests.bench.bench_link``. Points: real sequences of spotGEO with 0.5 px of noise,
a tenth of them gone and two false ones a frame. Nights: pairs of neighbours on the belt, 1e-5 to
2e-4 apart in every element, seen for 5 to 20 minutes on two nights.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rsoconsole.orbits import TrackletOrbit, probability_from_log_odds, tracklet_orbit
from rsoconsole.orbits.determination.join import log_odds_same_object
from rsoconsole.tracking import link_points
from tests.tracking.test_link import FRAMES, KNOWN, annotated, spoilt, true_links
from tests.truth.seen_satellites import geostationary, instants, seen

_BINS = (0.0, 0.01, 0.1, 0.3, 0.7, 0.9, 0.99, 1.01)


def calibration(claims: Sequence[tuple[float, bool]]) -> None:
    """Stated against true shares."""
    stated, right = np.array(claims, float).T
    for low, high in pairwise(_BINS):
        chosen = (stated >= low) & (stated < high)
        if np.any(chosen):
            words = f"stated {stated[chosen].mean():.3f}, true {right[chosen].mean():.3f}"
            print(f"  {low:.2f} to {min(high, 1.0):.2f}: {int(chosen.sum()):5d}  {words}")


def points(seed: int) -> None:
    """All sequences once."""
    random = np.random.default_rng(seed)
    right = wrong = missed = 0
    claims = []
    for sequence in annotated():
        spoilt_points, owners = spoilt(sequence, random)
        found = link_points(range(FRAMES), spoilt_points, KNOWN)
        links = {link for t in found if t.probability >= 0.5 for link in pairwise(t.points)}
        truth = true_links(owners)
        right, wrong = right + len(links & truth), wrong + len(links - truth)
        missed += len(truth - links)
        for each in found:
            whose = {int(owners[frame][place]) for frame, place in each.points}
            claims.append((each.probability, len(whose) == 1 and -1 not in whose))
    f1 = 2 * right / (2 * right + wrong + missed)
    print(f"seed {seed}: F1 {f1:.4f} ({right} right, {wrong} wrong, {missed} missed links)")
    calibration(claims)


def nights(count: int, seed: int) -> None:
    """Pairs of neighbours."""
    random = np.random.default_rng(seed)
    claims = []
    for _ in range(count):
        apart = 10.0 ** random.uniform(-5.0, -3.7)
        longitude, e, i_deg = random.uniform(-110, -50), random.uniform(1e-4, 4e-4), 0.05
        perigee, node = random.uniform(0.0, 360.0, 2)
        pair = (
            geostationary(90001, longitude, e=e, perigee_deg=perigee, i_deg=i_deg, node_deg=node),
            geostationary(
                90002,
                longitude + float(np.degrees(random.normal(0.0, apart))),
                e=abs(e + random.normal(0.0, apart)),
                perigee_deg=perigee + float(np.degrees(random.normal(0.0, apart / e))),
                i_deg=abs(i_deg + float(np.degrees(random.normal(0.0, apart)))),
                node_deg=node + float(np.degrees(random.normal(0.0, apart / np.radians(i_deg)))),
            ),
        )
        frames, sigma = int(random.choice([10, 20, 40])), float(random.choice([0.5, 1.0, 2.0]))
        both: list[list[TrackletOrbit]] = []
        for since_s in (0.0, 86_400.0 + random.uniform(-3600.0, 3600.0)):
            t = instants(since_s, frames)
            found = [
                tracklet_orbit(seen(x, t, sigma_arcsec=sigma, random=random), "geo") for x in pair
            ]
            both.append([each for each in found if each is not None])
        claims += [
            (probability_from_log_odds(log_odds_same_object(one, other)), m == n)
            for m, one in enumerate(both[0])
            for n, other in enumerate(both[1])
        ]
    print(f"{count} pairs of neighbours on two nights")
    calibration(claims)


if __name__ == "__main__":
    points(1)
    points(2)
    nights(100, 3)
