"""Limits on where a telescope may look and turn."""
