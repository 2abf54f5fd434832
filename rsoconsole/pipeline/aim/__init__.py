"""Aim point of the next exposure, with one satellite tracked or several. Pure."""
