from .run import run_console as run_console
from .run import run_review as run_review
from .timeline.timeline import parse_place as parse_place
