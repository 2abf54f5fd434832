from .base import FrameError as FrameError
from .base import InputError as InputError
from .base import NotSolvedError as NotSolvedError
from .base import OrbitError as OrbitError
from .base import RsoconsoleError as RsoconsoleError
from .base import SessionError as SessionError
from .library import Identification as Identification
from .library import LightCurve as LightCurve
from .library import LivePanel as LivePanel
from .library import Orbit as Orbit
from .library import PlateWCS as PlateWCS
from .library import Session as Session
from .library import Track as Track
from .library import Tracks as Tracks
from .library import crossings as crossings
from .library import detect as detect
from .library import identify as identify
from .library import lightcurve as lightcurve
from .library import live_panel as live_panel
from .library import measure as measure
from .library import open_session as open_session
from .library import orbit as orbit
from .library import solve as solve
from .library import to_score as to_score
from .library import to_udl as to_udl
from .library import track as track

__version__: str
