"""Nights of measurements made from an orbit, folded by the program's own fold, and recorded.

The orbit is SGP4's and the way to the sky the project's; only camera, detector and solver are left
out, so that the noise of every measurement is known.
"""

from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import Config
from rsoconsole.pipeline import FrameObservations, StarHistory, fold_frame
from rsoconsole.records import CycleTiming, Detections, FrameTaken, Measurement, Solution
from rsoconsole.session import SessionWriter
from rsoconsole.sky import tan_wcs, times
from rsoconsole.tracking import Following
from tests.makers import straight_detection
from tests.orbits.test_lqe_satellites import DAYTONA, geo

NS = times.NS_PER_S
SIZE = (4656, 3520)
HALF_STREAK_DEG = 15.04 * 5.0 / 3600.0


def record_night(
    folder: Path,
    *,
    frames: int,
    seed: int,
    sigma_arcsec: float = 0.4,
    claimed_arcsec: float | None = None,
    inclination_deg: float = 2.0,
    missed: frozenset[int] = frozenset(),
    settings: dict[str, Any] | None = None,
) -> Path:
    """A session of a geostationary satellite, a frame each 30 s; returns its folder.

    ``sigma_arcsec``: the true noise of either axis; ``claimed_arcsec``: what the measurements
    say of it (the same unless given); ``settings``: those of the filter, of preset tuned unless
    they name another.
    """
    config = Config.model_validate({"filter": {"preset": "tuned", **(settings or {})}})
    t_ns = geo(inclination_deg, 0.0).element_set.epoch_utc_ns + np.arange(frames) * 30 * NS
    places = geo(inclination_deg, 40.0 * seed).astrometric_place(DAYTONA, t_ns)
    noise = np.random.default_rng(seed).normal(0.0, sigma_arcsec / 3600.0, (frames, 2))
    writer = SessionWriter.create(folder, config, {"title": "measured", "is_simulated": True})
    following, stars = Following(), StarHistory()
    for k in range(frames):
        cos_dec = np.cos(np.radians(places.dec_icrs_deg[k]))
        ra = float(places.ra_icrs_deg[k] + noise[k, 0] / cos_dec) % 360.0
        dec = float(places.dec_icrs_deg[k] + noise[k, 1])
        is_seen = k + 1 not in missed
        shown = _shown(k + 1, int(t_ns[k]), (ra, dec), claimed_arcsec or sigma_arcsec, is_seen)
        folded = fold_frame(following, stars, shown, config)
        following, stars = folded.following, folded.stars
        timing = CycleTiming(frame_id=k + 1, stage_ms={"total": 1.0})
        for record in (
            *(shown.taken, shown.detections, shown.solution, *shown.measurements),
            *(*folded.records, timing),
        ):
            writer.append(record, int(t_ns[k]) + 6 * NS)
    writer.close()
    assert not writer.faults
    return folder


def _shown(
    frame_id: int, t_ns: int, at_deg: tuple[float, float], claimed_arcsec: float, is_seen: bool
) -> FrameObservations:
    (ra, dec), (width, height) = at_deg, SIZE
    detection = straight_detection(frame_id=frame_id)
    return FrameObservations(
        taken=FrameTaken(
            frame_id=frame_id,
            name=f"{frame_id:06d}.fits",
            t_start_utc_ns=t_ns - 5 * NS,
            exposure_s=10.0,
            width_px=width,
            height_px=height,
            pointing_ra_icrs_deg=ra,
            pointing_dec_icrs_deg=dec,
        ),
        detections=Detections(
            frame_id=frame_id,
            width_px=width,
            height_px=height,
            detections=(detection,) if is_seen else (),
            star_count=300,
            star_flux_adu=1000.0,
        ),
        solution=Solution(
            frame_id=frame_id,
            wcs=tan_wcs(
                ra,
                dec,
                scale_arcsec_px=1.264,
                rotation_deg=0.0,
                is_flipped=False,
                width_px=width,
                height_px=height,
            ),
            ra_icrs_deg=ra,
            dec_icrs_deg=dec,
            scale_arcsec_px=1.264,
            rotation_deg=0.0,
            is_flipped=False,
            matched=100,
            rms_arcsec=0.3,
            path="refit",
            ms=3.0,
        ),
        measurements=(
            Measurement(
                measurement_id=f"{frame_id}-0",
                frame_id=frame_id,
                t_mid_utc_ns=t_ns,
                ra_icrs_deg=ra,
                dec_icrs_deg=dec,
                cov_sky_arcsec2=(claimed_arcsec**2, 0.0, claimed_arcsec**2),
                x_px=detection.x_px,
                y_px=detection.y_px,
                confidence=detection.confidence,
                source="network",
                ends_icrs_deg=((ra - HALF_STREAK_DEG, dec), (ra + HALF_STREAK_DEG, dec)),
            ),
        )
        if is_seen
        else (),
    )
