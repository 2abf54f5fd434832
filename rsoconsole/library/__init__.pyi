from .detecting import detect as detect
from .measuring import measure as measure
from .plate import PlateWCS as PlateWCS
from .solving import solve as solve
from .tracking import track as track
from .tracks import Track as Track
from .tracks import Tracks as Tracks
