"""Fields of Gaussian stars seen with a known plate, drawn without the product's own renderer."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.records import Detection, FloatArray, Frame, Solution, Wcs
from rsoconsole.sky import pixel_to_sky, sky_to_pixel, tan_wcs
from tests.makers import NS, T0_UTC_NS, straight_detection

SIZE_PX = 600
SCALE_ARCSEC_PX = 2.0
SIGMA_PX = 1.2
SKY_ADU, NOISE_ADU = 900.0, 12.0
EXPOSURE_S, CADENCE_S = 10.0, 30.0
CENTRE_DEG = (150.0, 4.0)
Ends = tuple[float, float, float, float]


def plate(shift_px: tuple[float, float] = (0.0, 0.0), turn_deg: float = 2.0) -> Wcs:
    """A plate on which every star lies about ``shift_px`` further than on the plate of (0, 0)."""
    centred = tan_wcs(
        *CENTRE_DEG,
        scale_arcsec_px=SCALE_ARCSEC_PX,
        rotation_deg=turn_deg,
        is_flipped=False,
        width_px=SIZE_PX,
        height_px=SIZE_PX,
    )
    x, y = shift_px
    return replace(centred, crpix_x_px=centred.crpix_x_px + x, crpix_y_px=centred.crpix_y_px + y)


@dataclass
class DrawnSky:
    """Stars at places of the sky; places are given in pixels of the plate of no shift."""

    rng: np.random.Generator
    ra_deg: FloatArray = field(default_factory=lambda: np.zeros(0))
    dec_deg: FloatArray = field(default_factory=lambda: np.zeros(0))
    flux_adu: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def with_field(cls, seed: int, count: int = 60) -> "DrawnSky":
        sky = cls(np.random.default_rng(seed))
        x, y = sky.rng.uniform(-150.0, SIZE_PX + 150.0, (2, count * 2))
        sky.add(x, y, 1500.0 * (1.0 + sky.rng.pareto(1.5, x.size)))
        return sky

    def add(self, x_px: FloatArray, y_px: FloatArray, flux_adu: FloatArray) -> None:
        ra, dec = pixel_to_sky(plate(), x_px, y_px)
        self.ra_deg = np.append(self.ra_deg, ra)
        self.dec_deg = np.append(self.dec_deg, dec)
        self.flux_adu = np.append(self.flux_adu, flux_adu)

    def clear_about(self, ends: Ends, reach_px: float = 14.0) -> None:
        """No star of the field near a line."""
        x, y = sky_to_pixel(plate(), self.ra_deg, self.dec_deg)
        u, v, length = along(ends, x, y)
        is_far = (np.abs(v) > reach_px) | (u < -40.0) | (u > length + 40.0)
        self.ra_deg, self.dec_deg = self.ra_deg[is_far], self.dec_deg[is_far]
        self.flux_adu = self.flux_adu[is_far]

    def frame(
        self,
        number: int,
        wcs: Wcs,
        *lights: FloatArray,
        transparency: float = 1.0,
        sigma_px: float = SIGMA_PX,
    ) -> Frame:
        """One exposure; ``lights``: whatever else shines, ADU, (SIZE_PX, SIZE_PX)."""
        x, y = sky_to_pixel(wcs, self.ra_deg, self.dec_deg)
        light = points(x, y, self.flux_adu * transparency, sigma_px) + sum(lights)
        noise = self.rng.normal(0.0, NOISE_ADU, light.shape)
        return Frame(
            frame_id=number,
            name=f"frame {number}",
            pixels=np.clip(np.rint(SKY_ADU + light + noise), 0, 65535).astype(np.uint16),
            t_start_utc_ns=T0_UTC_NS + round((number - 1) * CADENCE_S * NS),
            exposure_s=EXPOSURE_S,
            scale_arcsec_px=SCALE_ARCSEC_PX,
            pointing_ra_icrs_deg=CENTRE_DEG[0],
            pointing_dec_icrs_deg=CENTRE_DEG[1],
        )


def along(ends: Ends, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Way along a line from end a, way off it, and its length."""
    x_a, y_a, x_b, y_b = ends
    length = math.dist((x_a, y_a), (x_b, y_b))
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    return (x - x_a) * dx + (y - y_a) * dy, (y - y_a) * dx - (x - x_a) * dy, length


def points(
    x: FloatArray, y: FloatArray, flux: FloatArray, sigma_px: float = SIGMA_PX
) -> FloatArray:
    """Gaussian stars, each in a square of its own."""
    light, reach = np.zeros((SIZE_PX, SIZE_PX)), 9
    for x0, y0, total in zip(x, y, flux, strict=True):
        left, low = round(x0) - reach, round(y0) - reach
        xs = np.arange(max(left, 0), min(left + 2 * reach + 1, SIZE_PX))
        ys = np.arange(max(low, 0), min(low + 2 * reach + 1, SIZE_PX))
        if xs.size and ys.size:
            disc = np.exp(-0.5 * ((xs - x0) ** 2 + (ys[:, None] - y0) ** 2) / sigma_px**2)
            light[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1] += (
                total * disc / (2.0 * math.pi * sigma_px**2)
            )
    return light


def on_line(ends: Ends, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places at shares of the way from end a to end b."""
    x_a, y_a, x_b, y_b = ends
    return x_a + shares * (x_b - x_a), y_a + shares * (y_b - y_a)


def flashes(ends: Ends, count: int, flux_adu: float, lasts: float = 0.25) -> FloatArray:
    """A streak whose light comes ``count`` times, each for a share of its period."""
    share = (np.arange(1200) + 0.5) / 1200
    is_lit = (share * count) % 1.0 < lasts
    x, y = on_line(ends, share[is_lit])
    return points(x, y, np.full(x.size, flux_adu * count / x.size))


def solved(frame: Frame, wcs: Wcs) -> Solution:
    ra, dec = pixel_to_sky(wcs, (SIZE_PX - 1) / 2.0, (SIZE_PX - 1) / 2.0)
    return Solution(
        frame_id=frame.frame_id,
        wcs=wcs,
        ra_icrs_deg=float(ra),
        dec_icrs_deg=float(dec),
        scale_arcsec_px=SCALE_ARCSEC_PX,
        rotation_deg=2.0,
        is_flipped=False,
        matched=40,
        rms_arcsec=0.2,
        path="full",
        ms=1.0,
    )


def streak_at(ends: Ends, frame: Frame, snr: float = 60.0, **other: object) -> Detection:
    """A detection with these ends, as wide as stars."""
    x_a, y_a, x_b, y_b = ends
    return straight_detection(
        frame_id=frame.frame_id,
        x_px=0.5 * (x_a + x_b),
        y_px=0.5 * (y_a + y_b),
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        length_px=math.dist((x_a, y_a), (x_b, y_b)),
        width_px=2.3548 * SIGMA_PX,
        snr=snr,
        **other,
    )
