"""Verbs for the running telescope and the computer that controls it."""
