"""The live tracker on real sequences of spotGEO: which of its links are right after frame 5.

    python -m tests.campaign.spotgeo --seeds 1-3 --write
    python -m tests.campaign.spotgeo --seeds 1 --count 80

The file has where annotators saw satellites in 639 sequences of five frames, and nothing else: a
tracker gets points without a direction. Each has 0.5 px of noise, a tenth of them are gone, two
false ones a frame are put beside them (``tests/tracking/test_link.py``); the order within a frame
is drawn. The frames go through the fold that the engine uses, one after the other. A link is a
point and the next one of the same track; after frame 5, the last, the tracker's are held against
the truth. Pixels are laid onto a plane of the sky at spotGEO's 4.5 arcsec a pixel, ten seconds from
frame to frame: the satellites then move at the rate of real ones. The same command goes on where it
was stopped.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import follow_settings
from rsoconsole.records import FloatArray, FrameTaken, Measurement, TrackState
from rsoconsole.tracking import Following, FollowSettings, FrameInput, TangentPlane, follow
from tests.campaign.arguments import seeds_of
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read
from tests.makers import NS, T0_UTC_NS
from tests.tracking.test_link import HEIGHT_PX, WIDTH_PX, Point, annotated, spoilt, true_links

NAME = "spotgeo"
SCALE_ARCSEC_PX, CADENCE_S, EXPOSURE_S = 4.5, 10.0, 0.75
"""In so short an exposure none of them draws a streak of 20 arcsec."""
SIGMA_PX = 0.55
"""0.5 px of noise, and annotations good to 0.2 px."""
_PLANE = TangentPlane.at(150.0, 10.0)
_FOCUS_MM = 206.264806 * 3.8
_DRAWS = 2000


@cache
def settings() -> FollowSettings:
    """The everyday ones, of a camera with such pixels."""
    optics = {
        "focal_length_mm": _FOCUS_MM / SCALE_ARCSEC_PX,
        "width_px": int(WIDTH_PX),
        "height_px": int(HEIGHT_PX),
    }
    frame = FrameTaken(
        frame_id=0,
        name="",
        t_start_utc_ns=T0_UTC_NS,
        exposure_s=EXPOSURE_S,
        width_px=int(WIDTH_PX),
        height_px=int(HEIGHT_PX),
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    config = Config.model_validate({"optics": optics})
    return follow_settings(config, frame)


def measured(frame: int, number: int, point: FloatArray) -> Measurement:
    """A point of a frame, both from 0, as a direction."""
    east, north = (point - np.array([WIDTH_PX / 2.0, HEIGHT_PX / 2.0])) * SCALE_ARCSEC_PX
    ra, dec = _PLANE.direction_of(float(east), float(north))
    variance = (SIGMA_PX * SCALE_ARCSEC_PX) ** 2
    return Measurement(
        measurement_id=f"{frame + 1}-{number}",
        frame_id=frame + 1,
        t_mid_utc_ns=T0_UTC_NS + round(frame * CADENCE_S * NS),
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(variance, 0.0, variance),
        x_px=float(point[0]),
        y_px=float(point[1]),
        confidence=0.9,
        source="network",
        ends_icrs_deg=None,
    )


def linked(points: Sequence[FloatArray]) -> set[tuple[Point, Point]]:
    """What the tracks hold together, from the records of the fold."""
    following, chains = Following(), defaultdict[int, list[Point]](list)
    for frame, shown in enumerate(points):
        seen = FrameInput(
            frame_id=frame + 1,
            t_mid_utc_ns=T0_UTC_NS + round(frame * CADENCE_S * NS),
            exposure_s=EXPOSURE_S,
            measurements=tuple(measured(frame, n, each) for n, each in enumerate(shown)),
        )
        following, records = follow(following, seen, settings())
        for record in records:
            if isinstance(record, TrackState) and record.kind != "predicted":
                chains[record.track_id] += [_point(each) for each in _ids(record)]
    return {link for chain in chains.values() for link in pairwise(chain)}


def _ids(state: TrackState) -> tuple[str, ...]:
    """Of the measurements that a track has taken with this step."""
    if state.begun_with is not None:
        return (state.begun_with[0], *state.begun_through, state.begun_with[1])
    return () if state.measurement_id is None else (state.measurement_id,)


def _point(measurement_id: str) -> Point:
    frame, number = measurement_id.split("-")
    return int(frame) - 1, int(number)


def row_of(seed: int, number: int) -> dict[str, Any]:
    """One sequence, spoilt and followed."""
    points, owners = spoilt(annotated()[number], np.random.default_rng([seed, number]))
    found, true = linked(points), true_links(owners)
    return {
        "number": number,
        "seed": seed,
        "objects": len(annotated()[number][0]),
        "right": len(found & true),
        "wrong": len(found - true),
        "missed": len(true - found),
    }


def f1(rows: Sequence[dict[str, Any]]) -> tuple[float, float, float]:
    """F1 of the links with its 95 % interval, by resampling the sequences."""
    counts = np.array([[r["right"], r["wrong"] + r["missed"]] for r in rows], float)
    random = np.random.default_rng(20261125)
    chosen = random.integers(0, len(rows), (_DRAWS, len(rows)))
    right, off = np.moveaxis(counts[chosen].sum(axis=1), -1, 0)
    low, high = np.percentile(2.0 * right / (2.0 * right + off), [2.5, 97.5])
    whole = counts.sum(axis=0)
    return float(2.0 * whole[0] / (2.0 * whole[0] + whole[1])), float(low), float(high)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """By how many satellites a sequence has."""
    text = (
        "| satellites in the field | sequences | links | wrong | missed | F1, 95 % |\n"
        "|---|---|---|---|---|---|\n"
    )
    for title, least, most in (("1", 1, 1), ("2 to 3", 2, 3), ("4 or more", 4, 99), ("any", 1, 99)):
        some = [r for r in rows if least <= r["objects"] <= most]
        if some:
            value, low, high = f1(some)
            text += (
                f"| {title} | {len(some)} | {sum(r['right'] + r['missed'] for r in some)} "
                f"| {sum(r['wrong'] for r in some)} | {sum(r['missed'] for r in some)} "
                f"| {value:.4f} ({low:.4f} to {high:.4f}) |\n"
            )
    return text


def main() -> None:
    """Run what is missing, print the table."""
    parser = parser_of(NAME, __doc__, len(annotated()))
    parser.add_argument("--seeds", type=seeds_of, default=[1, 2, 3])
    chosen = parser.parse_args()
    for seed in chosen.seeds:
        path = chosen.folder / f"seed-{seed}.jsonl"
        complete(path, partial(row_of, seed), chosen.count, chosen.jobs)
    rows = [row for path in sorted(chosen.folder.glob("*.jsonl")) for row in read(path)]
    text = table(rows)
    print(text, end="")
    if chosen.write:
        keep(chosen.folder, NAME)
        put_into_page(NAME, text)


if __name__ == "__main__":
    main()
