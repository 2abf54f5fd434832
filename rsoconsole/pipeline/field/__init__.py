"""Matching of streaks and moving points in frames with catalogued objects."""
