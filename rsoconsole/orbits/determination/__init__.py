"""From directions to an orbit that says how much of it is known."""
