"""A frame's sky, bins, map and calibration, and the threads that share the work."""
