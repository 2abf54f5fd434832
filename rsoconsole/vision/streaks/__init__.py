"""A streak measured on the raw frame, and what kind of thing drew it."""
