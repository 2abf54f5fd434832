"""Nights and their records, made up or kept, for tests that read them."""
