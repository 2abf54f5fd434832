"""Streaks of a solved frame, compared with the frame before it and the star catalogue."""
