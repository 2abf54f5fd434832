"""Writing of a session, and its rescue session when its disk fails."""
