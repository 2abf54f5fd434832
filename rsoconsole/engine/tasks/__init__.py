"""Exposures, slews, parking, limits and the log: what the loop and its watch carry out."""
