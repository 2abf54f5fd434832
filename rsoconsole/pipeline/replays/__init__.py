"""A recorded night once more: as it was, or with other settings."""
