"""The last measurements that the track took."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rsoconsole.night.frame import FrameRow, NightFrame
from rsoconsole.sky import largest_sigma

LOOKED_AT = 8
"""The last frames, of which this is told."""


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
    frames: Iterable[NightFrame], rows: Mapping[int, FrameRow]
) -> tuple[LastMeasured, ...]:
    """Newest first, of the last eight frames."""
    found: list[LastMeasured] = []
    for frame in [*frames][-LOOKED_AT:]:
        taken, row = frame.followed, rows.get(frame.frame_id)
        if taken is None or row is None or not row.is_followed:
            continue
        found.append(
            LastMeasured(
                frame_id=frame.frame_id,
                t_utc_ns=taken.t_mid_utc_ns,
                source=taken.source,
                sigma_arcsec=largest_sigma(*taken.cov_sky_arcsec2),
                nis=row.nis,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.frame_id))
