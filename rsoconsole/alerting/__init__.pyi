from .process import AlertProcess as AlertProcess
from .services import call as call
from .services import send_within as send_within
from .services import services_of as services_of
