"""``rso.track``: groups measurements by object, with the code of the live tracker."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rsoconsole.base import InputError, SessionError
from rsoconsole.config import Config, Preset, SiteConfig
from rsoconsole.library._given import (
    ConfigLike,
    Number,
    Place,
    records_table,
    required_site,
    resolve_config,
)
from rsoconsole.library._observations import (
    META,
    Directions,
    TableLike,
    column_in_unit,
    covariance_sigmas,
    expect_table,
    plain_column,
    read_directions,
    rsoconsole_meta,
)
from rsoconsole.library.frames import frame_overrides
from rsoconsole.library.measurement import SIGMAS
from rsoconsole.night import NightTrack, frames_of, tracks_of
from rsoconsole.pipeline import (
    FrameObservations,
    Orbits,
    StarHistory,
    fold_frame,
    mid_exposure_utc_ns,
)
from rsoconsole.records import (
    Detections,
    FrameTaken,
    Identified,
    Measurement,
    NotSolved,
    OrbitEstimate,
    Record,
    Site,
    Solution,
    measurement_id_of,
)
from rsoconsole.session import decode
from rsoconsole.tracking import Following

if TYPE_CHECKING:
    from astropy.table import QTable
    from astropy.units import Quantity

_TABLES = ("measurements", "track", "not_followed", "misses", "orbits", "identifications")


class Track:
    """One object followed over frames: its measurements, states and orbit."""

    def __init__(self, *, site: Site, found: NightTrack) -> None:
        self._found = found
        self.site = site
        """Site of the observations."""

    @property
    def number(self) -> int:
        """Track number from 1, in the order in which tracks began."""
        return self._found.number

    @property
    def measurements(self) -> "QTable":
        """Measurements of the track in order of time, in the columns of ``rso.measure``."""
        rows = self._found.measurements
        more = [
            dict(
                zip((c.name for c in SIGMAS[:3]), covariance_sigmas(m.cov_sky_arcsec2), strict=True)
            )
            for m in rows
        ]
        meta = {"track": self.number, META: {"site": asdict(self.site)}}
        return records_table("measurements", rows, meta, extra=SIGMAS[:3], more=more)

    @property
    def states(self) -> "QTable":
        """States of the filter, one a row, with covariance (4, 4), innovation and NIS."""
        return records_table("track", self._found.states, {"track": self.number})

    @property
    def orbit(self) -> OrbitEstimate | None:
        """Last orbit fitted during tracking, or None. ``rso.orbit`` fits one to all directions."""
        return self._found.orbit

    @property
    def identified(self) -> Identified | None:
        """Last identification during tracking; None without one, or without a catalogue."""
        return self._found.identified

    @property
    def missed(self) -> Mapping[int, str]:
        """Reasons why frames did not show the object, by frame number."""
        return self._found.missed

    @property
    def ended(self) -> str:
        """Reason why the track ended, in words; empty where it lasted to the last frame."""
        return self._found.ended

    @property
    def residual_rms(self) -> "Quantity | None":
        """Root mean square innovation on the sky, both axes together; None without an update."""
        from astropy import units

        rms = self._found.quality.residual_rms_arcsec
        return None if rms is None else rms * units.arcsec

    @property
    def nis_mean(self) -> float | None:
        """Mean NIS: about 2 where the stated errors are right; None without an update."""
        return self._found.quality.nis_mean

    @property
    def taken(self) -> tuple[Measurement, ...]:
        """Measurements of the track, as records."""
        return self._found.measurements

    def __len__(self) -> int:
        return len(self._found.measurements)

    def __repr__(self) -> str:
        rms = self._found.quality.residual_rms_arcsec
        words = "" if rms is None else f', residual rms {rms:.2f}"'
        ended = f", ended: {self.ended}" if self.ended else ""
        return f"<Track {self.number}: {len(self)} measurements{words}{ended}>"


class Tracks(dict[int, Track]):
    """Tracks by number, with the records of everything that the tracker decided."""

    def __init__(self, tracks: Mapping[int, Track], records: tuple[Record, ...]) -> None:
        super().__init__(tracks)
        self.records = records
        """Records in order, as in a session's log."""

    def table(self, name: str) -> "QTable":
        """Return a table with rows of all tracks, named as in a session, e.g. ``"misses"``.

        Raises InputError for an unknown name.
        """
        if name not in _TABLES:
            raise InputError(f"there is no table {name!r}; there are {', '.join(_TABLES)}")
        return records_table(name, self.records, {"table": name})


