from .horizon import horizon_altitude_deg as horizon_altitude_deg
from .limits import Limits as Limits
from .limits import Pose as Pose
from .refusals import LimitName as LimitName
from .refusals import Refusal as Refusal
from .stopping import StoppingDistance as StoppingDistance
from .way_ahead import Rates as Rates
