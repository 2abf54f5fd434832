"""``rso.measure``: directions of all streaks in frames, with times and covariances."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rsoconsole.base import FrameError
from rsoconsole.library._given import (
    ConfigLike,
    Instant,
    Number,
    Place,
    SkyCoordLike,
    configured_site,
    records_table,
    resolve_config,
    site_of,
)
from rsoconsole.library._observations import META, covariance_sigmas
from rsoconsole.library.frames import Frames, frame_overrides, read_caller_frames
from rsoconsole.pipeline import Reduction, frame_taken_record, open_reducer
from rsoconsole.records import Column, Frame, Measurement, NotSolved, Record, Solution
from rsoconsole.session import encode
from rsoconsole.words import utc_ns_to_iso

if TYPE_CHECKING:
    from astropy.table import QTable

SIGMAS = (
    Column(name="sigma_ra_arcsec", type="real", meaning="On the sky: times cos dec."),
    Column(name="sigma_dec_arcsec", type="real", meaning="One sigma."),
    Column(name="correlation", type="real", meaning="Of the two."),
    Column(name="exposure_s", type="real", meaning="Of its frame."),
)


def measure(
    frames: Frames,
    *,
    t_start: Instant | Iterable[Instant] | None = None,
    exposure: Number | None = None,
    scale: Number | None = None,
    pointing: SkyCoordLike | None = None,
    tau: float | None = None,
    site: Place | None = None,
    extension: str | None = None,
    config: ConfigLike = None,
) -> "QTable":
    """Measure the direction of every streak in frames, as ``rsoconsole process`` does.

    Each frame is searched, solved and measured. Frames are taken in the order given: the plate
    solution of one helps to solve the next.
    ``frames``: as for ``rso.detect``.
    ``t_start``: start of the exposure (``Time``, or a ``datetime`` with its zone), one for each
    frame; with ``exposure`` (s), ``scale`` (arcsec/pix) and ``pointing`` (``SkyCoord``, for the
    solver) it replaces what headers state.
    ``site``: written into the table, for ``rso.track`` and ``rso.orbit``; None: the configured
    site.
    ``tau``, ``extension``, ``config``: as for ``rso.detect``.

    Returns one table, one row for each streak in a solved frame, with the columns of a session's
    ``measurements``. ``direction`` is the ``SkyCoord`` of the streak's midpoint (ICRS, astrometric:
    relative to catalogue stars, seen from the site) at ``t_mid_utc``, the ``Time`` of mid-exposure.
    Its covariance on the sky is ``cov_ee_arcsec2`` and so on, and the same as ``sigma_ra_arcsec``,
    ``sigma_dec_arcsec``, ``correlation``. ``meta["frames"]`` lists every frame, its time, whether
    it was solved, and if not, why. The table keeps everything when written and read as ECSV
    (``write``, ``QTable.read``).

    Raises FrameError for a frame that cannot be used or has no time or exposure, SolverError
    without index files, and as ``rso.detect`` does.

    >>> measured = rso.measure(sorted(Path("night").glob("*.fits")), site=(47.1, 8.52, 620.0))
    >>> measured["t_mid_utc", "direction", "sigma_ra_arcsec"]
    """
    settings = resolve_config(config, {"detector.tau": tau})
    place = configured_site(config) if site is None else site_of(site)
    facts = frame_overrides(
        extension=extension, t_start=t_start, exposure=exposure, scale=scale, pointing=pointing
    )
    taken: list[Measurement] = []
    more: list[dict[str, Any]] = []
    names: dict[int, str] = {}
    shown: list[dict[str, Any]] = []
    records: list[list[list[str]]] = []
    notes: dict[str, None] = {}
    with open_reducer(settings) as (reducer, _):
        for frame in read_caller_frames(frames, facts):
            _expect_time(frame)
            reduction = reducer.reduce(frame)
            names[frame.frame_id] = frame.name
            shown.append(_shown(frame, reduction))
            records.append(_records(frame, reduction))
            notes |= dict.fromkeys(f"{frame.name}: {c.words}" for c in reduction.cautions)
            for each in reduction.measurements:
                taken.append(each)
                values = (*covariance_sigmas(each.cov_sky_arcsec2), frame.exposure_s)
                more.append(dict(zip((c.name for c in SIGMAS), values, strict=True)))
    meta = {
        "frames": shown,
        "notes": list(notes),
        META: {"site": None if place is None else asdict(place), "frames": records},
    }
    return records_table("measurements", taken, meta, names=names, extra=SIGMAS, more=more)


def _expect_time(frame: Frame) -> None:
    missing = [
        words
        for words, value in (
            ("time (DATE-OBS, or t_start=)", frame.t_start_utc_ns),
            ("length of the exposure (EXPTIME, or exposure=)", frame.exposure_s),
        )
        if value is None
    ]
    if missing:
        raise FrameError(
            f"{frame.name} has no {' and no '.join(missing)}: without it nothing is measured,"
            " only detected and solved"
        )


def _records(frame: Frame, reduction: Reduction) -> list[list[str]]:
    """Records of a frame beside its measurements, for ``rso.track``, as in a session's log."""
    records: list[Record] = [frame_taken_record(frame), reduction.detections]
    if reduction.solution is not None:
        records.append(reduction.solution)
    return [[kind, body] for kind, _, body in map(encode, records)]


def _shown(frame: Frame, reduction: Reduction) -> dict[str, Any]:
    """Facts on a frame for the reader of the table."""
    solution = reduction.solution
    t_mid_ns = frame.t_mid_utc_ns
    return {
        "frame": frame.name,
        "t_mid_utc": None if t_mid_ns is None else utc_ns_to_iso(t_mid_ns),
        "exposure_s": frame.exposure_s,
        "detections": len(reduction.detections.detections),
        "measurements": len(reduction.measurements),
        "is_solved": isinstance(solution, Solution),
        "why_not": solution.reason if isinstance(solution, NotSolved) else None,
        "rms_arcsec": solution.rms_arcsec if isinstance(solution, Solution) else None,
    }
