"""Sources of a simulated field: satellites, stars, clouds, other traffic."""
