"""Limits of where a telescope may look and turn."""
