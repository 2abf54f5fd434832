"""Reads frames from files (FITS, TIFF, PNG), and the values of their headers."""
