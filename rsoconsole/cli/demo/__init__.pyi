from . import demo as demo
from .bench import run_bench as run_bench
