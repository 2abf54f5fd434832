from . import alerts as alerts
from . import house as house
from . import passes as passes
from . import seat as seat
from . import service as service
from . import telescope as telescope
