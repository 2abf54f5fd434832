from .proper_motion import J2000_JYEAR as J2000_JYEAR
from .proper_motion import julian_year as julian_year
from .star_catalogue import StarCatalogue as StarCatalogue
from .star_catalogue import Stars as Stars
from .star_catalogue import holds_stars as holds_stars
