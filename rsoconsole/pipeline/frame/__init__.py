"""Reduction of one frame to measurements: calibration, detection, plate solution, time."""
