"""Verbs for what was recorded: sessions, frames, orbits, names, catalogues."""
