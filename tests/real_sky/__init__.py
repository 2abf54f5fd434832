"""Nights on Debian's own indiserver and simulators, under a sky of ours."""
