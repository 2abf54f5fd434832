"""Plate solver: from star positions in a frame to the frame's plate solution.

A full solution matches quads of stars in a process of its own (``_solver_process``), then fits the
plate to every catalogue star in the field, at the star's position on the day of the frame. The fast
path instead moves the last plate. Where a field cannot be solved, the result is a ``NotSolved``,
which gives the reason.
"""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsoconsole.base import FrameError, SolverError
from rsoconsole.config import WaitsConfig
from rsoconsole.instruments.solver._solver_child import SolverChild
from rsoconsole.instruments.solver._solver_process import MatchReply, MatchRequest
from rsoconsole.instruments.solver.index_files import (
    IndexFile,
    choose_index_files,
    folders_to_search,
    list_index_files,
    missing_index_advice,
    missing_index_numbers,
    series_name,
)
from rsoconsole.records import FloatArray, NotSolved, PlatePath, Solution
from rsoconsole.sky import J2000_JYEAR, StarCatalogue, describe_field, julian_year, wcs_from_cards
from rsoconsole.vision import (
    MIN_SHIFT_STARS,
    PlateFit,
    StarList,
    field_radius_deg,
    refit,
    refit_moved_plate,
    shift_plate,
    solution_from,
)

MIN_STARS = 8
_MAX_STARS = 100
_DEPTHS = (10, 15, 20, 30, 40, 60)
_BLIND_SCALE_ARCSEC_PX = (0.1, 500.0)
_INSTALL = "'rsoconsole index install' gets what is missing"
_WIDEST_DEG = 60.0
_KNOWN_SCALE = 3.0
"""Ratio of highest to lowest scale up to which the size of the field counts as known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveHint:
    """Known position and scale of a field; None for values that are not known."""

    ra_icrs_deg: float | None = None
    dec_icrs_deg: float | None = None
    radius_deg: float = 3.0
    """Largest distance of the field's centre from the stated position, deg."""
    scale_low_arcsec_px: float | None = None
    scale_high_arcsec_px: float | None = None

    @property
    def position_deg(self) -> tuple[float, float, float] | None:
        """RA, Dec and radius, deg; None when the position is not known."""
        if self.ra_icrs_deg is None or self.dec_icrs_deg is None:
            return None
        return self.ra_icrs_deg % 360.0, self.dec_icrs_deg, self.radius_deg

    @property
    def scale_arcsec_px(self) -> tuple[float, float]:
        """Least and greatest scale to search, arcsec/px."""
        low = self.scale_low_arcsec_px or _BLIND_SCALE_ARCSEC_PX[0]
        high = self.scale_high_arcsec_px or _BLIND_SCALE_ARCSEC_PX[1]
        return low, max(low, high)


