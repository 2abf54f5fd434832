from .mount import IndiMount as IndiMount
from .past_engine import stop_past_engine as stop_past_engine
