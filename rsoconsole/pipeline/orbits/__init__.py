"""Orbits, names and relative motion of what is followed, frame by frame, as they go on record."""
