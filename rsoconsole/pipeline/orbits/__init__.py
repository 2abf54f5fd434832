"""Orbits, names and relative motion of the tracks, frame by frame, as they go on record."""
