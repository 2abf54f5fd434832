"""First orbits: states through a few lines of sight, as starts of an orbit fit."""
