"""Ledgers across nights: of uncatalogued tracks, and of the errors of elements."""