_ENDS = ("ra_a_icrs_deg", "dec_a_icrs_deg", "ra_b_icrs_deg", "dec_b_icrs_deg")
MIN_MORE = 3
"""Fewest measurements of a track that a further telescope finds: two may agree by chance."""
USUAL_EXPOSURE_S = 0.1
"""Exposure, s, of observations that state none: they have no ends and count as points."""


def track(
    measurements: TableLike,
    *,
    site: Place | None = None,
    exposure: Number | None = None,
    sigma: Number | None = None,
    preset: Preset | None = None,
    config: ConfigLike = None,
) -> Tracks:
    """Group measurements into tracks of moving objects, as the live tracker would.

    ``measurements``: the table of ``rso.measure``, or a table of your own (also a pandas data
    frame) with these columns:

    - times as a ``Time`` column ``time`` or ``t_mid_utc`` (mid-exposure, UTC);
    - directions as a ``SkyCoord`` column, or as ``ra`` and ``dec`` with units (ICRS);
    - errors as ``sigma``, or as ``sigma_ra`` (on the sky), ``sigma_dec`` and ``correlation``;
    - ``exposure_s`` and ``confidence`` where known.

    A column has a unit, or ends with the name of one (``ra_deg``, ``sigma_arcsec``). Rows of the
    same instant belong to one frame; a table may hold several objects.

    ``site``: an ``EarthLocation`` or (latitude, longitude east positive, metres); None: the table's
    own, else the configured site. ``exposure`` (s; None: 0.1), ``sigma`` (arcsec): for rows that
    state none. ``preset``: of the filter; ``config``: all further settings.

    The first run follows the objects that move together. Measurements that no track used are then
    tracked in further runs, until fewer than three measurements agree on one motion.

    Returns a dict of ``rso.Track`` by number from 1, in the order in which the tracks began, run
    after run; empty where no measurements agree on one motion. ``Tracks.table`` gives states,
    misses, and the measurements that were not used, with the reasons.

    Raises InputError that says what the table lacks, ConfigError.

    >>> tracks = rso.track(measured)
    >>> tracks[1].measurements["t_mid_utc", "direction"], tracks[1].residual_rms
    """
    table = expect_table(measurements, "table of measurements")
    if not len(table) and rsoconsole_meta(table):
        return Tracks({}, ())  # frames that show nothing
    rows = read_directions(table, sigma)
    where = required_site(site, rows.site, config)
    settings = _at_site(resolve_config(config, {"filter.preset": preset}), where)
    exposure_s = frame_overrides(exposure=exposure).exposure_s
    frames = list(_frames(table, rows, settings, exposure_s))
    records = tuple(tracking_records(frames, settings))
    found = tracks_of(frames_of(records))
    left, last = _left(frames, found.values()), max(found, default=0)
    while left:
        more = tuple(tracking_records(left, settings, last_track_id=last))
        tracks = {
            n: t for n, t in tracks_of(frames_of(more)).items() if len(t.measurements) >= MIN_MORE
        }
        left = _left(left, tracks.values()) if tracks else []
        found, last = found | tracks, max(tracks, default=last)
        records += more if tracks else ()
    return Tracks(
        {number_: Track(site=where, found=each) for number_, each in found.items()}, records
    )


def _left(
    frames: Sequence[FrameObservations], tracks: Iterable[NightTrack]
) -> list[FrameObservations]:
    """The frames with what no track took; none where that is too little for one more."""
    taken = {m.measurement_id for each in tracks for m in each.measurements}
    left = [
        replace(
            each, measurements=tuple(m for m in each.measurements if m.measurement_id not in taken)
        )
        for each in frames
    ]
    return left if sum(bool(each.measurements) for each in left) >= MIN_MORE else []


