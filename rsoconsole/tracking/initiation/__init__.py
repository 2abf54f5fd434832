"""How a track begins: two streaks that agree on one motion, or a chain of points."""
