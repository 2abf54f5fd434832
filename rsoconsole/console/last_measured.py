"""The last measurements that the track took, as one may speak of them."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsoconsole.console.night import FrameDetail, FrameRow

MOST = 9
SOURCES = {"network": "detector", "operator": "by hand"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LastMeasured:
    """What the track took of one of the last frames."""

    frame_id: int
    t_utc_ns: int
    source: str
    sigma_arcsec: float
    """One sigma where it is known worst."""
    nis: float | None


def last_measured(
    details: Iterable[tuple[int, "FrameDetail"]], rows: Mapping[int, "FrameRow"]
) -> tuple[LastMeasured, ...]:
    """Newest first, at most nine."""
    found: list[LastMeasured] = []
    for frame_id, detail in details:
        taken, row = detail.followed, rows.get(frame_id)
        if taken is None or row is None or not row.is_followed:
            continue
        east, both, north = taken.cov_sky_arcsec2
        worst = 0.5 * (east + north) + math.hypot(0.5 * (east - north), both)
        found.append(
            LastMeasured(
                frame_id=frame_id,
                t_utc_ns=taken.t_mid_utc_ns,
                source=taken.source,
                sigma_arcsec=math.sqrt(max(worst, 0.0)),
                nis=row.nis,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.frame_id)[:MOST])


def measured_words(each: LastMeasured) -> str:
    """Frame, time, source, sigma, NIS."""
    seconds = each.t_utc_ns // 1_000_000_000 % 86_400
    time = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}Z"
    sigma = f"±{each.sigma_arcsec:.{0 if each.sigma_arcsec >= 10 else 2}f}″"
    nis = "" if each.nis is None else f"NIS {each.nis:.1f}"
    source = SOURCES.get(each.source, each.source)
    return f"frame {each.frame_id:04d}  {time}  {source:<8}  {sigma:>7}  {nis}".rstrip()
