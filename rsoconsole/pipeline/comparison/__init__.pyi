from .fixed_light import FixedLight as FixedLight
from .fixed_light import RecordedComparison as RecordedComparison
from .known_stars import catalogue_stars as catalogue_stars
