"""Leaps: slews to points ahead of a low satellite, and stares that wait for a satellite."""
