"""Where a telescope must never look or turn."""
