from .live import LiveScreen as LiveScreen
from .night_screen import NightScreen as NightScreen
from .review import ReviewScreen as ReviewScreen