def tracking_records(
    frames: Sequence[FrameObservations], config: Config, *, last_track_id: int = 0
) -> Iterator[Record]:
    """Yield the records that tracking makes of frames, frame after frame, as ``process`` does.

    ``last_track_id``: highest track id in use; new tracks get the numbers after it.
    """
    following, stars, orbits = Following(last_track_id=last_track_id), StarHistory(), Orbits(config)
    for each in frames:
        shown = replace(each, orbits=orbits.last)
        folded = fold_frame(following, stars, shown, config)
        following, stars = folded.following, folded.stars
        solution = () if shown.solution is None else (shown.solution,)
        seen = (shown.taken, shown.detections, *solution, *shown.measurements)
        for record in (*seen, *folded.records):
            orbits.receive(record)
            yield record
        yield from orbits.derive_frame_records()


def _at_site(config: Config, site: Site) -> Config:
    name = config.site.name if config.site.to_site() == site else "observer"
    return config.model_copy(update={"site": SiteConfig(name=name, **asdict(site))})


def _frames(
    table: Any, rows: Directions, config: Config, exposure_s: float | None
) -> Iterator[FrameObservations]:
    """Frames in order of time, each with its rows, the most confident first."""
    confidence = plain_column(table, "confidence", float)
    lengths = column_in_unit(table, ("exposure",), "s")
    listed = _meta_frames(table)
    groups = _of_frames(rows, listed, config)
    for frame_id, (seen, members) in enumerate(groups, start=1):
        if confidence is not None:
            members = sorted(members, key=lambda n: -confidence[n])  # noqa: PLW2901
        if seen is None:
            length_s = exposure_s or USUAL_EXPOSURE_S
            if exposure_s is None and lengths is not None:
                length_s = float(lengths[members[0]])
            seen = _synthetic_frame(int(rows.t_utc_ns[members[0]]), length_s, config)  # noqa: PLW2901
        yield replace(
            seen,
            taken=replace(seen.taken, frame_id=frame_id),
            detections=replace(seen.detections, frame_id=frame_id),
            solution=None if seen.solution is None else replace(seen.solution, frame_id=frame_id),
            measurements=tuple(
                _measurement(table, rows, n, frame_id, place) for place, n in enumerate(members)
            ),
        )


def _of_frames(
    rows: Directions, listed: Sequence[FrameObservations], config: Config
) -> list[tuple[FrameObservations | None, list[int]]]:
    """Frames in order of time, with the numbers of their rows."""
    mids = [(_mid_ns(each.taken, config), each) for each in listed]
    mids.sort(key=lambda pair: pair[0])
    of_frame: list[list[int]] = [[] for _ in mids]
    alone: dict[int, list[int]] = {}
    at = np.array([t for t, _ in mids], np.int64)
    for n, t in enumerate(rows.t_utc_ns):
        nearest = int(np.argmin(np.abs(at - t))) if len(at) else -1
        if nearest >= 0 and _is_within(int(t), *mids[nearest]):
            of_frame[nearest].append(n)
        else:
            alone.setdefault(int(t), []).append(n)
    found: list[tuple[int, FrameObservations | None, list[int]]] = [
        (t, seen, members) for (t, seen), members in zip(mids, of_frame, strict=True)
    ]
    found += [(t, None, members) for t, members in alone.items()]
    found.sort(key=lambda each: each[0])
    return [(seen, members) for _, seen, members in found]


def _is_within(t_utc_ns: int, mid_ns: int, seen: FrameObservations) -> bool:
    """True where an instant may be a row's of that frame, whose shutter may roll."""
    half_ns = max((seen.taken.exposure_s or 0.0) * 5e8, 1e8)
    return abs(t_utc_ns - mid_ns) <= half_ns


def _mid_ns(taken: FrameTaken, config: Config) -> int:
    mid = mid_exposure_utc_ns(taken, config.exposure)
    if mid is None:
        raise InputError(f"frame {taken.name} in the table's meta has no time")
    return mid


