"""Why a frame does not show what is followed: cloud, eclipse, a refused slew, told by name."""

import dataclasses

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline import Cycle, Reduction, StarHistory
from rsoconsole.pipeline.cycle.miss_reasons import (
    KEPT_FRAMES,
    StarStatistics,
    cloud_cause,
    eclipse_cause,
    is_geostationary_like,
    miss_with_causes,
    next_eclipse_utc_ns,
    updated_star_history,
)
from rsoconsole.records import (
    Detections,
    Frame,
    Miss,
    Missed,
    NotSolved,
    Site,
    SlewRefusal,
    Solution,
    TrackState,
    Wcs,
)
from rsoconsole.sky import geo_slot_direction_deg, icrs_of_hour_angle, iso_to_utc_ns
from rsoconsole.tracking import Following, LiveTrack
from rsoconsole.words import text

NS = 1_000_000_000
MINUTE_NS = 60 * NS
DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
SLOT_DEG = -45.0
EQUINOX_MIDNIGHT_NS = iso_to_utc_ns("2023-03-20T03:07:30Z")
"""Local solar midnight over 45 W: 3 h of longitude and an equation of time of 7.5 min."""
GEO_RATE_DEG_S = 360.98564736629 / 86_400.0


def direction(t_utc_ns: int, slot_deg: float = SLOT_DEG) -> tuple[float, float]:
    return icrs_of_hour_angle(DAYTONA, *geo_slot_direction_deg(DAYTONA, slot_deg), t_utc_ns)


def track(t_utc_ns: int, *, rate_deg_s: float = GEO_RATE_DEG_S) -> TrackState:
    ra_deg, dec_deg = direction(t_utc_ns)
    return TrackState(
        track_id=1,
        kind="updated",
        frame_id=1,
        t_utc_ns=t_utc_ns,
        x=(ra_deg, rate_deg_s, dec_deg, 0.0),
        P=tuple(tuple(row) for row in (np.eye(4) * 1e-8).tolist()),
    )


def solution(ra_deg: float = 200.0) -> Solution:
    wcs = Wcs(
        crpix_x_px=0.0,
        crpix_y_px=0.0,
        crval_ra_deg=ra_deg,
        crval_dec_deg=-5.0,
        cd=(3.5e-4, 0.0, 0.0, 3.5e-4),
    )
    return Solution(
        frame_id=1,
        wcs=wcs,
        ra_icrs_deg=ra_deg,
        dec_icrs_deg=-5.0,
        scale_arcsec_px=1.26,
        rotation_deg=0.0,
        is_flipped=False,
        matched=50,
        rms_arcsec=0.5,
        path="full",
        ms=10.0,
    )


def stars(count: int, flux_adu_s: float = 1000.0) -> StarStatistics:
    return StarStatistics(count=count, flux_adu_s=flux_adu_s)


def history(*counts: int) -> StarHistory:
    found = StarHistory()
    for count in counts:
        found = updated_star_history(found, stars(count), solution())
    return found


DAY = iso_to_utc_ns("2023-06-22T03:00:00Z")
SHADOW = EQUINOX_MIDNIGHT_NS
CLEAR = history(200, 210, 205, 190)
TABLE = [
    ("nobody counted", None, CLEAR, DAY, None, "no detection"),
    ("nothing known", 200, CLEAR, DAY, None, "no detection"),
    ("a field a little fainter", stars(200, 600.0), CLEAR, DAY, None, "no detection"),
    (
        "a veil",
        stars(200, 200.0),
        CLEAR,
        DAY,
        None,
        "cloud: the stars are 1.7 mag fainter; no detection",
    ),
    ("thin cloud", 90, CLEAR, DAY, None, "cloud: 90 stars where 205 were; no detection"),
    ("thick cloud", 2, CLEAR, DAY, None, "cloud: 2 stars where 205 were; no detection"),
    ("cloud from the start", 2, history(), DAY, None, "only 2 stars, cloud?; no detection"),
    ("a small field is no cloud", 5, history(6, 5, 6), DAY, None, "no detection"),
    ("eclipse", 200, CLEAR, SHADOW, None, "eclipse: in the Earth's shadow; no detection"),
    (
        "cloud and eclipse",
        20,
        CLEAR,
        SHADOW,
        None,
        "cloud: 20 stars where 205 were; eclipse: in the Earth's shadow; no detection",
    ),
    (
        "a refused slew comes first",
        200,
        CLEAR,
        DAY,
        SlewRefusal.beyond("altitude", 14.8, 15.0),
        "slew refused: altitude 14.8 deg is 0.2 below the limit of 15.0; no detection",
    ),
]


