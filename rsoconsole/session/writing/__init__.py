"""Writes a live session, and a rescue session when its disk fails."""
