"""A frame for the bench: the real sky with a satellite in it, as the simulated camera gives it.

Only a verb may know the simulator: the bench is handed the bytes.
"""

from rsoconsole.config import Config

_BESIDE_DEG = 0.05
"""By which the header's direction is off, as a mount's word is."""
_NS = 1_000_000_000


def draw_fits(config: Config) -> bytes:
    """One frame of the configured optics and exposure, its first satellite in the middle."""
    import numpy as np

    from rsoconsole.orbits import Satellite
    from rsoconsole.simulator import DEFAULT_SCENARIO, Card, Scene, fits_bytes, scenario_named
    from rsoconsole.words import utc_ns_to_iso

    optics, exposure_s = config.optics, config.exposure.exposure_s
    scene = Scene(scenario_named(DEFAULT_SCENARIO), seed=1, optics=optics)
    # Its own brightness changes begin later in this night.
    t_start_utc_ns = scene.scenario.t_start_utc_ns + 60 * _NS
    t_mid = np.array([t_start_utc_ns + round(exposure_s * _NS / 2)])
    target = scene.scenario.target
    assert target is not None
    place = Satellite(target.element_set, target.standard_magnitude).astrometric_place(
        scene.site, t_mid
    )
    ra_deg, dec_deg = float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0])
    pixels, _ = scene.expose(ra_deg, dec_deg, 2.0, False, t_start_utc_ns, exposure_s)
    cards: dict[str, Card] = {
        "EXPTIME": exposure_s,
        "DATE-OBS": utc_ns_to_iso(t_start_utc_ns, 6).rstrip("Z"),
        "XPIXSZ": optics.pixel_um,
        "YPIXSZ": optics.pixel_um,
        "FOCALLEN": optics.focal_length_mm,
        "RA": ra_deg + _BESIDE_DEG,
        "DEC": dec_deg + _BESIDE_DEG,
        "INSTRUME": "bench",
        "FRAME": "Light",
    }
    return bytes(fits_bytes(pixels, cards))
