"""A frame's picture in a terminal, and the marks over it."""
