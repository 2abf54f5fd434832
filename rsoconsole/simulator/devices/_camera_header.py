"""The header that INDI's CCD driver writes; RA and DEC are J2000 from the mount's own belief."""

from rsoconsole.records import Site
from rsoconsole.simulator.camera.indi_fits import CameraTraits, Card
from rsoconsole.simulator.camera.truth import header_start_utc_ns
from rsoconsole.simulator.mount.mount_model import MountInstant
from rsoconsole.simulator.world.world import World
from rsoconsole.sky import jnow_to_icrs
from rsoconsole.words import format_dec, format_ra, utc_ns_to_iso


def date_obs(world: World, t_start_utc_ns: int) -> str:
    """DATE-OBS of an exposure that the driver began then: to the microsecond, or cut down."""
    is_whole = world.shutter.round_s >= 1.0 and world.shutter.round_s.is_integer()
    written_utc_ns = header_start_utc_ns(world, t_start_utc_ns)
    return utc_ns_to_iso(written_utc_ns, 0 if is_whole else 6).rstrip("Z")


def header_cards(  # noqa: PLR0917 - who, with what, where, when, how long
    names: tuple[str, str],
    traits: CameraTraits,
    site: Site,
    world: World,
    belief: MountInstant,
    exposure_s: float,
) -> dict[str, Card]:
    """Cards but those of the read-out, in writing order.

    ``names``: of camera and mount; ``belief``: at the start.
    """
    ra, dec = jnow_to_icrs(belief.ra_date_deg, belief.dec_date_deg, belief.t_utc_ns)
    pixel_um = traits.pixel_um / traits.binning
    return {
        "INSTRUME": names[0],
        "TELESCOP": names[1],
        "ROWORDER": "TOP-DOWN",
        "EXPTIME": exposure_s,
        "DATE-OBS": date_obs(world, belief.t_utc_ns),
        "PIXSIZE1": pixel_um,
        "PIXSIZE2": pixel_um,
        "FRAME": "Light",
        "IMAGETYP": "Light Frame",
        "FOCALLEN": traits.focal_length_mm,
        "APTDIA": traits.focal_length_mm / 2.2,
        "SITELAT": site.latitude_deg,
        "SITELONG": site.longitude_deg,
        "OBJCTRA": format_ra(float(ra)).replace(":", " "),
        "OBJCTDEC": format_dec(float(dec)).replace(":", " "),
        "RA": float(ra),
        "DEC": float(dec),
        "PIERSIDE": belief.pier_side.upper(),
        "EQUINOX": 2000,
    }
