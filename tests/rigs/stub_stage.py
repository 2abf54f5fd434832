"""A stage whose frames tell where and when they were taken: 256 x 192, no sky."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.config import OpticsConfig
from rsoconsole.records import Site
from rsoconsole.simulator.server import ObservatorySettings, ObservatorySetup

T_START_UTC_NS = 1_687_400_000_000_000_000
SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)


@dataclass(frozen=True)
class PlainTruth:
    """What a plain frame was asked to show."""

    facts: dict[str, Any]

    def to_json(self) -> str:
        """The facts."""
        return json.dumps(self.facts)


class PlainScene:
    """Noise seeded by the night's seed and the exposure's start."""

    def __init__(self, seed: int, width_px: int, height_px: int) -> None:
        self.seed, self.shape = seed, (height_px, width_px)

    def expose(  # noqa: PLR0917 - the scene's own signature
        self,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        rotation_deg: float,
        is_flipped: bool,
        t_start_utc_ns: int,
        exposure_s: float,
    ) -> tuple[npt.NDArray[np.uint16], PlainTruth]:
        """Noise, and everything that was asked for as truth."""
        rng = np.random.default_rng([self.seed, t_start_utc_ns])
        pixels = rng.integers(0, 65536, self.shape, dtype=np.uint16)
        pixels[0, :2] = 0, 65535
        facts = {
            "ra_icrs_deg": ra_icrs_deg,
            "dec_icrs_deg": dec_icrs_deg,
            "rotation_deg": rotation_deg,
            "is_flipped": is_flipped,
            "t_start_utc_ns": t_start_utc_ns,
            "exposure_s": exposure_s,
        }
        return pixels, PlainTruth(facts)

    def empty_sky_message(self, dec_icrs_deg: float) -> str | None:
        """Empty north of declination 20 deg."""
        return f"nothing shines at {dec_icrs_deg:.0f} deg" if dec_icrs_deg > 20.0 else None


def open_plain(settings: ObservatorySettings) -> ObservatorySetup:
    """A plain stage on the equator, an hour east of the meridian."""
    width_px, height_px = settings.width_px or 256, settings.height_px or 192
    return ObservatorySetup(
        site=SITE,
        optics=OpticsConfig(width_px=width_px, height_px=height_px),
        t_start_utc_ns=T_START_UTC_NS,
        start_ra_icrs_deg=240.0,
        start_dec_icrs_deg=-5.0,
        scene=PlainScene(settings.seed, width_px, height_px),
    )
