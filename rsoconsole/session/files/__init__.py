"""Files of a session, their hashes, and notes on its upkeep."""
