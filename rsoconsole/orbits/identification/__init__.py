"""Identification of catalogued objects, and the errors of their elements."""
