"""A plate solution as an astropy ``WCS`` with its matched stars, residuals and notes."""

from typing import TYPE_CHECKING, Any

from astropy import units
from astropy.coordinates import SkyCoord
from astropy.wcs import WCS

from rsoconsole.records import Solution
from rsoconsole.sky import wcs_cards

if TYPE_CHECKING:
    from astropy.units import Quantity


class PlateWCS(WCS):  # type: ignore[misc]  # astropy ships no types
    """An astropy ``WCS`` (ICRS; TAN, with SIP where there is distortion) of a solved frame."""

    frame: str
    """The frame's name."""
    matched: int
    """Number of matched catalogue stars."""
    wrong_hints: tuple[str, ...]
    """Solver hints that the stars contradict, one sentence each."""
    notes: tuple[str, ...]
    """Further notes on the frame, in words."""
    is_flipped: bool
    """True where the array is a mirror image of the sky as a FITS viewer shows it."""
    _solution: Solution

    @classmethod
    def of_solution(
        cls,
        solution: Solution,
        *,
        name: str,
        shape: tuple[int, ...],
        wrong_hints: tuple[str, ...] = (),
        notes: tuple[str, ...] = (),
    ) -> "PlateWCS":
        """Make the WCS of a plate solution of a frame.

        ``name``: the frame's name; ``shape``: its (height, width); ``wrong_hints``, ``notes``: see
        the attributes.
        """
        from astropy.io.fits import Header

        cards = wcs_cards(solution.wcs, shape[1], shape[0])
        made = cls(Header(list(cards.items())))
        made.array_shape = shape
        made.frame, made.matched = name, solution.matched
        made.wrong_hints, made.notes = wrong_hints, notes
        made.is_flipped, made._solution = solution.is_flipped, solution
        return made

    @property
    def rms(self) -> "Quantity":
        """Root mean square residual of a matched star, per axis, arcsec."""
        return self._solution.rms_arcsec * units.arcsec

    @property
    def center(self) -> SkyCoord:
        """ICRS direction of the frame's centre, ((width - 1) / 2, (height - 1) / 2)."""
        found = self._solution
        return SkyCoord(found.ra_icrs_deg, found.dec_icrs_deg, unit="deg", frame="icrs")

    @property
    def scale(self) -> "Quantity":
        """Plate scale at the centre, arcsec a pixel."""
        return self._solution.scale_arcsec_px * units.arcsec / units.pix

    @property
    def rotation(self) -> "Quantity":
        """Position angle of the array's +y axis, east of north, 0 to 360 deg."""
        return self._solution.rotation_deg * units.deg

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the plate solution by name, plain numbers in arcsec and degrees."""
        found = self._solution
        return {
            "frame": self.frame,
            "matched": found.matched,
            "rms_arcsec": found.rms_arcsec,
            "ra_deg": found.ra_icrs_deg,
            "dec_deg": found.dec_icrs_deg,
            "scale_arcsec_px": found.scale_arcsec_px,
            "rotation_deg": found.rotation_deg,
            "is_flipped": found.is_flipped,
        }