def _meta_frames(table: Any) -> list[FrameObservations]:
    """The frames in the ``meta`` of a table that ``rso.measure`` made; none for any other."""
    said = rsoconsole_meta(table).get("frames", ())
    found = []
    for each in said:
        try:
            records = [decode(str(kind), str(body)) for kind, body in each]
        except (SessionError, TypeError, ValueError) as error:
            raise InputError(f"meta[{META!r}]['frames'] is damaged: {error}") from error
        taken = next((r for r in records if isinstance(r, FrameTaken)), None)
        detections = next((r for r in records if isinstance(r, Detections)), None)
        solution = next((r for r in records if isinstance(r, Solution | NotSolved)), None)
        if taken is None or detections is None:
            raise InputError(f"meta[{META!r}]['frames'] is damaged: a frame's record is missing")
        found.append(
            FrameObservations(
                taken=taken,
                # What is not in the caller's table is tracked in no run.
                detections=replace(detections, rejected=()),
                solution=solution,
                measurements=(),
            )
        )
    return found


def _synthetic_frame(t_mid_ns: int, exposure_s: float, config: Config) -> FrameObservations:
    """The frame of observations that say nothing of one: as large as the configured camera's."""
    width_px, height_px = config.optics.width_px, config.optics.height_px
    start_ns = t_mid_ns - round(exposure_s * 5e8)
    taken = FrameTaken(
        frame_id=0,
        name="observation",
        t_start_utc_ns=start_ns,
        exposure_s=exposure_s,
        width_px=width_px,
        height_px=height_px,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    # The row's time is the shutter's already, whatever latency is configured.
    late_ns = _mid_ns(taken, config) - t_mid_ns
    return FrameObservations(
        taken=replace(taken, t_start_utc_ns=start_ns - late_ns),
        detections=Detections(frame_id=0, width_px=width_px, height_px=height_px, detections=()),
        solution=None,
        measurements=(),
    )


def _measurement(table: Any, rows: Directions, n: int, frame_id: int, place: int) -> Measurement:
    names = table.colnames
    ee, en, nn = rows.cov_sky_arcsec2[n]
    return Measurement(
        measurement_id=measurement_id_of(frame_id, place),
        frame_id=frame_id,
        t_mid_utc_ns=int(rows.t_utc_ns[n]),
        ra_icrs_deg=float(rows.ra_icrs_deg[n]),
        dec_icrs_deg=float(rows.dec_icrs_deg[n]),
        cov_sky_arcsec2=(float(ee), float(en), float(nn)),
        x_px=_float(table, "x_px", n, "pix"),
        y_px=_float(table, "y_px", n, "pix"),
        confidence=float(table["confidence"][n]) if "confidence" in names else 1.0,
        source="network",
        ends_icrs_deg=_ends(table, n),
        is_crossing=bool(table["is_crossing"][n]) if "is_crossing" in names else False,
        is_clipped=bool(table["is_clipped"][n]) if "is_clipped" in names else False,
        object_class=str(table["object_class"][n]) if "object_class" in names else "undetermined",  # type: ignore[arg-type]
    )


def _ends(table: Any, n: int) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Ends of the row's streak; None without. Columns as of ``rso.measure``, or as exported."""
    names = ("ends_icrs_deg",) if "ends_icrs_deg" in table.colnames else _ENDS
    if not set(names) <= set(table.colnames):
        return None
    cells = [table[name][n] for name in names]
    if any(np.any(getattr(each, "mask", False)) for each in cells):
        return None
    try:
        values = (
            [_float(table, name, n, "deg") for name in names]
            if names == _ENDS
            else np.asarray(cells[0], float).ravel().tolist()
        )
    except (TypeError, ValueError) as error:
        raise InputError(f"row {n}: the ends of its streak are no directions: {error}") from error
    if len(values) != 4 or not np.all(np.isfinite(values)):
        return None
    a, b, c, d = map(float, values)
    return (a, b), (c, d)


def _float(table: Any, name: str, n: int, unit: str) -> float:
    if name not in table.colnames:
        return 0.0
    value = table[name][n]
    return float(value.to_value(unit) if hasattr(value, "to_value") else value)
