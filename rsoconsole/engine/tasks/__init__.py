"""Tasks of the loop and its watch: exposures, slews, parking, limits and the log."""
