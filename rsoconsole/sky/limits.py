"""Where a telescope must not look: held against the end point of every slew."""

from rsoconsole.config import MountConfig
from rsoconsole.records import Site
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.frames import icrs_to_altaz
from rsoconsole.sky.sun import sun_icrs


def refusal(
    ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int, site: Site, mount: MountConfig
) -> str | None:
    """Why this direction is refused at this instant, with the figure; None when it is safe."""
    if not (0.0 <= ra_icrs_deg < 360.0 and -90.0 <= dec_icrs_deg <= 90.0):  # NaN fails too
        return f"RA {ra_icrs_deg} Dec {dec_icrs_deg} is no direction"
    altitude_deg, _ = icrs_to_altaz(site, ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    if altitude_deg < mount.min_altitude_deg:
        return f"altitude {altitude_deg:.1f} deg is below the limit {mount.min_altitude_deg:.1f}"
    sun_ra_deg, sun_dec_deg = sun_icrs(t_utc_ns)
    from_sun_deg = separation_deg(ra_icrs_deg, dec_icrs_deg, sun_ra_deg, sun_dec_deg)
    if from_sun_deg < mount.sun_cone_deg:
        return f"{from_sun_deg:.1f} deg from the Sun, inside its cone of {mount.sun_cone_deg:.0f}"
    return None
