"""The last measurements that the track took."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rsoconsole.night.frame_rows import FrameDetail, FrameRow
from rsoconsole.sky import largest_sigma

MOST = 9


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
    details: Iterable[tuple[int, FrameDetail]], rows: Mapping[int, FrameRow]
) -> tuple[LastMeasured, ...]:
    """Newest first, at most nine."""
    found: list[LastMeasured] = []
    for frame_id, detail in details:
        taken, row = detail.followed, rows.get(frame_id)
        if taken is None or row is None or not row.is_followed:
            continue
        found.append(
            LastMeasured(
                frame_id=frame_id,
                t_utc_ns=taken.t_mid_utc_ns,
                source=taken.source,
                sigma_arcsec=largest_sigma(*taken.cov_sky_arcsec2),
                nis=row.nis,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.frame_id)[:MOST])
