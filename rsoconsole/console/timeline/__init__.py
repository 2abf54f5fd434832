"""The time line of a night: its moments, its events, and how they are drawn."""