@pytest.mark.parametrize(
    ("shown", "before", "t_utc_ns", "blocked", "words"),
    [row[1:] for row in TABLE],
    ids=[row[0] for row in TABLE],
)
def test_an_absence_is_put_down_to_what_caused_it(shown, before, t_utc_ns, blocked, words):
    found = miss_with_causes(
        Missed(kind="no detection"),
        stars=stars(shown) if isinstance(shown, int) else shown,
        stars_before=before,
        track=track(t_utc_ns),
        site=DAYTONA,
        t_utc_ns=t_utc_ns,
        blocked=blocked,
    )
    assert text(found) == words


def test_without_a_track_there_is_neither_eclipse_nor_refused_slew():
    found = miss_with_causes(
        Missed(kind="no detection"),
        stars=stars(200),
        stars_before=CLEAR,
        track=None,
        site=DAYTONA,
        t_utc_ns=SHADOW,
        blocked=SlewRefusal.beyond("Sun", 12.0, 40.0),
    )
    assert text(found) == "no detection"


def test_the_equinox_eclipse_is_as_long_as_published_and_lies_about_the_slots_midnight():
    """Up to ~70 min with the penumbra, ~67 of it dark, centred on the slot's solar midnight."""
    minutes = np.arange(-50, 50.5, 0.5)
    found = [
        eclipse_cause(track(at), DAYTONA, at)
        for at in (SHADOW + round(m * MINUTE_NS) for m in minutes)
    ]
    dark = np.array([each is not None and each.kind == "shadow" for each in found])
    dimmed = np.array([each is not None for each in found])
    assert np.sum(dark) * 0.5 == pytest.approx(67.0, abs=2.0)
    assert np.sum(dimmed) * 0.5 == pytest.approx(71.5, abs=2.0)
    assert np.mean(minutes[dark]) == pytest.approx(0.0, abs=1.5)
    penumbra = [each for each in found if each and each.kind == "penumbra"]
    assert all(text(each).endswith("% of the Sun left") for each in penumbra)
    left = [each.sun_percent for each in penumbra]
    assert left
    assert all(percent is not None and 0.0 <= percent <= 100.0 for percent in left)


def test_there_is_no_eclipse_at_midsummer():
    midnight_ns = iso_to_utc_ns("2023-06-21T03:02:00Z")
    assert eclipse_cause(track(midnight_ns), DAYTONA, midnight_ns) is None
    assert next_eclipse_utc_ns(direction(midnight_ns), DAYTONA, midnight_ns) is None


@pytest.mark.parametrize(
    ("rate_deg_s", "is_geo"),
    [(GEO_RATE_DEG_S, True), (GEO_RATE_DEG_S * 0.5, False), (-40.0 / 3600.0, False)],
)
def test_only_what_stays_over_the_ground_is_looked_for_in_the_shadow(rate_deg_s, is_geo):
    moving = track(SHADOW, rate_deg_s=rate_deg_s)
    assert is_geostationary_like(moving) is is_geo
    assert (eclipse_cause(moving, DAYTONA, SHADOW) is not None) is is_geo


@pytest.mark.parametrize("ahead_h", [1, 6, 20])
def test_the_next_eclipse_begins_when_the_penumbra_does(ahead_h):
    from_ns = SHADOW - ahead_h * 60 * MINUTE_NS
    begins_ns = next_eclipse_utc_ns(direction(from_ns), DAYTONA, from_ns)
    assert begins_ns is not None
    two_minutes = 2 * MINUTE_NS
    assert begins_ns == pytest.approx(SHADOW - 71.5 / 2 * MINUTE_NS, abs=two_minutes)
    assert eclipse_cause(track(begins_ns), DAYTONA, begins_ns - 30 * NS) is None
    assert eclipse_cause(track(begins_ns), DAYTONA, begins_ns + 30 * NS) is not None


