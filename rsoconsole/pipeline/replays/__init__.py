"""Replay of a recorded night: as it was, or with other settings."""