class PlateSolver:
    """Solves frames one after another; owns the solver process, and is a context manager."""

    def __init__(
        self, index_dirs: Sequence[Path] = (), *, start_s: float = WaitsConfig().process_s
    ) -> None:
        """``index_dirs``: folders searched before the usual ones (``folders_to_search``).

        Catalogue stars outside the shipped belt of declination are read when first needed.
        ``start_s``: longest time for the solver process to start. Raises SolverError when there is
        no usable index file.
        """
        self._files = list_index_files(folders_to_search(tuple(index_dirs)))
        if not any(file.is_healthy for file in self._files):
            faults = "; ".join(f"{f.path.name} {f.fault}" for f in self._files)
            raise SolverError(f"no usable index files ({faults or 'none found'}): {_INSTALL}")
        self._catalogue = StarCatalogue.load()
        self._index_stars: FloatArray | None = None
        """RA, Dec of the last field where the catalogue did not suffice."""
        self._request_ids = itertools.count(1)
        self._child = SolverChild(start_s)
        self._child.start()

    def __enter__(self) -> "PlateSolver":
        """Return itself; the process is already starting."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the process."""
        self.close()

    def close(self) -> None:
        """End the solver process; the solver must not be used afterwards."""
        self._child.close()

    def solve(
        self,
        stars: FloatArray | StarList,
        *,
        frame_id: int,
        width_px: int,
        height_px: int,
        hint: SolveHint,
        deadline_s: float,
        t_utc_ns: int | None = None,
    ) -> Solution | NotSolved:
        """Solve a field from its stars.

        ``stars``: (N, 3) of x, y (0-based pixels) and flux, or a StarList. ``t_utc_ns``: when they
        were observed; None: catalogue positions of J2000.0 are used. ``deadline_s``: wall time;
        when it passes, the process is killed and replaced. Raises SolverError only when no process
        can be started.
        """
        started = time.monotonic()
        rows = as_star_rows(stars)
        size_px = (width_px, height_px)
        found = self._search(rows, size_px, hint, deadline_s)
        if isinstance(found, MatchReply):
            fit = self._fitted(found, rows, size_px, _epoch_of(t_utc_ns))
            if fit is not None:
                return solution_from(
                    fit,
                    frame_id=frame_id,
                    width_px=width_px,
                    height_px=height_px,
                    path="full",
                    ms=1e3 * (time.monotonic() - started),
                )
            found = "a match was found but the other stars contradict it"
        ms = 1e3 * (time.monotonic() - started)
        return NotSolved(frame_id=frame_id, reason=found, ms=ms)

    def refit_from(
        self,
        previous: Solution,
        stars: FloatArray | StarList,
        *,
        frame_id: int,
        width_px: int,
        height_px: int,
        shift_deg: tuple[float, float] = (0.0, 0.0),
        search_arcsec: float = 120.0,
        t_utc_ns: int | None = None,
        may_be_few: bool = False,
    ) -> Solution | None:
        """Move the previous plate onto this frame's stars: the fast path, a few milliseconds.

        ``shift_deg``: ordered move of the telescope since then, differences (RA, Dec) in degrees,
        with errors of up to ``search_arcsec``. ``t_utc_ns``: as for ``solve``. ``may_be_few``:
        where the stars are too few to fit a plate, accept the previous plate, shifted, if a few
        match.

        Returns None when the plate does not fit, for example in another field: then call
        ``solve``.
        """
        started = time.monotonic()
        rows = as_star_rows(stars)
        if len(rows) < (MIN_SHIFT_STARS if may_be_few else MIN_STARS):
            return None
        radius_deg = field_radius_deg(previous.wcs, width_px, height_px) + search_arcsec / 3600.0
        catalogue = self._index_stars
        if catalogue is None:
            catalogue = self._cone(
                previous.ra_icrs_deg + shift_deg[0],
                previous.dec_icrs_deg + shift_deg[1],
                radius_deg,
                _epoch_of(t_utc_ns),
            )
        fit = refit_moved_plate(
            previous.wcs,
            rows[:, :2],
            catalogue,
            width_px=width_px,
            height_px=height_px,
            shift_deg=shift_deg,
            search_arcsec=search_arcsec,
        )
        path: PlatePath = "refit"
        if (fit is None or fit.matched < MIN_STARS) and may_be_few:
            path = "shift"
            fit = shift_plate(
                previous.wcs,
                rows[:, :2],
                catalogue,
                width_px=width_px,
                height_px=height_px,
                shift_deg=shift_deg,
                search_arcsec=search_arcsec,
                rms_arcsec=previous.rms_arcsec,
            )
        if fit is None or (path == "refit" and fit.matched < MIN_STARS):
            return None
        return solution_from(
            fit,
            frame_id=frame_id,
            width_px=width_px,
            height_px=height_px,
            path=path,
            ms=1e3 * (time.monotonic() - started),
        )

    def _search(
        self, rows: FloatArray, size_px: tuple[int, int], hint: SolveHint, deadline_s: float
    ) -> MatchReply | str:
        """Search for a match; return it, or in words why there is none."""
        if len(rows) < MIN_STARS:
            return f"{len(rows)} stars, {MIN_STARS} needed"
        files = self._files_for(hint, *size_px)
        finer = self._missing_index_words(hint, *size_px)
        if not files:
            return _no_index_reason(hint, finer)
        request = MatchRequest(
            request_id=next(self._request_ids),
            index_files=tuple(str(file.path) for file in files),
            stars_xy_px=tuple((float(x), float(y)) for x, y, _ in rows[:_MAX_STARS]),
            scale_arcsec_px=hint.scale_arcsec_px,
            position_deg=hint.position_deg,
            depths=_DEPTHS,
        )
        reply = self._child.request_match(request, deadline_s)
        if reply.wcs_cards is not None:
            return reply
        return reply.error or f"no match for {len(rows)} stars{_search_words(hint, files)}{finer}"

    def missing_numbers_for_field(
        self, hint: SolveHint, width_px: int, height_px: int
    ) -> tuple[int, ...]:
        """Return the numbers of the missing index files that a field needs, finest first.

        Empty where the hint does not determine the scale.
        """
        low, high = hint.scale_arcsec_px
        if high > _KNOWN_SCALE * low:
            return ()
        return missing_index_numbers(
            self._files,
            short_arcmin=min(width_px, height_px) * math.sqrt(low * high) / 60.0,
            dec_icrs_deg=hint.dec_icrs_deg if hint.position_deg else None,
            radius_deg=hint.radius_deg,
        )

    def _missing_index_words(self, hint: SolveHint, width_px: int, height_px: int) -> str:
        """Missing index files for a field, in words for the end of a sentence."""
        low, high = hint.scale_arcsec_px
        if high > _KNOWN_SCALE * low:
            finest = min((f for f in self._files if f.is_healthy), key=lambda f: f.quad_deg)
            arcmin = 60.0 * finest.quad_deg[0]
            name = finest.path.name if finest.scale is None else series_name(finest.scale)
            return (
                f"; fields below {arcmin / 0.7:.0f} arcmin want finer index files than {name},"
                " the finest here: give the scale to see which"
            )
        longest_deg = max(width_px, height_px) * math.sqrt(low * high) / 3600.0
        if longest_deg > _WIDEST_DEG:
            return (
                f"; a field {longest_deg:.0f} deg long is wider than the {_WIDEST_DEG:.0f} deg of a"
                " flat plate: cut out its middle"
            )
        missing = self.missing_numbers_for_field(hint, width_px, height_px)
        if not missing:
            return ""
        field = " x ".join(
            f"{px * math.sqrt(low * high) / 60.0:.3g}" for px in (width_px, height_px)
        )
        return f"; a field of {field} arcmin wants index files {missing_index_advice(missing)}"

    def _files_for(self, hint: SolveHint, width_px: int, height_px: int) -> tuple[IndexFile, ...]:
        """Index files whose quads are 10 to 100 % of a field that the hint allows."""
        low, high = hint.scale_arcsec_px
        quads = (
            0.1 * min(width_px, height_px) * low / 3600.0,
            math.hypot(width_px, height_px) * high / 3600.0,
        )
        diagonal_deg = min(math.hypot(width_px, height_px) * high / 3600.0, 60.0)
        return choose_index_files(
            self._files,
            quad_deg=quads,
            dec_icrs_deg=hint.dec_icrs_deg if hint.position_deg else None,
            radius_deg=hint.radius_deg + diagonal_deg / 2.0,
        )

    def _fitted(
        self, reply: MatchReply, stars: FloatArray, size_px: tuple[int, int], epoch_jyear: float
    ) -> PlateFit | None:
        """Fit the plate of a match to all stars."""
        width_px, height_px = size_px
        try:
            start = wcs_from_cards(reply.wcs_cards or {})
        except FrameError:
            return None
        field = describe_field(start, width_px, height_px)
        radius_deg = field_radius_deg(start, width_px, height_px)
        catalogue = self._cone(field.ra_icrs_deg, field.dec_icrs_deg, radius_deg, epoch_jyear)
        fit = refit(stars[:, :2], catalogue, start, width_px=width_px, height_px=height_px)
        self._index_stars = None
        if fit is not None:
            return fit
        # A small field: an index file deeper than Tycho-2 may still hold enough of its stars.
        indexed = np.array(reply.stars, float).reshape(-1, 3)[:, :2]
        fit = refit(stars[:, :2], indexed, start, width_px=width_px, height_px=height_px)
        if fit is not None:
            self._index_stars = indexed
        return fit

    def _cone(
        self, ra_deg: float, dec_deg: float, radius_deg: float, epoch_jyear: float
    ) -> FloatArray:
        """Catalogue stars (N, 2): RA, Dec at that epoch, brightest first."""
        catalogue = self._catalogue
        if not catalogue.covers(dec_deg, radius_deg):
            catalogue = StarCatalogue.load_whole_sky()
        found = catalogue.cone(ra_deg % 360.0, dec_deg, radius_deg, epoch_jyear=epoch_jyear)
        return np.stack([found.ra_icrs_deg, found.dec_icrs_deg], axis=1)


