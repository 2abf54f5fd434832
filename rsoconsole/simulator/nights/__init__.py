"""Nights to choose from: named scenarios, chosen satellites, worlds drawn at random."""
