from .darkness import night_span as night_span
from .messier import MESSIER as MESSIER
from .moon import moon_gcrs_km as moon_gcrs_km
from .moon import moon_icrs as moon_icrs
from .moon import moon_lit_fraction as moon_lit_fraction
from .named_stars import NAMED_STARS as NAMED_STARS
from .planets import PLANETS as PLANETS
from .planets import planet_icrs as planet_icrs
