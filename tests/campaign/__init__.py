"""Campaigns: the whole program on hundreds of nights that it was not tuned on, in one table."""
