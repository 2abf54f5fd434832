"""A slot of eight satellites, record by record: who is measured, who coasts, who is on trial."""

from collections.abc import Collection, Iterator
from pathlib import Path

from rsoconsole.config import Config
from rsoconsole.night import Night
from rsoconsole.records import (
    CatalogueMatch,
    Cause,
    CycleTiming,
    Detections,
    Identified,
    LoopState,
    Miss,
    Missed,
    OrbitEstimate,
    Photometry,
    Record,
    StateChange,
    TrackState,
)
from rsoconsole.session import SessionWriter
from tests.makers import geo_measurement, straight_detection, streak_light
from tests.nights.made_up_night import (
    CADENCE_S,
    HEIGHT_PX,
    SCALE_DEG,
    WIDTH_PX,
    solution_of,
    t_of,
    taken,
)

COUNT = 8
NAMES = ("ASTRA 1KR", "ASTRA 1L", "ASTRA 1M", "ASTRA 1N", "ASTRA 19.2E SPARE", "", "EUTELSAT 25B")
"""Of the first tracks; one has no name in the catalogue, and the last one is not identified."""
MIDDLE_PX = ((WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0)
SPACING_PX = 150.0


def place_px(track: int) -> tuple[float, float]:
    """Where a track's streak lies in every frame: the mount follows them all."""
    row, column = divmod(track - 1, 4)
    return MIDDLE_PX[0] + (column - 1.5) * SPACING_PX, MIDDLE_PX[1] + (row - 0.5) * SPACING_PX


def frame(
    n: int,
    *,
    lead: int = 2,
    missed: Collection[int] = (),
    begun: int = 1,
    tracks: Collection[int] = range(1, COUNT + 1),
) -> Iterator[Record]:
    """One frame: the lead first; ``begun``: the frame of which the tracks are."""
    base = geo_measurement(n, cadence_s=CADENCE_S)
    yield taken(n, base.ra_icrs_deg, base.dec_icrs_deg)
    seen = [t for t in tracks if t not in missed]
    streaks = tuple(
        straight_detection(
            frame_id=n, x_px=place_px(t)[0], y_px=place_px(t)[1], snr=10.0 * t, length_px=118.0
        )
        for t in seen
    )
    yield Detections(frame_id=n, width_px=WIDTH_PX, height_px=HEIGHT_PX, detections=streaks)
    yield solution_of(n, base.ra_icrs_deg, base.dec_icrs_deg)
    for t in seen:
        yield geo_measurement(
            n,
            cadence_s=CADENCE_S,
            x_px=place_px(t)[0],
            y_px=place_px(t)[1],
            measurement_id=f"{n}-{t}",
        )
    for t in sorted(tracks, key=lambda each: (each != lead, each)):
        yield from _of_track(n, t, lead, is_missed=t in missed, is_first=n == begun)


def story(
    n: int, *, since: int, lead: int = 2, light: Photometry | None = None, **more
) -> Iterator[Record]:
    """A frame, its photometry if any, and how long it took."""
    yield from frame(n, lead=lead, begun=since, **more)
    if n == since:
        yield _change(n, "ACQUIRE", "TRACK")
    if light is not None:
        yield light
    yield CycleTiming(frame_id=n, stage_ms={"total": 180.0})


def light_of(n: int, tracks: Collection[int] = range(1, COUNT + 1), **other) -> Photometry:
    """Photometry of a frame: track 1 has 11 mag, each next one a magnitude more."""
    lights = tuple(streak_light(f"{n}-{t}", 10.0 + t, **other) for t in tracks)
    return Photometry(frame_id=n, streaks=lights, zero_point_mag=22.0, limiting_mag=14.2)


def night_of_eight(frames: int = 12, *, lead: int = 2, missed: Collection[int] = (3,)) -> Night:
    """Eight tracks since the first frame; those of ``missed`` are not seen in the last two."""
    config = Config.model_validate({"filter": {"most_tracks": 12}})
    night = Night(Path("eight"), {"title": "eight"}, config)
    for n in range(1, frames + 1):
        out = missed if n > frames - 2 else ()
        for record in story(n, since=1, lead=lead, missed=out):
            night.fold_record(t_of(n), record)
        for record in told(n):
            night.fold_record(t_of(n), record)
    return night


def write(
    writer: SessionWriter, frames: range, *, missed: Collection[int] = (3,), lead: int = 2
) -> None:
    """The same into a session that has begun."""
    for n in frames:
        out = missed if n >= frames.stop - 2 else ()
        for record in (*story(n, since=frames.start, missed=out, lead=lead), *told(n)):
            writer.append(record, t_of(n))
    assert writer.flush()


def told(n: int) -> Iterator[Record]:
    """Orbits and names of the tracks, known from the third frame on."""
    if n < 3:
        return
    for t, name in enumerate(NAMES, 1):
        yield orbit_of(n, t, "constrained by prior" if t % 2 else "free")
        if name:
            yield name_of(n, t, name)


def orbit_of(n: int, track: int, label: str) -> OrbitEstimate:
    return OrbitEstimate(
        frame_id=n,
        track_id=track,
        label=label,
        prior="geo",
        reason=label,
        observations=n,
        arc_s=30.0 * n,
        epoch_utc_ns=t_of(n),
        r_gcrs_km=(42164.0, 0.0, 0.0),
        v_gcrs_km_s=(0.0, 3.07, 0.0),
        covariance=tuple(tuple(float(i == j) for j in range(6)) for i in range(6)),
        a_km=42164.0,
        e=0.0,
        i_deg=0.1,
        sigma_a_km=5.0,
        rms_arcsec=0.4,
        outliers=0,
    )


def name_of(n: int, track: int, name: str) -> Identified:
    match = CatalogueMatch(
        norad_id=40_000 + track,
        name=name,
        separation_arcsec=3.0,
        along_track_s=0.1,
        cross_track_arcsec=0.1,
        rate_difference_percent=None,
        tle_age_days=0.5,
        score=1.0,
        probability=0.99,
    )
    return Identified(
        frame_id=n,
        track_id=track,
        verdict="ambiguous" if track == 5 else "identified",
        reason="",
        hint="",
        observations=n,
        catalogued=1000,
        matches=(match,),
    )


def _of_track(
    n: int, track: int, lead: int, *, is_missed: bool, is_first: bool
) -> Iterator[Record]:
    if is_first:
        yield state_of(n, track, "initial", is_lead=track == lead)
        return
    yield state_of(n, track, "predicted", is_lead=track == lead, misses=int(is_missed))
    if is_missed:
        yield Miss(frame_id=n, reason=Missed(kind="no detection"), track_id=track)
    else:
        yield state_of(n, track, "updated", is_lead=track == lead)


def state_of(n: int, track: int, kind, *, is_lead: bool, misses: int = 0) -> TrackState:
    base = geo_measurement(n, cadence_s=CADENCE_S)
    x_px, y_px = place_px(track)
    east_deg = -(x_px - MIDDLE_PX[0]) * SCALE_DEG
    north_deg = (y_px - MIDDLE_PX[1]) * SCALE_DEG
    variance = (1.0 / 3600) ** 2
    is_updated = kind == "updated"
    return TrackState(
        track_id=track,
        kind=kind,
        frame_id=n,
        t_utc_ns=t_of(n),
        x=(base.ra_icrs_deg + east_deg, 15.041 / 3600, base.dec_icrs_deg + north_deg, 0.0),
        P=(
            (variance, 0.0, 0.0, 0.0),
            (0.0, 1e-11, 0.0, 0.0),
            (0.0, 0.0, variance, 0.0),
            (0.0, 0.0, 0.0, 1e-11),
        ),
        nis=1.0 + track / 10.0 if is_updated else None,
        innovation_arcsec=(0.3 * track, -0.4 * track) if is_updated else None,
        sigma_innovation_arcsec=(1.1, 1.2) if is_updated else None,
        misses=misses,
        innovations=max(n - 1, 0),
        measurement_id=None if kind == "predicted" else f"{n}-{track}",
        is_lead=is_lead,
    )


def _change(n: int, before: LoopState, after: LoopState) -> StateChange:
    return StateChange(
        frame_id=n, before=before, after=after, reason=Cause(kind="two frames agree")
    )
