"""Pixels to sky and back on a gnomonic plate with SIP distortion, without astropy.

Directions ICRS degrees, pixels 0-based (x = column, y = row). Arrays in, arrays out.
Source: Calabretta & Greisen 2002 (TAN); Shupe et al. 2005 (SIP).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from rsoconsole.base import FrameError
from rsoconsole.records import FloatArray, Wcs

ARCSEC_PER_DEG = 3600.0
_INVERSE_STEPS = 40
_INVERSE_TOLERANCE_PX = 1e-7

Sip = tuple[tuple[int, int, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldDescription:
    """Direction, scale, rotation and mirroring of a plate, at the centre of its image."""

    ra_icrs_deg: float
    dec_icrs_deg: float
    scale_arcsec_px: float
    rotation_deg: float
    """Position angle of the array's +y axis, east of north, 0 to 360."""
    is_flipped: bool
    """True where the image is mirrored (det cd > 0): with north up, east is to the right."""


def pixel_to_sky(
    wcs: Wcs, x_px: float | FloatArray, y_px: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Convert pixels to RA (0 to 360) and Dec in degrees; 0-d arrays for scalars."""
    u = np.asarray(x_px, float) - wcs.crpix_x_px
    v = np.asarray(y_px, float) - wcs.crpix_y_px
    u, v = u + _polynomial(wcs.sip_a, u, v), v + _polynomial(wcs.sip_b, u, v)
    cd11, cd12, cd21, cd22 = wcs.cd
    xi = np.radians(cd11 * u + cd12 * v)
    eta = np.radians(cd21 * u + cd22 * v)
    dec0 = math.radians(wcs.crval_dec_deg)
    towards_pole = math.cos(dec0) - eta * math.sin(dec0)
    ra_deg = (wcs.crval_ra_deg + np.degrees(np.arctan2(xi, towards_pole))) % 360.0
    dec = np.arctan2(math.sin(dec0) + eta * math.cos(dec0), np.hypot(xi, towards_pole))
    return np.asarray(ra_deg), np.asarray(np.degrees(dec))


def sky_to_pixel(
    wcs: Wcs, ra_icrs_deg: float | FloatArray, dec_icrs_deg: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Convert ICRS directions to pixels (x, y); NaN where a direction has no pixel.

    It has none 90 deg or more from the tangent point, or where the SIP distortion has no
    inverse.
    """
    dra = np.radians(np.asarray(ra_icrs_deg, float) - wcs.crval_ra_deg)
    dec, dec0 = np.radians(np.asarray(dec_icrs_deg, float)), math.radians(wcs.crval_dec_deg)
    sin_dec, cos_dec, cos_dra = np.sin(dec), np.cos(dec), np.cos(dra)
    depth = math.sin(dec0) * sin_dec + math.cos(dec0) * cos_dec * cos_dra
    depth = np.where(depth > 0.0, depth, np.nan)
    xi = np.degrees(cos_dec * np.sin(dra) / depth)
    eta = np.degrees((math.cos(dec0) * sin_dec - math.sin(dec0) * cos_dec * cos_dra) / depth)
    cd11, cd12, cd21, cd22 = wcs.cd
    det = cd11 * cd22 - cd12 * cd21
    u = (cd22 * xi - cd12 * eta) / det
    v = (cd11 * eta - cd21 * xi) / det
    if wcs.sip_a or wcs.sip_b:
        u, v = _undo_sip(wcs, u, v)
    return np.asarray(u + wcs.crpix_x_px), np.asarray(v + wcs.crpix_y_px)


def _polynomial(terms: Sip, u: FloatArray, v: FloatArray) -> FloatArray:
    total = np.zeros(())
    for p, q, coefficient in terms:
        total = total + coefficient * u**p * v**q
    return total


def _undo_sip(wcs: Wcs, u_plane: FloatArray, v_plane: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Invert SIP by fixed-point iteration; NaN far outside the plate, where it does not settle."""
    u, v = u_plane, v_plane
    step = np.full(np.shape(u_plane), np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_INVERSE_STEPS):
            u_next = u_plane - _polynomial(wcs.sip_a, u, v)
            v_next = v_plane - _polynomial(wcs.sip_b, u, v)
            step = np.maximum(np.abs(u_next - u), np.abs(v_next - v))
            u, v = u_next, v_next
            if not np.any(step > _INVERSE_TOLERANCE_PX):
                break
        is_settled = step <= 1e-3
    return np.where(is_settled, u, np.nan), np.where(is_settled, v, np.nan)


def tan_wcs(
    ra_icrs_deg: float,
    dec_icrs_deg: float,
    *,
    scale_arcsec_px: float,
    rotation_deg: float,
    is_flipped: bool,
    width_px: int,
    height_px: int,
) -> Wcs:
    """Plate without distortion whose image centre ((w-1)/2, (h-1)/2) has the given direction.

    ``rotation_deg``: position angle of +y. ``is_flipped`` False: with +y to the north, east is to
    the left.
    """
    s = scale_arcsec_px / ARCSEC_PER_DEG
    sin_r, cos_r = math.sin(math.radians(rotation_deg)), math.cos(math.radians(rotation_deg))
    hand = 1.0 if is_flipped else -1.0
    return Wcs(
        crpix_x_px=(width_px - 1) / 2.0,
        crpix_y_px=(height_px - 1) / 2.0,
        crval_ra_deg=ra_icrs_deg % 360.0,
        crval_dec_deg=dec_icrs_deg,
        cd=(hand * s * cos_r, s * sin_r, -hand * s * sin_r, s * cos_r),
    )


def jacobian_arcsec_px(wcs: Wcs, x_px: float, y_px: float) -> FloatArray:
    """Jacobian (2, 2) of sky by pixel at one pixel, in arcsec per pixel.

    Rows: east, north; columns: x, y. A pixel covariance C becomes J C J' on the sky.
    """
    h = 0.5
    x = np.array([x_px + h, x_px - h, x_px, x_px, x_px])
    y = np.array([y_px, y_px, y_px + h, y_px - h, y_px])
    ra, dec = pixel_to_sky(wcs, x, y)
    cos_dec = math.cos(math.radians(float(dec[4])))
    east_deg = ((np.array([ra[0] - ra[1], ra[2] - ra[3]]) + 180.0) % 360.0 - 180.0) * cos_dec
    north_deg = np.array([dec[0] - dec[1], dec[2] - dec[3]])
    return np.stack([east_deg, north_deg]) * ARCSEC_PER_DEG / (2.0 * h)


@lru_cache(maxsize=8)
def describe_field(wcs: Wcs, width_px: int, height_px: int) -> FieldDescription:
    """Return direction, scale, rotation and mirroring of a plate at the centre of its image.

    They are defined as in ``records.Solution``.
    """
    x, y = (width_px - 1) / 2.0, (height_px - 1) / 2.0
    ra, dec = pixel_to_sky(wcs, x, y)
    jacobian = jacobian_arcsec_px(wcs, x, y)
    det = float(np.linalg.det(jacobian))
    return FieldDescription(
        ra_icrs_deg=float(ra),
        dec_icrs_deg=float(dec),
        scale_arcsec_px=math.sqrt(abs(det)),
        rotation_deg=math.degrees(math.atan2(jacobian[0, 1], jacobian[1, 1])) % 360.0,
        is_flipped=det > 0.0,
    )


def wcs_cards(wcs: Wcs, width_px: int, height_px: int) -> dict[str, str | int | float]:
    """FITS cards of a plate, in writing order; CRPIX1 and CRPIX2 count pixels from 1."""
    suffix = "-SIP" if wcs.sip_a or wcs.sip_b else ""
    cards: dict[str, str | int | float] = {
        "WCSAXES": 2,
        "CTYPE1": "RA---TAN" + suffix,
        "CTYPE2": "DEC--TAN" + suffix,
        "CUNIT1": "deg",
        "CUNIT2": "deg",
        "RADESYS": "ICRS",
        "CRVAL1": wcs.crval_ra_deg,
        "CRVAL2": wcs.crval_dec_deg,
        "CRPIX1": wcs.crpix_x_px + 1.0,
        "CRPIX2": wcs.crpix_y_px + 1.0,
    }
    cards.update(zip(("CD1_1", "CD1_2", "CD2_1", "CD2_2"), wcs.cd, strict=True))
    if suffix:
        for letter, terms in (("A", wcs.sip_a), ("B", wcs.sip_b)):
            cards[f"{letter}_ORDER"] = max([2, *(p + q for p, q, _ in terms)])
            for p, q, coefficient in terms:
                cards[f"{letter}_{p}_{q}"] = coefficient
    cards["IMAGEW"] = width_px
    cards["IMAGEH"] = height_px
    return cards


def wcs_from_cards(cards: Mapping[str, Any]) -> Wcs:
    """Read the plate written in FITS cards (CD, or PC with CDELT, or CDELT with CROTA2; SIP).

    Raises FrameError when the cards hold no gnomonic plate in right ascension and declination.
    """
    kinds = (str(cards.get("CTYPE1", "")).strip(), str(cards.get("CTYPE2", "")).strip())
    if not (kinds[0].startswith("RA---TAN") and kinds[1].startswith("DEC--TAN")):
        raise FrameError(f"the header holds no TAN plate (CTYPE {kinds[0]!r}, {kinds[1]!r})")
    try:
        plate = Wcs(
            crpix_x_px=float(cards["CRPIX1"]) - 1.0,
            crpix_y_px=float(cards["CRPIX2"]) - 1.0,
            crval_ra_deg=float(cards["CRVAL1"]) % 360.0,
            crval_dec_deg=float(cards["CRVAL2"]),
            cd=_cd_from_cards(cards),
            sip_a=_sip_from_cards(cards, "A") if kinds[0].endswith("-SIP") else (),
            sip_b=_sip_from_cards(cards, "B") if kinds[0].endswith("-SIP") else (),
        )
    except (ArithmeticError, KeyError, TypeError, ValueError) as error:
        raise FrameError(f"the header's plate cannot be read ({error}): solve it again") from error
    cd11, cd12, cd21, cd22 = plate.cd
    place = (plate.crpix_x_px, plate.crpix_y_px, plate.crval_ra_deg, plate.crval_dec_deg)
    if not all(map(math.isfinite, (*place, *plate.cd))) or cd11 * cd22 == cd12 * cd21:
        raise FrameError("the header's plate has no scale or no place: solve it again")
    return plate


_MAX_SIP_ORDER = 9
"""Largest order of distortions, by Shupe et al. 2005."""


def _cd_from_cards(cards: Mapping[str, Any]) -> tuple[float, float, float, float]:
    names = ("1_1", "1_2", "2_1", "2_2")
    if any(f"CD{n}" in cards for n in names):
        cd11, cd12, cd21, cd22 = (float(cards.get(f"CD{n}", 0.0)) for n in names)
        return cd11, cd12, cd21, cd22
    step_1, step_2 = float(cards["CDELT1"]), float(cards["CDELT2"])
    if any(f"PC{n}" in cards for n in names):
        pc = [float(cards.get(f"PC{n}", 1.0 if n[0] == n[2] else 0.0)) for n in names]
        return step_1 * pc[0], step_1 * pc[1], step_2 * pc[2], step_2 * pc[3]
    rotation = math.radians(float(cards.get("CROTA2", 0.0)))
    sin_r, cos_r = math.sin(rotation), math.cos(rotation)
    return step_1 * cos_r, -step_2 * sin_r, step_1 * sin_r, step_2 * cos_r


def _sip_from_cards(cards: Mapping[str, Any], letter: str) -> Sip:
    order = int(cards.get(f"{letter}_ORDER", 0))
    if not 0 <= order <= _MAX_SIP_ORDER:
        raise ValueError(f"{letter}_ORDER is {order:g}, {_MAX_SIP_ORDER} at most")
    names = [(p, q) for p in range(order + 1) for q in range(order + 1 - p)]
    return tuple(
        (p, q, float(cards[f"{letter}_{p}_{q}"])) for p, q in names if f"{letter}_{p}_{q}" in cards
    )
