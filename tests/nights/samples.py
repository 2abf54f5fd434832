"""Where the recorded sessions lie that tests read: nobody writes into them."""

from pathlib import Path

SESSIONS = Path(__file__).parents[2] / "sessions"
SAMPLE = SESSIONS / "intelsat-14"
"""The one that is shipped, of today's schema: ``sessions/make_sample.py`` records it again."""

DATA = Path(__file__).parents[1] / "data"
SCHEMA_1 = DATA / "schema-1-intelsat-14"
"""22 frames of full size as the first schema wrote them, one of them with its pixels; it stays as
it is."""
OLD_SESSIONS = (SCHEMA_1,)
"""Whole folders; of schema 3 there are logs, which ``old_nights.py`` makes sessions of."""
