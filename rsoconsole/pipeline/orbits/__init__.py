"""Records of the tracks' orbits, names and relative motion, made after each frame."""
