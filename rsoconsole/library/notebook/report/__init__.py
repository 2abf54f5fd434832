"""The night as one page."""
