"""Imperfections of a simulated night, each a named setting."""
