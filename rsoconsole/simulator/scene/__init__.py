"""A night above one site: what any exposure of it shows, and the truth of it."""
