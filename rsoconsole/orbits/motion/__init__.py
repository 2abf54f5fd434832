"""Motion about the Earth, two-body or by all forces, and the places of an object on the sky."""
