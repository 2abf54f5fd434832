from .service import RunSettings as RunSettings
from .service import run_engine as run_engine
