"""Pure: pixels in, stars and streaks out. No input or output beyond loading the network."""
