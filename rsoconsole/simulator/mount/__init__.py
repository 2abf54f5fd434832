"""A German equatorial mount as numbers, with its faults."""
