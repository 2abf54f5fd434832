"""Track initiation: two streaks that agree on one motion, or a chain of points."""
