"""Timing of the shutter and errors of published elements, measured from recorded nights."""
