from .run import run_console as run_console
from .run import run_review as run_review
from .timeline.night_line import understood as understood
