"""One frame to measurements: calibrated, detected, solved, measured at its own time."""
