"""Where the recorded sessions lie that tests read: nobody writes into them."""

from pathlib import Path

SESSIONS = Path(__file__).parents[2] / "sessions"
SAMPLE = SESSIONS / "intelsat-14"
"""The one that is shipped: ``sessions/make_sample.py`` records it again."""
