"""Checks of this machine's readiness for a night: one for each thing that has ended nights
before."""
