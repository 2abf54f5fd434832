from .above_limit import Up as Up
from .above_limit import up_now as up_now
from .hours_ahead import Outlook as Outlook
from .hours_ahead import outlook as outlook
from .passes import NightPass as NightPass
from .passes import night_passes as night_passes
from .standing import margin_deg as margin_deg
