"""The operator's seat in a terminal: shows what the session says, sends what the operator wants.

May touch session, control, sky, tracking, records and config below; never the engine, an
instrument or the simulator.
"""

from rsoconsole.console.run import run_console, run_review

__all__ = ["run_console", "run_review"]
