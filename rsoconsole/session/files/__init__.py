"""The files of a session, their hashes, and what was done to it later."""
