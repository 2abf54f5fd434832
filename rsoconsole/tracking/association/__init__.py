"""State of the tracks, places of their neighbours, and their motion against each other."""
