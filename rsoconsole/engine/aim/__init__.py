"""Aim of the next exposure, control of the mount, and the dark hours of the night."""
