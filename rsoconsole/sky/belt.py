"""Where the geostationary belt and its slots lie for a site, parallax included."""

import math

from rsoconsole.records import Site

GEO_RADIUS_KM = 42164.17
EARTH_RADIUS_KM = 6378.137
EARTH_E2 = 0.00669437999014


def belt_declination_deg(site: Site, hour_angle_deg: float) -> float:
    """Topocentric declination of the belt at a topocentric hour angle (west positive).

    The direction at this hour angle lies in a meridian plane of the sky through the site; the
    belt crosses that plane once above the horizon. Geometry on the WGS84 ellipsoid; good to a
    few arcminutes, far less than a field.
    """
    axis_km, height_km = _site_km(site)
    # In the equatorial plane, x along the site's meridian: |(axis, 0) + d (cos h, -sin h)| = GEO.
    h = math.radians(hour_angle_deg)
    along = axis_km * math.cos(h)
    distance_km = -along + math.sqrt(along**2 + GEO_RADIUS_KM**2 - axis_km**2)
    return math.degrees(math.atan2(-height_km, distance_km))


def slot_direction(site: Site, slot_longitude_deg: float) -> tuple[float, float]:
    """Topocentric hour angle (west positive, -180 to 180) and declination of a belt slot.

    ``slot_longitude_deg`` is east positive. Where the Earth is in the way the direction points
    below the horizon: that is for the limits to refuse.
    """
    axis_km, height_km = _site_km(site)
    west = math.radians(site.longitude_deg - slot_longitude_deg)
    # In the equatorial plane, x along the site's meridian, y towards west.
    x_km = GEO_RADIUS_KM * math.cos(west) - axis_km
    y_km = GEO_RADIUS_KM * math.sin(west)
    hour_angle_deg = math.degrees(math.atan2(y_km, x_km))
    return hour_angle_deg, math.degrees(math.atan2(-height_km, math.hypot(x_km, y_km)))


def _site_km(site: Site) -> tuple[float, float]:
    """Distance from the Earth's axis and height over the equator's plane, WGS84."""
    latitude = math.radians(site.latitude_deg)
    normal_km = EARTH_RADIUS_KM / math.sqrt(1 - EARTH_E2 * math.sin(latitude) ** 2)
    axis_km = (normal_km + site.elevation_m / 1e3) * math.cos(latitude)
    return axis_km, (normal_km * (1 - EARTH_E2) + site.elevation_m / 1e3) * math.sin(latitude)
