"""How many satellites of SatSim's sequences are confirmed as points among trails, and how well.

    python -m tests.campaign.points all
    python -m tests.campaign.points dense --angle 37

Each sequence is five frames of one telescope at rest, with 48 geostationary satellites. Stars that
the files have as points are drawn out to trails first (``drawn/drawn_out.py``); the table says so.
Half a minute a sequence on one core. ``--write`` puts the table into README.md.
"""

import argparse
import json
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsoconsole.instruments import read_frame
from rsoconsole.pipeline.points.confirm import PointTrack, confirm_points
from rsoconsole.pipeline.points.frame_points import FramePoints
from rsoconsole.records import Frame, PixelArray
from rsoconsole.vision import find_stars, local_background
from rsoconsole.vision.points.points import find_points
from tests.campaign.rows_kept import put_into_page
from tests.drawn.drawn_out import drawn_out_stars

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "rate"
SEQUENCES = ("seq", "sparse", "dense")
FRAMES = 5
TRAIL_PX = 119.2
"""Motion of the sky during an exposure of the files, px."""
BANDS = ((6.0, 10.0), (10.0, 20.0), (20.0, 60.0), (60.0, 2000.0))
_NEAR_PX = 1.5


@dataclass(frozen=True, kw_only=True)
class TrueObject:
    """A satellite of the files."""

    x_px: float
    y_px: float
    snr: float
    """Matched SNR."""
    flux_adu: float


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A sequence, and what was confirmed in it."""

    objects: list[TrueObject]
    tracks: list[PointTrack]
    """Confirmed ones."""
    false: list[PointTrack]
    off_px: list[float | None]
    """Distance of each object's track from the truth; None where it has none."""
    flux_share: list[float | None]
    """Measured light over the true one."""
    candidates: float
    """Number of points in a frame, the mean."""
    seconds: float
    """Processor time of the search for points in a frame, the median."""
    is_drawn_out: bool
    """Whether the stars were points in the files."""

    def share(self, band: tuple[float, float]) -> tuple[int, int]:
        """Number of objects of a band that are confirmed, and of all."""
        own = [
            off for each, off in zip(self.objects, self.off_px, strict=True) if _is_in(each, band)
        ]
        return sum(off is not None for off in own), len(own)

    def median_off_px(self, band: tuple[float, float]) -> float:
        """Median distance from the truth; NaN without any."""
        pairs = zip(self.objects, self.off_px, strict=True)
        own = [off for each, off in pairs if off is not None and _is_in(each, band)]
        return statistics.median(own) if own else float("nan")

    def flux(self, band: tuple[float, float]) -> tuple[float, float]:
        """Median of measured over true light, and its scatter."""
        pairs = zip(self.objects, self.flux_share, strict=True)
        own = np.array([share for each, share in pairs if share is not None and _is_in(each, band)])
        if not own.size:
            return float("nan"), float("nan")
        middle = float(np.median(own))
        return middle, 1.4826 * float(np.median(np.abs(own - middle)))


def _is_in(each: TrueObject, band: tuple[float, float]) -> bool:
    return band[0] <= each.snr < band[1]


def frames_of(name: str) -> tuple[list[Frame], list[TrueObject]]:
    """The five frames of a sequence as they are on disk, and their satellites."""
    frames = [read_frame(DATA / f"{name}_{k}.fits.bz2", k + 1) for k in range(FRAMES)]
    truth = json.loads((DATA / f"{name}_0.json").read_text(encoding="utf-8"))["objs"]
    to_adu = (frames[0].exposure_s or 0.0) / float(frames[0].header["EGAIN"])
    objects = [
        TrueObject(x_px=o["x"], y_px=o["y"], snr=o["snr"], flux_adu=o["pe"] * to_adu) for o in truth
    ]
    return frames, objects


def judged(name: str, angle_deg: float = 0.0, seed: int = 1) -> Judged:
    """Search a sequence and compare it with the truth."""
    frames, objects = frames_of(name)
    pixels = [each.pixels for each in frames]
    are_points = find_stars(pixels[0], saturation_adu=frames[0].saturation_adu).trail is None
    if are_points:
        pixels = drawn_out_stars(
            pixels,
            [(each.x_px, each.y_px, each.snr) for each in objects],
            e_per_adu=float(frames[0].header["EGAIN"]),
            length_px=TRAIL_PX,
            angle_deg=angle_deg,
            seed=seed,
        )
    seconds: list[float] = []
    found = [_found(*each, seconds) for each in zip(frames, pixels, strict=True)]
    tracks = [
        each
        for each in confirm_points(found, frames[0].exposure_s or 0.0)
        if each.state == "confirmed"
    ]
    away = np.hypot(
        np.subtract.outer([each.x_px for each in objects], [each.x_px for each in tracks]),
        np.subtract.outer([each.y_px for each in objects], [each.y_px for each in tracks]),
    )
    own = [int(row.argmin()) if row.min() < _NEAR_PX else None for row in away]
    return Judged(
        objects=objects,
        tracks=tracks,
        false=[each for each, off in zip(tracks, away.min(axis=0), strict=True) if off > _NEAR_PX],
        off_px=[None if n is None else float(row[n]) for row, n in zip(away, own, strict=True)],
        flux_share=[
            None if n is None else tracks[n].flux_adu / each.flux_adu
            for each, n in zip(objects, own, strict=True)
        ],
        candidates=statistics.mean(len(each.points) for each in found),
        seconds=statistics.median(seconds),
        is_drawn_out=are_points,
    )


def _found(frame: Frame, pixels: PixelArray, seconds: list[float]) -> FramePoints:
    sky = local_background(pixels)
    stars = find_stars(pixels, sky, saturation_adu=frame.saturation_adu)
    began = time.process_time()
    points = find_points(pixels, sky, stars, saturation_adu=frame.saturation_adu)
    seconds.append(time.process_time() - began)
    if points is None or frame.t_mid_utc_ns is None:
        raise SystemExit(f"{frame.name}: its stars are no trails")
    return FramePoints.by_pixels(points, frame.t_mid_utc_ns, (frame.width_px, frame.height_px))


def table(found: dict[str, Judged]) -> str:
    """A line for each band of SNR of each sequence."""
    text = (
        "| sequence | SNR | confirmed | place, median px | light over true, scatter | false tracks "
        "| candidates a frame | s a frame |\n|---|---|---|---|---|---|---|---|\n"
    )
    for name, each in found.items():
        title = f"{name}, stars drawn out here" if each.is_drawn_out else name
        for band in BANDS:
            confirmed, count = each.share(band)
            light, scatter = each.flux(band)
            cells = (
                title,
                f"{band[0]:g} to {band[1]:g}",
                f"{confirmed} of {count}",
                f"{each.median_off_px(band):.3f}",
                f"{light:.3f}, {scatter:.3f}",
                str(len(each.false)),
                f"{each.candidates:.0f}",
                f"{each.seconds:.2f}",
            )
            text += "| " + " | ".join(cells) + " |\n"
    return text


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("points", description=__doc__)
    parser.add_argument("sequences", nargs="+", choices=[*SEQUENCES, "all"])
    parser.add_argument("--angle", type=float, default=0.0, help="direction of the trails, deg")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the table into README.md")
    chosen = parser.parse_args()
    names = SEQUENCES if "all" in chosen.sequences else tuple(chosen.sequences)
    text = table({name: judged(name, chosen.angle, chosen.seed) for name in names})
    print(text, end="")
    if chosen.write:
        put_into_page("points", text)


if __name__ == "__main__":
    main()
