"""Leaps ahead of low satellites, and stares that wait for one to come by."""
