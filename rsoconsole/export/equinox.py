"""Directions on old star charts turned to ICRS, by astropy."""


def to_icrs(
    ra_deg: float, dec_deg: float, equinox_year: int | None, t_utc_ns: int
) -> tuple[float, float]:
    """Degrees. ``equinox_year``: 2000 and later of FK5, before 1984 of FK4; None: that of date."""
    if equinox_year == 2000:
        return ra_deg, dec_deg  # FK5 differs from ICRS by 0.02 arcsec
    from astropy.coordinates import FK4, FK5, SkyCoord
    from astropy.time import Time

    if equinox_year is None:
        frame = FK5(equinox=Time(t_utc_ns / 1e9, format="unix"))
    elif equinox_year < 1984:
        date = Time(t_utc_ns / 1e9, format="unix")
        frame = FK4(equinox=Time(equinox_year, format="byear"), obstime=date)
    else:
        frame = FK5(equinox=Time(equinox_year, format="jyear"))
    found = SkyCoord(ra_deg, dec_deg, unit="deg", frame=frame).icrs
    return float(found.ra.deg), float(found.dec.deg)
