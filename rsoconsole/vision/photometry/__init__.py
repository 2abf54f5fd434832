"""Light of stars and streaks, measured with one image of a point."""