def test_in_an_eclipse_the_next_one_is_now():
    assert next_eclipse_utc_ns(direction(SHADOW), DAYTONA, SHADOW) == SHADOW


def test_star_counts_belong_to_their_part_of_the_sky():
    far = updated_star_history(CLEAR, stars(40), solution(220.0))
    assert far.frames == (stars(40),)
    assert (
        updated_star_history(CLEAR, stars(40), NotSolved(frame_id=1, reason="7 stars", ms=1.0))
        == CLEAR
    )
    assert len(history(*range(100)).frames) == KEPT_FRAMES


class BlindReducer:
    """Sees the stars it is told of, and never a satellite."""

    def __init__(self, star_counts: list[int]) -> None:
        self.star_counts = star_counts

    def reduce(self, frame: Frame) -> Reduction:
        count = self.star_counts[frame.frame_id - 1]
        return Reduction(
            detections=Detections(
                frame_id=frame.frame_id,
                width_px=64,
                height_px=64,
                detections=(),
                star_count=count,
            ),
            solution=solution() if count > 20 else None,
            measurements=(),
            star_count=count,
            fwhm_px=2.5,
            absence="no detection",
        )


def test_the_misses_of_a_night_are_named_and_a_second_run_says_the_same():
    """Through the cycle of the engine: clear, cloud, refused, then in the shadow."""
    start_ns = SHADOW - 40 * MINUTE_NS

    def night() -> list[str]:
        cycle = Cycle(BlindReducer([200, 200, 200, 5, 200, 200]), Config())  # type: ignore[arg-type]
        following = Following(state="TRACK", tracks=(LiveTrack(track=track(start_ns)),))
        reasons = []
        for number in range(1, 7):
            late_ns = 40 * MINUTE_NS if number == 6 else 0
            frame = Frame(
                frame_id=number,
                name=f"frame {number}",
                pixels=np.zeros((64, 64), np.uint16),
                t_start_utc_ns=start_ns + number * 30 * NS + late_ns,
                exposure_s=10.0,
            )
            blocked = SlewRefusal.beyond("hour angle", 121.0, 120.0) if number == 5 else None
            # Bounds never end it here: only the words are looked at.
            lead = (LiveTrack(track=track(start_ns)),)
            following = dataclasses.replace(following, state="TRACK", tracks=lead)
            result = cycle.run(frame, following, blocked)
            reasons += [text(r.reason) for r in result.records if isinstance(r, Miss)]
        return reasons

    first = night()
    assert [reason.split(";")[0] for reason in first] == [
        "no detection",
        "no detection",
        "no detection",
        "cloud: 5 stars where 200 were",
        "slew refused: hour angle 121.0 deg is 1.0 beyond the limit of 120.0",
        "eclipse: in the Earth's shadow",
    ]
    assert night() == first


def of_part(count: int, flux_adu_s: float = 1000.0, share: float = 0.5) -> StarStatistics:
    pixels = round(4656 * 3520 * share**2)
    return StarStatistics(count=count, flux_adu_s=flux_adu_s, sensor_px=pixels)


def cloud_words(shown: StarStatistics, *before: StarStatistics) -> str:
    known = StarHistory()
    for each in before:
        known = updated_star_history(known, each, solution())
    found = cloud_cause(shown, known)
    return "" if found is None else found.kind


def test_a_part_of_the_sensor_has_fewer_stars_and_that_is_no_cloud() -> None:
    whole = [of_part(200, share=1.0)] * 4
    assert cloud_words(of_part(50, 400.0), *whole) == ""
    assert cloud_words(of_part(20, 400.0), *whole) == "fewer stars"
    # Of a size of their own they are compared with each other, and the whole is after them.
    parts = [of_part(50, 400.0)] * 4
    assert cloud_words(of_part(50, 150.0), *whole, *parts) == "fainter stars"
    assert cloud_words(of_part(200, share=1.0), *parts) == ""
    assert cloud_words(of_part(90, share=1.0), *whole, *parts) == "fewer stars"
