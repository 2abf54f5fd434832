from .mount import IndiMount as IndiMount
from .mount_mirror import abilities_by as abilities_by
from .past_engine import stop_past_engine as stop_past_engine
