"""A night above one site: pixels and truth of any exposure."""
