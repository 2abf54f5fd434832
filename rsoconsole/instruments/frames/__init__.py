"""Frames from files: FITS, TIFF, PNG, with what their headers promise."""
