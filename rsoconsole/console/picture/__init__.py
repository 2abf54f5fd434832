"""A frame's picture in a terminal, and what is pointed at in it."""
