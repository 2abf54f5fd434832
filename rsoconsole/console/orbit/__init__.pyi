from .lines import orbit_lines as orbit_lines
from .lines import target_words as target_words
from .orbit_view import OrbitShown as OrbitShown
from .orbit_view import orbit_shown as orbit_shown
