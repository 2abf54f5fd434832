"""Bright stars by the names that people type.

Names: IAU Catalog of Star Names; places: Hipparcos (ESA 1997), ICRS at J2000.0 to a second of arc,
near enough to point a telescope.
"""

from rsoconsole.sky import parse_dec_deg, parse_ra_deg

_TABLE = """
Achernar 01 37 42.8 -57 14 12
Acrux 12 26 35.9 -63 05 57
Adhara 06 58 37.5 -28 58 20
Aldebaran 04 35 55.2 +16 30 33
Algol 03 08 10.1 +40 57 20
Alhena 06 37 42.7 +16 23 57
Alioth 12 54 01.7 +55 57 35
Alkaid 13 47 32.4 +49 18 48
Alnilam 05 36 12.8 -01 12 07
Alnitak 05 40 45.5 -01 56 34
Alphard 09 27 35.2 -08 39 31
Alphecca 15 34 41.3 +26 42 53
Alpheratz 00 08 23.3 +29 05 26
Altair 19 50 47.0 +08 52 06
Antares 16 29 24.5 -26 25 55
Arcturus 14 15 39.7 +19 10 57
Arneb 05 32 43.8 -17 49 20
Bellatrix 05 25 07.9 +06 20 59
Betelgeuse 05 55 10.3 +07 24 25
Canopus 06 23 57.1 -52 41 44
Capella 05 16 41.4 +45 59 53
Castor 07 34 35.9 +31 53 18
Deneb 20 41 25.9 +45 16 49
Denebola 11 49 03.6 +14 34 19
Diphda 00 43 35.4 -17 59 12
Dubhe 11 03 43.7 +61 45 04
Elnath 05 26 17.5 +28 36 27
Enif 21 44 11.2 +09 52 30
Fomalhaut 22 57 39.0 -29 37 20
Hamal 02 07 10.4 +23 27 45
Kochab 14 50 42.3 +74 09 20
Markab 23 04 45.7 +15 12 19
Menkar 03 02 16.8 +04 05 23
Mintaka 05 32 00.4 -00 17 57
Mirach 01 09 43.9 +35 37 14
Mirfak 03 24 19.4 +49 51 40
Mirzam 06 22 42.0 -17 57 21
Nunki 18 55 15.9 -26 17 48
Polaris 02 31 49.1 +89 15 51
Pollux 07 45 18.9 +28 01 34
Porrima 12 41 39.6 -01 26 58
Procyon 07 39 18.1 +05 13 30
Rasalhague 17 34 56.1 +12 33 36
Regulus 10 08 22.3 +11 58 02
Rigel 05 14 32.3 -08 12 06
Sabik 17 10 22.7 -15 43 29
Sadalmelik 22 05 47.0 -00 19 11
Sadalsuud 21 31 33.5 -05 34 16
Saiph 05 47 45.4 -09 40 11
Sirius 06 45 08.9 -16 42 58
Spica 13 25 11.6 -11 09 41
Unukalhai 15 44 16.1 +06 25 32
Vega 18 36 56.3 +38 47 01
Vindemiatrix 13 02 10.6 +10 57 33
Wezen 07 08 23.5 -26 23 36
Zubeneschamali 15 17 00.4 -09 22 59
"""


def _read() -> dict[str, tuple[float, float]]:
    stars: dict[str, tuple[float, float]] = {}
    for line in _TABLE.strip().splitlines():
        name, *fields = line.split()
        stars[name] = parse_ra_deg(" ".join(fields[:3])), parse_dec_deg(" ".join(fields[3:]))
    return stars


NAMED_STARS = _read()
"""Right ascension and declination, ICRS degrees, by name."""
