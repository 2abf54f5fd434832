"""Nights of the simulated observatory: named scenarios, chosen satellites, random worlds."""
