"""Ledgers across nights: tracks that no catalogue explains, and errors of elements."""
