"""The product's own tracker on the nights of ``slots``, with its everyday settings."""

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import follow_settings
from rsoconsole.records import FrameTaken, Missed
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from rsoconsole.tracking.filters import lqe
from tests.campaign.slots import EXPOSURE_S, SITE, Night
from tests.campaign.slots_judge import At

SHARP_ARCSEC = 0.5
"""Width of a star: in these nights every two streaks are shown apart."""


def settings() -> FollowSettings:
    """Of a telescope as the paper's at the site of the nights."""
    site = {
        "latitude_deg": SITE.latitude_deg,
        "longitude_deg": SITE.longitude_deg,
        "elevation_m": SITE.elevation_m,
    }
    frame = FrameTaken(
        frame_id=0,
        name="",
        t_start_utc_ns=0,
        exposure_s=EXPOSURE_S,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    return follow_settings(Config.model_validate({"site": site}), frame)


def followed(night: Night) -> list[list[At]]:
    """The tracks after each frame, without those that are on trial."""
    following, every_day, told = Following(), settings(), []
    for number, sight in enumerate(night.frames, 1):
        seen = FrameInput(
            frame_id=number,
            t_mid_utc_ns=sight.t_utc_ns,
            exposure_s=EXPOSURE_S,
            measurements=tuple(sorted(sight.measurements, key=lambda m: -m.confidence)),
            absence=Missed(kind="no detection"),
            star_width_arcsec=SHARP_ARCSEC,
        )
        following, _ = follow(following, seen, every_day)
        tracks = []
        for each in following.tracks:
            if not each.track.is_lead and each.is_on_trial:
                continue
            ra, dec = lqe.direction_icrs_deg(each.track)
            east, north = night.project_arcsec(ra, dec, sight.t_utc_ns).tolist()
            # A streak that it shares says nothing of whose it is.
            is_own = each.track.shared_with is None
            taken = each.taken if is_own and each.taken and each.taken.frame_id == number else None
            tracks.append(
                At(
                    track_id=each.track.track_id,
                    place=(east, north),
                    taken=None if taken is None else taken.measurement_id,
                )
            )
        told.append(tracks)
    return told
