"""All of a frame: its sky, its bins, its map, what the sensor adds to it."""
