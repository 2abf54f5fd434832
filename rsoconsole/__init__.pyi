from .library import PlateWCS as PlateWCS
from .library import Track as Track
from .library import Tracks as Tracks
from .library import detect as detect
from .library import measure as measure
from .library import solve as solve
from .library import track as track
from .notebook import LivePanel as LivePanel
from .notebook import Session as Session
from .notebook import live_panel as live_panel
from .notebook import open_session as open_session

__version__: str