def _epoch_of(t_utc_ns: int | None) -> float:
    return J2000_JYEAR if t_utc_ns is None else julian_year(t_utc_ns)


def as_star_rows(stars: FloatArray | StarList) -> FloatArray:
    """Return the stars as rows (N, 3) of x, y, flux: brightest first, only finite ones."""
    if isinstance(stars, StarList):
        rows = np.stack([stars.x_px, stars.y_px, stars.flux], axis=1)
    else:
        rows = np.asarray(stars, float).reshape(-1, 3)
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows[np.argsort(-rows[:, 2], kind="stable")]


def _search_words(hint: SolveHint, files: tuple[IndexFile, ...]) -> str:
    """Searched range in words, for the operator to see what to widen."""
    low, high = hint.scale_arcsec_px
    numbers = ", ".join(str(f.scale if f.scale is not None else f.path.name) for f in files)
    where = f" at {low:.4g} to {high:.4g} arcsec/px with index {numbers}"
    if position := hint.position_deg:
        where += f" within {position[2]:g} deg of RA {position[0]:.3f} Dec {position[1]:+.3f}"
    dec_low, dec_high = min(f.dec_deg[0] for f in files), max(f.dec_deg[1] for f in files)
    is_beyond = hint.position_deg is None or not (
        dec_low <= hint.position_deg[1] - hint.radius_deg
        and hint.position_deg[1] + hint.radius_deg <= dec_high
    )
    if is_beyond and not any(file.is_whole_sky for file in files):
        where += f"; they cover Dec {dec_low:+.0f} to {dec_high:+.0f} only: {_INSTALL}"
    return where


def _no_index_reason(hint: SolveHint, finer: str) -> str:
    low, high = hint.scale_arcsec_px
    where = f"scale {low:.4g} to {high:.4g} arcsec/px"
    if hint.position_deg is not None:
        where += f" at Dec {hint.dec_icrs_deg:+.1f}"
    return f"no index file covers this field ({where}){finer or f': {_INSTALL}'}"
