from .errors import FrameError as FrameError
from .errors import InputError as InputError
from .errors import NotSolvedError as NotSolvedError
from .errors import OrbitError as OrbitError
from .errors import RsoconsoleError as RsoconsoleError
from .errors import SessionError as SessionError
from .library import Identification as Identification
from .library import Orbit as Orbit
from .library import PlateWCS as PlateWCS
from .library import Track as Track
from .library import Tracks as Tracks
from .library import detect as detect
from .library import identify as identify
from .library import measure as measure
from .library import orbit as orbit
from .library import solve as solve
from .library import track as track
from .notebook import LivePanel as LivePanel
from .notebook import Session as Session
from .notebook import live_panel as live_panel
from .notebook import open_session as open_session

__version__: str
