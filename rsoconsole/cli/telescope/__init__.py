"""Verbs for the running telescope and its machine."""
