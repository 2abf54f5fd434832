"""Directions and angles as people type them, and records as the command line's JSON."""
