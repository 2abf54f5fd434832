"""Kalman filters: one, or a bank of motions and scatters, with their consistency."""
