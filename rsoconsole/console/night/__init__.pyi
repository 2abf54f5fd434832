from .ahead import OrbitAhead as OrbitAhead
from .ahead import orbit_ahead as orbit_ahead
from .alerts import alerts_between as alerts_between
from .alerts import notification as notification
from .engine_seen import EngineView as EngineView
from .engine_seen import engine_view as engine_view
