"""Nights for exports: followed record by record, with plates, and rows made up by hypothesis."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from hypothesis import strategies as st

from rsoconsole.config import Config
from rsoconsole.library.formats._iod_reader import parse_iod_line
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.records import FrameTaken, Measurement, ObjectClass, Solution, Wcs
from rsoconsole.session import SessionWriter
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow

NS = 1_000_000_000
T0 = iso_to_utc_ns("2023-06-23T05:30:00Z") + 123_456_789
ARCSEC = 1 / 3600
WIDTH_PX, HEIGHT_PX = 320, 240
SCALE_DEG = 10.0 * ARCSEC
MISSED = (7, 8)
STRAY_ARCSEC = 400.0
WOBBLE_ARCSEC = 0.2


def read_tdm(path: Path) -> Any:
    """The message in a file."""
    return parse_tdm(path.read_text(encoding="utf-8"), str(path))


def read_iod(path: Path) -> tuple[Any, ...]:
    """The lines of a file that are observations."""
    lines = path.read_text(encoding="ascii").splitlines()
    return tuple(
        parse_iod_line(line) for line in lines if line.strip() and not line.startswith("#")
    )


def measurement(frame_id: int, north_arcsec: float = 0.0, **more: Any) -> Measurement:
    """Of a satellite that crosses RA 0h in the middle of its night."""
    t_s = 30.0 * frame_id
    wobble = WOBBLE_ARCSEC if frame_id % 2 else -WOBBLE_ARCSEC
    ra, dec = (359.1 + 15.04 * ARCSEC * t_s) % 360.0, -0.25 + (wobble + north_arcsec) * ARCSEC
    half = 75.2 * ARCSEC
    values: dict[str, Any] = {
        "measurement_id": f"{frame_id}-{round(north_arcsec)}",
        "frame_id": frame_id,
        "t_mid_utc_ns": T0 + 30 * frame_id * NS,
        "ra_icrs_deg": ra,
        "dec_icrs_deg": dec,
        "cov_sky_arcsec2": (0.09, 0.006, 0.04),
        "x_px": 100.25 + frame_id,
        "y_px": 80.5,
        "confidence": 0.9 - 0.01 * frame_id,
        "source": "network",
        "ends_icrs_deg": (((ra - half) % 360.0, dec), ((ra + half) % 360.0, dec)),
    }
    return Measurement(**(values | more))


def taken(frame_id: int) -> FrameTaken:
    return FrameTaken(
        frame_id=frame_id,
        name=f"{frame_id}.fits",
        t_start_utc_ns=T0 + (30 * frame_id - 5) * NS,
        exposure_s=10.0,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )


def plate(frame_id: int) -> Solution:
    """Turned, mirrored and bent."""
    wcs = Wcs(
        crpix_x_px=150.0,
        crpix_y_px=130.0,
        crval_ra_deg=(359.1 + 15.04 * ARCSEC * 30.0 * frame_id) % 360.0,
        crval_dec_deg=-0.25,
        cd=(0.8 * SCALE_DEG, -0.6 * SCALE_DEG, 0.6 * SCALE_DEG, 0.8 * SCALE_DEG),
        sip_a=((2, 0, 1.1e-6), (1, 1, -4e-7)),
        sip_b=((0, 2, 9e-7), (2, 1, 2e-9)),
    )
    return Solution(
        frame_id=frame_id,
        wcs=wcs,
        ra_icrs_deg=wcs.crval_ra_deg,
        dec_icrs_deg=wcs.crval_dec_deg,
        scale_arcsec_px=10.0,
        rotation_deg=0.0,
        is_flipped=True,
        matched=42,
        rms_arcsec=0.31,
        path="refit",
        ms=4.0,
    )


def written_night(
    folder: Path,
    *,
    frames: int = 14,
    clipped: tuple[int, ...] = (),
    about: Any = None,
    most_tracks: int = 1,
    more: Callable[[int, tuple[Measurement, ...]], tuple[Any, ...]] = lambda *_: (),
) -> SessionWriter:
    """A night that goes on: a stray beside what is followed in every frame, two frames missed.

    ``more``: further records of a frame, by its number and measurements.
    """
    config = Config.model_validate({"site": {"name": "Hügel <1>", "latitude_deg": 47.5}})
    alone = config.filter.model_copy(update={"most_tracks": most_tracks})
    settings = FollowSettings(filter=alone, half_field_deg=0.6)
    writer = SessionWriter.create(folder, config, {"title": "across 0h", **(about or {})})
    following = Following()
    for frame_id in range(1, frames + 1):
        measured: tuple[Measurement, ...] = ()
        if frame_id not in MISSED:
            true = measurement(frame_id, is_clipped=frame_id in clipped)
            measured = (true, measurement(frame_id, STRAY_ARCSEC, confidence=0.3, y_px=120.5))
        seen = FrameInput(
            frame_id=frame_id,
            t_mid_utc_ns=T0 + 30 * frame_id * NS,
            exposure_s=10.0,
            measurements=measured,
        )
        following, records = follow(following, seen, settings)
        records = (*records, *more(frame_id, measured))
        for record in (taken(frame_id), plate(frame_id), *measured, *records):
            writer.append(record, seen.t_mid_utc_ns)
    assert writer.flush()
    return writer


def closed_night(folder: Path, **more: Any) -> Path:
    writer = written_night(folder, **more)
    writer.close()
    return folder


LEAP = iso_to_utc_ns("2017-01-01T00:00:00Z")
"""Just behind a leap second."""
_real = st.floats(-1e9, 1e9, allow_nan=False)
_ra = st.one_of(
    st.floats(0.0, 360.0, exclude_max=True),
    st.sampled_from([0.0, 5e-324, 1e-12, 359.999999999999, 359.9999999999, 180.0]),
)
_dec = st.one_of(
    st.floats(-90.0, 90.0),
    st.sampled_from([-90.0, 90.0, -0.0, -0.5, -0.5 / 60, -1e-13, 89.99999999999, -1 / 3600]),
)
_sigma = st.one_of(st.floats(1e-6, 1e5), st.just(0.0))
_instants = st.one_of(
    st.integers(iso_to_utc_ns("1999-01-01T00:00:00Z"), iso_to_utc_ns("2035-01-01T00:00:00Z")),
    st.integers(-2 * NS, 2 * NS).map(lambda ns: LEAP + ns),
    st.sampled_from([LEAP - 400_000, LEAP - 1, LEAP, LEAP + 499_999, T0 + 999_600_000]),
)
_text = st.text(
    st.characters(codec="utf-8", exclude_characters="\x00\r", exclude_categories=["Cs", "Cc"]),
    min_size=1,
    max_size=20,
).filter(lambda text: text == text.strip())


_OF_FRAME: dict[str, st.SearchStrategy[Any]] = {
    "star_fwhm_px": st.floats(0.5, 20.0),
    "background_adu": st.floats(0.0, 65535.0),
    "zero_point_mag": st.floats(5.0, 30.0),
    "limiting_mag": st.floats(5.0, 25.0),
    "star_count": st.integers(0, 500),
}
"""What a frame says of image and sky."""


def made_up_rows(**more: st.SearchStrategy[Any]) -> st.SearchStrategy[MeasuredRow]:
    """Rows of any content that a session could have."""
    hints = MeasuredRow.__annotations__
    optional = {
        name: st.none() | _real for name, hint in hints.items() if "float | None" in str(hint)
    }
    fields: dict[str, st.SearchStrategy[Any]] = {
        **optional,
        "frame_id": st.integers(0, 2**31),
        "track": st.none() | st.integers(1, 99),
        "t_mid_utc_ns": _instants,
        "ra_icrs_deg": _ra,
        "dec_icrs_deg": _dec,
        "sigma_ra_arcsec": _sigma,
        "sigma_dec_arcsec": _sigma,
        "correlation": st.floats(-1.0, 1.0),
        "x_px": _real,
        "y_px": _real,
        "confidence": st.floats(0.0, 1.0),
        "source": st.sampled_from(["network", "operator"]),
        "is_clipped": st.booleans(),
        "is_taken": st.booleans(),
        "not_taken_because": st.none() | _text,
        "is_superseded": st.booleans(),
        "band": st.none() | st.sampled_from(["V", "instrumental"]),
        "is_saturated": st.none() | st.booleans(),
        "beside": st.tuples(
            st.tuples(st.just("is_crossing"), st.booleans()),
            st.tuples(st.just("object_class"), st.sampled_from(get_args(ObjectClass))),
            *(st.tuples(st.just(name), st.none() | values) for name, values in _OF_FRAME.items()),
        ),
    }
    return st.builds(MeasuredRow, **(fields | more))


def taken_rows() -> st.SearchStrategy[list[MeasuredRow]]:
    """What one track took: whole streaks, one an instant, in order of time."""
    row = made_up_rows(
        track=st.just(1),
        is_taken=st.just(True),
        is_clipped=st.just(False),
        is_superseded=st.just(False),
        exposure_s=st.just(10.0),
    )
    rows = st.lists(row, min_size=1, max_size=6, unique_by=lambda r: r.t_mid_utc_ns)
    return rows.map(lambda each: sorted(each, key=lambda r: r.t_mid_utc_ns))


def night_of(rows: Any, **about: Any) -> ExportedNight:
    """A night that holds these rows."""
    return ExportedNight(
        name="made-up",
        title="made up",
        config=Config(),
        about=about,
        rows=tuple(replace(row) for row in rows),
    )
