from .fixed_light import Comparison as Comparison
from .fixed_light import FixedLight as FixedLight
from .fixed_light import RecordedComparison as RecordedComparison
