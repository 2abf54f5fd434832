"""The screen of one frame at full resolution: its pixels, and the result of other settings."""
