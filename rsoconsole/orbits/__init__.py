"""Pure: element sets and directions in, orbits and places out."""
