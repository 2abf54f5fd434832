"""A session as it is written, and where it goes when its disk fails."""
