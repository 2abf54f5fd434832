"""First orbits: states through a few lines of sight, before anything is fitted."""
