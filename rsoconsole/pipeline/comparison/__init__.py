"""Streaks of a solved frame against the frame before it and the star catalogue."""
