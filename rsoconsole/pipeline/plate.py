"""A frame's plate: the last one moved onto its stars where that fits, a full solution where not."""

from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.errors import SolverError
from rsoconsole.instruments.solver import PlateSolver, SolveHint
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.sky.angles import wrap_180
from rsoconsole.vision.stars import StarList


class PlateFinder:
    """Remembers the last plate and where the mount said it pointed then."""

    def __init__(self, solver: PlateSolver, config: Config) -> None:
        self._solver = solver
        self._config = config
        self._last: Solution | None = None
        self._last_frame: Frame | None = None

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        self._config = config

    def forget(self) -> None:
        """After a flip or a change of the camera the last plate says nothing."""
        self._last = self._last_frame = None

    def solve(self, frame: Frame, stars: StarList) -> Solution | NotSolved:
        """Refit from the last plate, else solve in full with the header's hints."""
        solution: Solution | NotSolved | None = self._refit(frame, stars)
        if solution is None:
            solution = self.solve_in_full(frame, stars, self.hint_of(frame))
        if isinstance(solution, Solution):
            self._last = solution
            # Only the pointing and the size are kept: a frame holds 33 MB.
            self._last_frame = replace(frame, pixels=frame.pixels[:0].copy())
        return solution

    def hint_of(self, frame: Frame) -> SolveHint:
        """What the frame's header promises of its field."""
        scale, tolerance = frame.scale_arcsec_px, self._config.solver.scale_tolerance
        return SolveHint(
            ra_icrs_deg=frame.pointing_ra_icrs_deg,
            dec_icrs_deg=frame.pointing_dec_icrs_deg,
            radius_deg=self._config.solver.radius_deg,
            scale_low_arcsec_px=None if scale is None else scale * (1.0 - tolerance),
            scale_high_arcsec_px=None if scale is None else scale * (1.0 + tolerance),
        )

    def solve_in_full(self, frame: Frame, stars: StarList, hint: SolveHint) -> Solution | NotSolved:
        """A solution from the hint alone; without a position the longer deadline holds."""
        settings = self._config.solver
        is_blind = hint.position_deg is None
        try:
            return self._solver.solve(
                stars,
                frame_id=frame.frame_id,
                width_px=frame.width_px,
                height_px=frame.height_px,
                hint=hint,
                deadline_s=settings.blind_deadline_s if is_blind else settings.deadline_s,
                t_utc_ns=frame.t_mid_utc_ns,
            )
        except SolverError as error:
            # A solver that cannot be started now may be again at the next frame.
            return NotSolved(frame_id=frame.frame_id, reason=str(error), ms=0.0)

    def _refit(self, frame: Frame, stars: StarList) -> Solution | None:
        last, before = self._last, self._last_frame
        if last is None or before is None or before.width_px != frame.width_px:
            return None
        if before.pointing_ra_icrs_deg is None or before.pointing_dec_icrs_deg is None:
            return None
        if frame.pointing_ra_icrs_deg is None or frame.pointing_dec_icrs_deg is None:
            return None
        shift_deg = (
            float(wrap_180(frame.pointing_ra_icrs_deg - before.pointing_ra_icrs_deg)),
            frame.pointing_dec_icrs_deg - before.pointing_dec_icrs_deg,
        )
        return self._solver.refit_from(
            last,
            stars,
            frame_id=frame.frame_id,
            width_px=frame.width_px,
            height_px=frame.height_px,
            shift_deg=shift_deg,
            t_utc_ns=frame.t_mid_utc_ns,
        )


def overridden(
    hint: SolveHint,
    ra_icrs_deg: float | None,
    dec_icrs_deg: float | None,
    radius_deg: float | None,
    scale_arcsec_px: tuple[float, float] | None,
) -> SolveHint:
    """The header's hint with what the operator knows better."""
    if ra_icrs_deg is not None:
        hint = replace(hint, ra_icrs_deg=ra_icrs_deg, dec_icrs_deg=dec_icrs_deg)
    if radius_deg is not None:
        hint = replace(hint, radius_deg=radius_deg)
    if scale_arcsec_px is not None:
        low, high = scale_arcsec_px
        hint = replace(hint, scale_low_arcsec_px=low, scale_high_arcsec_px=high)
    return hint
