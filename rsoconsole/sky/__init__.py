"""Angles, times, frames, plate geometry, star catalogue. Imports nothing above the records."""
