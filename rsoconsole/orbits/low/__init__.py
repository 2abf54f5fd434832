"""Orbits of low satellites from single streaks, and their next pass."""
