"""Brightness of a frame's streaks in magnitudes, once the telescope is on its way again."""
